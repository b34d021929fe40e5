// A guided tour: five steps, each a sentence and something to do. It knows the page only through what is here.

import type { Told } from './channel';
import { element } from './session';

export interface Guided {
  toWall: string; // where the hand must go
  felt(): number; // [N]
  limited(): boolean; // does a limit act?
  pressed(): number; // force on the environment [N]
  roundTrip(): number; // [ms]
  told(): Told;
  method(): number;
  without: number; // the method without passivity control
  names: string[];
  setDelay(ms: number): void; // in each direction
  setMethod(index: number): void;
}

interface Step {
  name: string;
  text: string;
  act?: { name: string; run(): void };
  limited?: string; // said while a limit acts
  done(): boolean;
}

export class Tour {
  private readonly steps: Step[];
  private at = -1;
  private taps = 0; // touches since the step began
  private touches = false;
  private reached = false;

  constructor(private readonly page: Guided) {
    const cure = page.names[0]!.split(',')[0]!;
    const drag = window.matchMedia('(pointer: coarse)').matches ? 'Drag the hand with a finger' : 'Drag the hand';
    this.steps = [
      {
        name: 'A wall.',
        text: `${drag} ${page.toWall} until the robot presses the wall: you move the robot, and the green arrow is its force coming back to you.`,
        act: { name: 'No delay', run: () => page.setDelay(0) },
        done: () => page.felt() > 1 && page.pressed() > 1,
      },
      {
        name: 'A delay.',
        text: 'Delay the network by 60 ms each way and press again: robot and force now come late.',
        act: { name: 'Delay 60 ms', run: () => page.setDelay(60) },
        done: () => page.roundTrip() > 110 && page.pressed() > 1,
      },
      {
        name: 'No control.',
        text: 'Choose NONE, press the wall and hold still: the late force pushes at the wrong moment, so the link gives energy to the hand that nobody has put in, and the badge turns red.',
        limited: ' Press less: a force at its limit cannot swing.',
        act: { name: 'Choose NONE', run: () => (page.setDelay(60), page.setMethod(page.without)) },
        done: () => page.method() === page.without && (page.told().verdict === 'unstable' || page.told().verdict === 'not passive'),
      },
      {
        name: 'The cure.',
        text: `Choose ${cure} and press the wall again over the same delay: it stays calm.`,
        act: { name: `Choose ${cure}`, run: () => page.setMethod(0) },
        done: () => page.method() === 0 && page.roundTrip() > 110 && page.felt() > 1 && page.told().verdict === 'passive',
      },
      {
        name: 'The budget.',
        text: 'Tap the wall three times and watch the gauge: what the hand gets back is what it has put in and, at most, this little energy E(0), however long the delay.',
        done: () => this.taps >= 3 && page.told().verdict !== 'not passive' && page.told().verdict !== 'unstable',
      },
    ];
    element('tour-next').onclick = () => this.go(this.at + 1);
    element('tour-back').onclick = () => this.go(this.at - 1);
    element('tour-end').onclick = () => this.go(-1);
    element('tour-do').onclick = () => this.steps[this.at]?.act?.run();
  }

  go(to: number): void {
    this.at = to < this.steps.length ? to : -1;
    this.taps = 0;
    this.touches = true;
    this.reached = false;
    const step = this.steps[this.at], panel = element('tour');
    panel.hidden = !step;
    panel.classList.remove('done');
    if (!step) return;
    element('tour-step').textContent = `${this.at + 1} of ${this.steps.length}. ${step.name}`;
    element('tour-text').textContent = step.text;
    element('tour-do').hidden = !step.act;
    element('tour-do').textContent = step.act?.name ?? '';
    element<HTMLButtonElement>('tour-back').disabled = this.at === 0;
    element('tour-next').textContent = this.at + 1 < this.steps.length ? 'Next' : 'Finish';
  }

  /** Call while samples arrive. */
  watch(): void {
    const step = this.steps[this.at];
    if (!step || this.reached) return;
    const pressed = this.page.pressed(), done = step.done();
    const text = step.text + ((!done && this.page.limited() && step.limited) || '');
    if (element('tour-text').textContent !== text) element('tour-text').textContent = text;
    if (!this.touches && pressed > 0.5) this.taps += 1;
    this.touches = this.touches ? pressed > 0.1 : pressed > 0.5;
    if (!done) return;
    this.reached = true;
    element('tour').classList.add('done');
    element('tour-step').textContent += ' ✓';
  }
}
