// A guided tour: five steps, each a sentence and something to do. A step begins, and what it asks for is done, with hand, robot and surfaces
// as at the beginning of the run. The tour knows the page only through what is here.

import type { Told } from './channel';
import { element } from './session';

export interface Guided {
  toWall: string; // where the hand must go
  wall: string; // what is there, in a word
  muted(): boolean; // does the hand feel next to nothing of a press?
  held(): boolean;
  felt(): number; // [N]
  limited(): boolean; // does a limit act?
  pressed(): number; // force on the environment [N]
  roundTrip(): number; // [ms]
  told(): Told;
  method(): number;
  without: number; // the method without passivity control
  names: string[];
  begin(delay_ms: number, method: number): void; // everything as at the beginning, but for the delay of each direction and the method
  begun(): boolean;
}

interface Step {
  name: string;
  text: string;
  from: [number, number]; // delay [ms] and method
  act?: { name: string; to: [number, number] };
  limited?: string; // said while a limit acts
  muted?: string; // said while the press is not felt
  done(): boolean;
}

const DELAY_MS = 60, PRESSES = 3;

export class Tour {
  private readonly steps: Step[];
  at = -1; // step; negative: none
  private presses = 0; // since the step began
  private touches = false;
  private reached = false;

  constructor(private readonly page: Guided) {
    const cure = page.names[0]!.split(',')[0]!, without = page.without;
    const drag = window.matchMedia('(pointer: coarse)').matches ? 'Drag the hand with a finger' : 'Drag the hand';
    const late = (): boolean => page.roundTrip() > 1.8 * DELAY_MS, bad = (): boolean => ['unstable', 'not passive'].includes(page.told().verdict);
    this.steps = [
      {
        name: `A ${page.wall}.`,
        text: `${drag} ${page.toWall} until the robot presses the ${page.wall}: you move the robot, and the green arrow is its force coming back to you.`,
        from: [0, 0],
        muted: ` ${cure} holds no press here: passive, and next to nothing is felt. Choose another method.`,
        done: () => page.felt() > 1 && page.pressed() > 1,
      },
      {
        name: 'A delay.',
        text: `Delay the network by ${DELAY_MS} ms each way and press again: robot and force now come late.`,
        from: [0, 0],
        act: { name: `Delay ${DELAY_MS} ms`, to: [DELAY_MS, 0] },
        done: () => late() && page.pressed() > 1,
      },
      {
        name: 'No control.',
        text: `Choose NONE, press the ${page.wall} and hold still: the late force pushes at the wrong moment, so the link gives energy to the hand that nobody has put in, and the badge turns red.`,
        from: [DELAY_MS, 0],
        limited: ' Press less: a force at its limit cannot swing.',
        act: { name: 'Choose NONE', to: [DELAY_MS, without] },
        done: () => page.method() === without && bad(),
      },
      {
        name: 'The cure.',
        text: `Choose ${cure} and press the ${page.wall} again over the same delay: it stays calm.`,
        from: [DELAY_MS, without],
        act: { name: `Choose ${cure}`, to: [DELAY_MS, 0] },
        done: () => page.method() === 0 && late() && page.felt() > 1 && page.told().verdict === 'passive',
      },
      {
        name: 'The budget.',
        text: `Press the ${page.wall} and let go, three times, and watch the gauge: the hand is thrown back with what it has put in and, at most, this little energy E(0), up to the mark, however long the delay.`,
        from: [DELAY_MS, 0],
        done: () => this.presses >= PRESSES && !bad(),
      },
    ];
    element('tour-next').onclick = () => this.go(this.at + 1);
    element('tour-back').onclick = () => this.go(this.at - 1);
    element('tour-end').onclick = () => this.go(-1);
    element('tour-do').onclick = () => {
      const act = this.steps[this.at]?.act;
      if (act) this.page.begin(...act.to);
    };
  }

  go(to: number): void {
    this.at = to < this.steps.length ? to : -1;
    this.presses = 0;
    this.touches = false;
    this.reached = false;
    const step = this.steps[this.at], panel = element('tour');
    panel.hidden = !step;
    panel.classList.remove('done');
    if (!step) return;
    this.page.begin(...step.from);
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
    if (!step) return;
    const begun = this.page.begun(), done = begun && (this.reached || step.done());
    const more = (this.page.muted() && step.muted) || (!done && this.page.limited() && step.limited) || '';
    const text = begun ? step.text + more : 'Hand and robot go back to where they began.';
    if (element('tour-text').textContent !== text) element('tour-text').textContent = text;
    if (!begun || this.reached) return;
    if (this.page.pressed() > 0.5) this.touches = true;
    else if (this.touches && !this.page.held() && this.page.pressed() < 0.1) this.presses += 1, (this.touches = false);
    if (!done) return;
    this.reached = true;
    element('tour').classList.add('done');
    element('tour-step').textContent += ' ✓';
  }
}
