import 'uplot/dist/uPlot.min.css';
import './style.css';

import { connect, Layout, type Connection, type Introduction, type Network, type Told, type Vec } from './channel';
import { isSolid, viewsFor } from './picture';
import { Plots, type Curve, type PlotSpec } from './plots';
import { element, joules, rotationVector, Session, state, type Kind } from './session';
import { Sound } from './sound';
import { Tour } from './tour';

const MODES = ['no partner', 'coupled', 'holding', 'released', 'waiting for a hand', 'stopped', 'ended'];
const ENDED = 6;
const OLD_MS = 300; // a value of this age looks old
const LIMIT_SHOWN_MS = 1000;
const LIMIT_WORDS: Record<string, string> = {
  'force': 'force or torque at the own hardware',
  'force rate': 'its change',
  'power': 'power into the own hardware',
  'speed': 'the hardware is too fast',
  'set point step': "change of the robot's set point in a tick",
  'workspace': 'hardware or set point is beyond it',
  'peer motion': 'position or velocity that the other side reports',
  'peer force': 'force that the other side reports',
  'peer energy': 'energy that the other side reports',
  'pause': 'this side has stood still, and the coupling began anew',
};
const FIGURE_WORDS: Record<string, string> = {
  contact_spring_share: "Share of the spring in all axes in the master's model of the contact; 0 without such a model",
};
const PRESS_N = 0.5, MUTED_SHARE = 0.1, MUTED_FOR_S = 1; // a press of which next to nothing is felt
const HOME_M_PER_S = 0.12; // and faster where it is far:
const HOME_S = 1.5;
const HOME_PATIENCE_S = 1.5, HOME_REST_S = 0.5;
const HOME_AIMS = 6; // tools of two arms do not move alike, and something may keep the robot away
const FAR_M = 0.1;
const AT_HOME_M = 0.002, AT_HOME_RAD = 0.02, AT_REST_M_PER_S = 0.002;
const SETTLE_PATIENCE_S = 4;
const PLOT_EVERY = 4; // samples
const REACH_M = 0.5;
const ADJUSTABLE = 1; // environment_answer
const OUT_OF_RANGE = 6;
const REAL = 2;

/** A value with its unit; the number itself stays readable to programs. */
function show(id: string, value: number, digits: number, unit: string): void {
  const out = element(id);
  out.textContent = Number.isFinite(value) ? `${value.toFixed(digits)} ${unit}` : '–';
  out.dataset.value = String(value);
}
/** The number is in millijoules. */
function showEnergy(id: string, j: number): void {
  show(id, 1e3 * j, 3, 'mJ');
  if (Number.isFinite(j)) element(id).textContent = joules(j);
}
const seconds = (ms: number): string => `${(ms / 1000).toFixed(1)} s`;

class Page {
  private scene: Introduction | null = null;
  private figures: Introduction['layer_figures'] = [];
  private layout = new Layout([]);
  private sessions: Session[] = []; // the first one, and the one that it is compared with
  private comparing: number | null = null; // method of the second
  private plots: Plots | null = null;
  private readonly sound = new Sound();
  private readonly channel: Connection;
  private connected = false;
  private fresh = true; // nothing of this page has been sent since the introduction
  private receivedAt = -Infinity; // newest samples [ms]
  private limitsSeen: { at: number; bit: number }[] = [];
  private tour: Tour | null = null;
  private toured = ''; // of which scene
  private homing: 'taking' | 'robot' | 'handle' | null = null;
  private homeTo: Vec = [0, 0, 0]; // of the target
  private homeAt_m_per_s = 0;
  private homeFor_s = 0; // the target has been there, or the handle is taken
  private aims = 0;
  private settling: { delay_ms: number; method: number; for_s: number; stage: 'home' | 'rest' | 'set' } | null = null;

  private held = false;
  private target: Vec = [0, 0, 0];
  private turn: Vec = [0, 0, 0];

  private samples = 0;
  private surface = 0; // whose stiffness and friction the sliders show
  private surfaceTouchedAt = -Infinity; // [ms]
  private material = { stiffness: NaN, friction: 0 }; // of that surface, as asked for or as the slave says
  private axis = 0;
  private latest: { at: number; late: number }[] = [];
  private lossWindow: { at: number; received: number; lost: number }[] = [];
  private recording: string[] | null = null;

  constructor() {
    this.channel = connect({
      introduction: (i) => this.begin(i),
      told: (t) => this.hear(t),
      samples: (numbers) => this.take(numbers),
      state: (connected) => {
        this.connected = connected;
        if (!connected) this.letGo();
        this.ages();
      },
    });
    window.setInterval(() => this.ages(), 100);
    element('take').onclick = () => this.channel.send('take');
    element('home').onclick = () => this.goHome();
    element('fit').onclick = () => this.fit();
    element('reset').onclick = () => (this.comparing === null ? this.channel.send('restart') : void this.compareWith(this.comparing));
    element('sound').onclick = () => element('sound').setAttribute('aria-pressed', String(this.sound.toggle()));
    element('tour-begin').onclick = () => this.tour?.go(0);
    element('let-go').onclick = () => this.letGo();
    element('pause').onclick = () => this.pause();
    element('record').onclick = () => this.record();
    document.addEventListener('visibilitychange', () => document.hidden && this.letGo());
    window.addEventListener('pagehide', () => this.letGo());
    window.addEventListener('blur', () => this.letGo());
    window.addEventListener('keydown', (e) => e.key === 'Escape' && this.letGo());
    this.takeClutch();
    this.takePointer(element('picture'), 0);
    this.takePointer(element('second-picture'), 1);
    let frame = 0;
    const loop = (): void => {
      this.frame(frame++);
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  private get first(): Session | undefined {
    return this.sessions[0];
  }
  private get last(): Float64Array | null {
    return this.first?.last ?? null;
  }

  private fit(): void {
    for (const session of this.sessions) session.fit();
    if (this.first) element<HTMLInputElement>('zoom').value = String(this.first.picture.chosen.scale);
  }

  private begin(scene: Introduction): void {
    this.scene = scene;
    this.layout = new Layout(scene.fields);
    this.fresh = true;
    this.comparing = null;
    this.showSessions();
    element('ended').hidden = true;
    element('reset').hidden = !scene.restarts;
    element('scene').textContent =
      `${scene.scene} · ${scene.leader ? `${scene.joints} joints` : `${scene.dof} DoF`} · ${scene.rate_hz} Hz` +
      (scene.methods.length > 1 ? '' : ` · ${scene.method}, ${scene.architecture}`);
    const zoom = element<HTMLInputElement>('zoom');
    zoom.value = scene.dof !== 6 ? '4000' : scene.arm ? '1000' : '2000';
    const zooms = (): void => this.sessions.forEach((s) => (s.picture.chosen = { ...s.picture.chosen, scale: Number(zoom.value) }));
    zooms();
    this.first!.picture.look(this.first!.picture);
    zoom.oninput = zooms;
    const views = viewsFor(scene), view = element<HTMLSelectElement>('view');
    view.replaceChildren(...views.map((v, i) => new Option(v.name, String(i))));
    view.onchange = () => this.sessions.forEach((s) => (s.picture.view = views[Number(view.value)]!));
    element('view-row').hidden = views.length < 2;

    const axes = scene.dof === 1 ? ['x'] : ['x', 'y', 'z'], axis = element<HTMLSelectElement>('axis');
    axis.replaceChildren(...axes.map((a, i) => new Option(a, String(i))));
    element('axis-row').hidden = axes.length < 2;
    axis.onchange = () => {
      this.axis = Number(axis.value);
      this.makePlots();
    };
    // Of two arms along the wall's normal, where the forces are.
    const normal = scene.leader ? scene.environment.find((e) => e.kind === 'wall')?.normal : undefined;
    this.axis = normal ? normal.findIndex((n) => Math.abs(n) === Math.max(...normal.map(Math.abs))) : 0;
    axis.value = String(this.axis);
    this.makePlots();
    this.makeSliders(scene);
    this.makeWorkControls(scene);
    element('motors').textContent = this.notDisplayed(scene);
    element('motors').hidden = scene.without_motor.length === 0;
    const leftOut = [scene.arm, scene.leader].flatMap((arm) => arm?.left_out ?? []), more = leftOut.length - 2;
    element('hint').textContent = [this.hint(scene), ...leftOut.slice(0, 2), ...(more > 0 ? [`So ${more === 1 ? 'is another link' : `are ${more} other links`}.`] : [])].join(' ');
    for (const row of document.querySelectorAll<HTMLElement>('.linked'))
      row.hidden = !scene.linked;
    if (scene.leader) element('work-controls').hidden = true; // it couples joints wherever they are
    if (scene.leader || this.channel.compare) element('sensor-controls').hidden = true; // torques of joints; a sensor that does not drift
    this.makeLayerFigures(scene);
    for (const id of ['let-go', 'home']) element(id).hidden = !scene.pointer;
    element('late-row').hidden = this.channel.compare !== undefined; // its time is that of the frames
    this.makeTour(scene);
    this.makeComparison(scene);
    this.obey();
  }

  /** A row for each figure of the layers. */
  private makeLayerFigures(scene: Introduction): void {
    for (const row of document.querySelectorAll('.layer-figure')) row.remove();
    this.figures = scene.layer_figures.filter(([, , dof]) => scene.linked && scene.dof >= dof);
    for (const [name] of this.figures) {
      const title = name[0]!.toUpperCase() + name.slice(1).replaceAll('_', ' ');
      const row = `<div class="layer-figure" title="${FIGURE_WORDS[name] ?? ''}"><dt>${title}</dt><dd><output id="${name}">–</output></dd></div>`;
      element('round-trip-row').insertAdjacentHTML('beforebegin', row);
    }
  }

  /** New sessions, the second one where methods are compared. */
  private showSessions(): void {
    const before = this.first, pair = this.comparing !== null;
    for (const session of this.sessions) session.picture.dispose();
    element('pictures').classList.toggle('pair', pair);
    element('second').hidden = !pair;
    element('first-caption').hidden = !pair;
    this.sessions = (pair ? ['picture', 'second-picture'] : ['picture']).map((id) => new Session(this.scene!, this.layout, element(id)));
    for (const { picture } of this.sessions) if (before?.scene === this.scene) picture.look(before!.picture);
    this.plots?.clear();
  }

  /** The choice of a second method, with a robot of its own beside the first. */
  private makeComparison(scene: Introduction): void {
    const choice = element<HTMLSelectElement>('compare');
    element('compare-row').hidden = !this.channel.compare || !scene.linked || scene.methods.length < 2;
    choice.replaceChildren(new Option('nothing', ''), ...scene.methods.map((m, i) => new Option(m, String(i))));
    choice.onchange = () => void this.compareWith(choice.value === '' ? null : Number(choice.value));
  }
  private async compareWith(method: number | null): Promise<void> {
    const again = this.comparing !== null && method !== null && method !== this.comparing;
    this.comparing = method;
    if (again) return this.channel.send(`method ${method}`, 1);
    this.letGo();
    const first = element<HTMLSelectElement>('method').value;
    await this.channel.compare!(method === null ? null : { told: (t) => this.hear(t, 1), samples: (numbers) => this.take(numbers, 1) });
    this.showSessions();
    this.sendAll();
    this.channel.send(`method ${first}`, 0);
    if (method !== null) this.channel.send(`method ${method}`, 1);
  }

  private hint(scene: Introduction): string {
    if (!scene.pointer) return `The hand is at: ${scene.device}. Start twoport-master with --device page to move it from here.`;
    if (window.matchMedia('(pointer: coarse)').matches)
      return 'Drag with a finger to move the hand.' + (isSolid(scene) ? ' A second finger turns the view.' : '') + (scene.gripper_m !== null ? ' The slider opens the gripper.' : '');
    const gripper = scene.gripper_m !== null ? ` The gripper: O and C, or the wheel${scene.dof === 1 ? '' : ' with Ctrl'}.` : '';
    if (scene.dof === 1) return 'Drag to move the hand. Keyboard: Space takes and lets go, ← → move.' + gripper;
    if (scene.dof === 3)
      return `Drag to move the hand in the view; the wheel moves it along the view.${isSolid(scene) ? ' The right button turns the view.' : ''} Keyboard: Space, arrows, Page Up and Down.` + gripper;
    return `Drag to move the hand${scene.leader ? ', which holds the tool of the leader,' : ''} in the view, with Shift to turn it; the wheel moves it along the view. The right button turns the view. Keyboard: Space, arrows, Page Up and Down, with Shift to turn.` + gripper;
  }

  /** Of axes of the device that have no motor. */
  private notDisplayed({ without_motor, dof }: Introduction): string {
    const axes = (first: number): string => without_motor.filter((a) => a >= first && a < first + 3).map((a) => (dof === 1 ? 'x' : 'xyz'[a - first])).join(', ');
    const force = axes(0), torque = axes(3);
    const parts = [...(force ? [`force along ${force}`] : []), ...(torque ? [`torque about ${torque}`] : [])];
    return `The device has no motor there: ${parts.join(' and ')} not displayed.`;
  }

  private makeTour(scene: Introduction): void {
    const without = scene.methods.findIndex((m) => m.startsWith(scene.plain_method));
    const wall = scene.environment.find((e) => e.kind === 'wall');
    const possible = scene.pointer && scene.linked && wall && without > 0;
    element('tour-begin').hidden = !possible;
    const step = this.toured === scene.scene ? (this.tour?.at ?? -1) : -1;
    this.toured = scene.scene;
    this.tour = null;
    element('tour').hidden = true;
    if (!possible) return;
    const number = (name: string): number => (this.last ? this.last[this.layout.place(name)]! : 0);
    const { right, up } = viewsFor(scene)[0]!, along = (axis: Vec): number => -wall.normal!.reduce((sum, n, i) => sum + n * axis[i]!, 0);
    const [x, y] = [along(right), along(up)];
    this.tour = new Tour({
      wall: wall.normal![2] > 0.9 ? 'table' : 'wall',
      muted: () => this.muted,
      toWall: Math.abs(x) > Math.abs(y) ? (x > 0 ? 'to the right' : 'to the left') : y > 0 ? 'up' : 'down',
      limited: () => this.limitsSeen.length > 0,
      felt: () => (this.last ? Math.hypot(...this.first!.vector('felt_n')) : 0),
      pressed: () => (this.last ? Math.hypot(...this.first!.vector('environment_n')) : 0),
      roundTrip: () => number('round_trip_ms'),
      told: () => this.first!.told,
      method: () => number('epoch') % scene.methods.length,
      without,
      names: scene.methods,
      held: () => this.held,
      begin: (delay_ms, method) => this.settle(delay_ms, method),
      begun: () => this.settling === null,
    });
    if (step >= 0) this.tour.go(step); // the programs have started again, or the page has lost them for a while
  }

  // Who controls, and what is said of the run.

  private hear(told: Told, which = 0): void {
    const session = this.sessions[which];
    if (!session) return;
    session.told = told;
    if (which > 0) return;
    if (told.end !== null) {
      const summary = told.end.replace(/^(\w+): \1: /i, '$1: ');
      element('ended').textContent =
        this.scene!.pointer && /hand (moves to the end|rests is not known)/.test(summary)
          ? `The run is over${/interrupted/.test(summary) ? ', interrupted' : ''}: ${told.verdict}. The summary says UNDECIDED: it knows the rests of a scene's own hand only.`
          : `The run is over. ${summary}.`;
      element('ended').hidden = false;
    }
    this.obey();
  }
  /** Of a page that watches, the controls rest; one that has just been loaded begins with the scene's own values. */
  private obey(): void {
    const told = this.first?.told, controls = (told?.controls ?? true) && (told?.end ?? null) === null;
    element('watching').hidden = (told?.controls ?? true) || !this.connected;
    for (const set of document.querySelectorAll<HTMLFieldSetElement>('fieldset.command')) set.disabled = !controls;
    for (const id of ['let-go', 'home', 'reset', 'tour-begin', 'tour-do']) element<HTMLButtonElement>(id).disabled = !controls;
    if (!controls || !this.fresh || !this.scene) return;
    this.fresh = false;
    this.sendAll();
  }
  private sendAll: () => void = () => {};

  /** Colours what is old: by the page's own clock, so that a program that stands still looks so. */
  private ages(): void {
    const silent = performance.now() - this.receivedAt;
    const old = !this.connected || silent > OLD_MS, over = (this.first?.told.end ?? null) !== null;
    if (!this.connected)
      state(element('connection'), over ? 'the run is over' : 'no connection', over ? 'old' : 'bad');
    else if (old && Number.isFinite(silent)) state(element('connection'), over ? 'the run is over' : `master silent for ${seconds(silent)}`, over ? 'old' : 'bad');
    else state(element('connection'), 'connected', 'good');
    const number = (name: string): number => (this.last ? this.last[this.layout.place(name)]! : -1);
    const report = this.scene?.linked ? number('report_age_ms') : 0;
    const ofRobot = report < 0 ? Infinity : report + (old ? silent : 0);
    const robotOld = old || ofRobot > OLD_MS;
    const note = Number.isFinite(ofRobot) ? `robot as it was ${seconds(ofRobot)} ago` : 'no report of the robot yet';
    this.age = { old, robotOld, robotNote: robotOld && !over ? note : '' };
    for (const row of document.querySelectorAll<HTMLElement>('#values > div')) {
      const slaves = row.classList.contains('of-slave'), age = slaves ? ofRobot : silent, is = slaves ? robotOld : old;
      row.classList.toggle('old', is);
      const dd = row.querySelector('dd')!;
      if (is && !over && Number.isFinite(age) && dd.textContent !== '–') dd.dataset.age = seconds(age);
      else delete dd.dataset.age;
    }
    if (!this.last || !this.scene) return;
    const kind = (m: string): Kind => (m === 'coupled' ? 'good' : m === MODES[0] || m === MODES[4] ? '' : 'bad');
    const mode = MODES[number('mode')] ?? '?', slave = MODES[number('slave_mode')] ?? '?';
    state(element('mode'), old ? '' : `master: ${mode}`, kind(mode));
    const silence = number('silence_ms'), comesLate = silence >= 0 && silence < OLD_MS && number('slave_mode') !== ENDED;
    const silentSlave = !Number.isFinite(ofRobot) ? 'slave: no report yet'
      : slave === MODES[ENDED] ? 'slave: ended' : `slave: ${comesLate ? 'reports too old' : 'no report'} for ${seconds(ofRobot)}`;
    state(element('slave-mode'), old || !this.scene.linked ? '' : robotOld ? silentSlave : `slave: ${slave}`, robotOld ? 'bad' : kind(slave));
    const held = number('held') === 1;
    state(element('held'), old || !this.scene.pointer ? '' : held ? 'handle held' : 'handle free', held ? 'good' : '');
    state(element('clutched'), old ? '' : (['', 'clutched', 're-homing'][number('clutched')] ?? ''), 'warn');
    this.first!.badge(element('verdict'), old);
    const now = performance.now();
    this.limitsSeen = this.limitsSeen.filter((l) => l.at > now - LIMIT_SHOWN_MS);
    const names = [...new Set(this.limitsSeen.map((l) => (this.scene!.limits[l.bit] ?? '?').replaceAll('_', ' ')))];
    state(element('limit'), names.length > 0 && !old ? `limit acts: ${names.join(', ')}` : '', 'warn');
    element('limit').title = names.map((name) => `${name}: ${LIMIT_WORDS[name] ?? ''}`).join('; ');
    state(element('muted'), this.muted && !old ? 'press not felt' : '', 'warn');
    element('muted').title = `${this.first!.method().split(",")[0]} holds no press here: less than a tenth of the force on the environment is felt. Other methods may hold it.`;
    this.first!.budget(element('gauge'), element('budget-left'), old);
    element('both-budget').hidden = !this.scene.linked;
    this.first!.bothBudget(element('both-gauge'), element('both-left'), old);
    if (this.comparing !== null) this.sessions.forEach((s, i) => s.last && this.caption(element(i === 0 ? 'first-caption' : 'second-caption'), s, old));
  }
  private age = { old: false, robotOld: false, robotNote: '' };

  /** Method, verdict and budgets above a picture. */
  private caption(out: HTMLElement, session: Session, old: boolean): void {
    const part = (name: string): HTMLElement => out.querySelector<HTMLElement>(`.${name}`)!;
    part('name').textContent = session.method();
    session.badge(part('state'), old);
    session.budget(part('hand').querySelector('.gauge')!, part('hand').querySelector('output')!, old);
    session.bothBudget(part('both').querySelector('.gauge')!, part('both').querySelector('output')!, old);
  }

  /** Moves the robot and then the handle to where they were at the beginning, and lets go there. */
  private goHome(): void {
    this.grab();
    this.homing = this.held ? 'taking' : null;
    this.homeFor_s = 0;
  }
  private get coupled(): boolean {
    return [this.first!.number('mode'), this.first!.number('slave_mode')].every((m) => MODES[m] === 'coupled');
  }
  private handleFromHome(): Vec {
    return this.first!.vector('handle_x_m').map((x, i) => x - this.scene!.home_m[i]!) as Vec;
  }
  /** Of a real robot nobody knows where it began; the handle's place then. */
  private robotFromHome(): Vec {
    if (!this.scene!.linked || this.first!.number('environment_answer') === REAL) return this.handleFromHome();
    return this.first!.vector('robot_x_m').map((x, i) => x - this.scene!.robot_home_m[i]!) as Vec;
  }
  private homeBy(m: Vec, turn: Vec): void {
    this.homeTo = this.target.map((x, i) => Math.max(-REACH_M, Math.min(REACH_M, x + m[i]!))) as Vec;
    this.turn = turn;
    this.homeAt_m_per_s = Math.max(HOME_M_PER_S, Math.hypot(...m) / HOME_S);
    this.homeFor_s = 0;
  }
  private aimRobotHome(): void {
    const { first, scene } = this, share = scene!.motion_scale * first!.number('motion');
    const behind = scene!.linked ? first!.vector('behind_m') : [0, 0, 0];
    this.aims += 1;
    this.homeBy(this.robotFromHome().map((x, i) => (behind[i]! - x) / share) as Vec, first!.turnBack());
  }
  private stepHome(passed_s: number): void {
    const scene = this.scene!, first = this.first!;
    if (this.homing === 'taking') {
      // The sides are coupled from where they are.
      this.homeFor_s += passed_s;
      if (scene.linked && !this.coupled && this.homeFor_s < HOME_PATIENCE_S) return;
      this.homing = 'robot';
      this.aims = 0;
      return this.aimRobotHome();
    }
    const left = this.homeTo.map((x, i) => x - this.target[i]!) as Vec, far = Math.hypot(...left), step = this.homeAt_m_per_s * passed_s;
    this.target = far <= step ? [...this.homeTo] : (this.target.map((x, i) => x + (left[i]! * step) / far) as Vec);
    this.homeFor_s = far <= step ? this.homeFor_s + passed_s : 0;
    if (far > step) return;
    const ofRobot = this.homing === 'robot', off = Math.hypot(...(ofRobot ? this.robotFromHome() : this.handleFromHome()));
    const moves = Math.max(...['hand_v_m_per_s', 'robot_v_m_per_s'].map((v) => Math.hypot(...first.vector(v)))), there = off < AT_HOME_M && moves < AT_REST_M_PER_S;
    if (!there && this.homeFor_s < HOME_REST_S + 1e-3 * Math.max(0, first.number('round_trip_ms'))) return;
    if (!there && ofRobot && this.aims < HOME_AIMS) return this.aimRobotHome();
    if (this.homing === 'robot' && scene.linked && !scene.leader && this.handleIsOff()) {
      this.homing = 'handle';
      this.clutch(true);
      return this.homeBy(scene.home_m.map((x, i) => x - this.target[i]!) as Vec, [0, 0, 0]);
    }
    this.clutch(false);
    this.letGo();
  }
  private handleIsOff(): boolean {
    return Math.hypot(...this.handleFromHome()) > AT_HOME_M || Math.hypot(...rotationVector(this.first!.attitude('handle_attitude'))) > AT_HOME_RAD;
  }

  /** Brings everything to where it was at the beginning, and sets a delay of each direction and a method when that is done. */
  private settle(delay_ms: number, method: number): void {
    this.settling = { delay_ms, method, for_s: 0, stage: 'home' };
    this.calm();
  }
  /** Without the page's delay, under the first method, with the scene's hand and surfaces. */
  private calm(): void {
    const scene = this.scene!;
    for (const input of document.querySelectorAll<HTMLInputElement>('#network input')) input.value = '0';
    const both = element<HTMLInputElement>('both');
    if (!both.checked) both.click();
    element<HTMLInputElement>('grip').value = String(scene.grip_n_per_m);
    this.sendAll();
    this.channel.send('method 0', 0);
    this.channel.send('lock 0');
    this.channel.send('scale 1 1');
    this.workTouchedAt = -Infinity;
    if (this.last && this.first!.number('environment_answer') === ADJUSTABLE)
      scene.environment.filter((e) => e.kind !== 'spring').forEach((e, i) => this.channel.send(`surface ${i} ${e.stiffness_n_per_m} ${e.friction ?? 0}`));
    this.surfaceTouchedAt = -Infinity;
  }
  private stepSettling(passed_s: number): void {
    const s = this.settling!;
    if (this.homing) return;
    if (s.stage === 'home') {
      s.stage = 'rest';
      // Tools of two arms are far from alike there.
      const { leader, restarts } = this.scene!;
      if (leader && restarts && Math.hypot(...this.robotFromHome(), ...this.handleFromHome()) > FAR_M) return this.channel.send('restart');
      if (this.coupled || this.handleIsOff() || Math.hypot(...this.robotFromHome()) > AT_HOME_M) return this.goHome();
    }
    s.for_s += passed_s;
    const first = this.first!, mode = first.number('mode'), late = s.for_s > SETTLE_PATIENCE_S;
    if (s.stage === 'rest') {
      // A free handle that is still coupled would be moved by another delay or method.
      if (!late && !this.held && this.scene!.linked && this.coupled && (s.delay_ms > 0 || s.method > 0)) return;
      const input = element<HTMLInputElement>('to_slave-delay_ms');
      input.value = String(s.delay_ms);
      input.dispatchEvent(new Event('input'));
      this.channel.send(`method ${s.method}`, 0);
      this.settling = { ...s, for_s: 0, stage: 'set' };
      return;
    }
    // A delay that jumps parts the sides for a moment.
    const there = mode === first.number('slave_mode') && ['coupled', 'waiting for a hand'].includes(MODES[mode]!) && first.number('round_trip_ms') >= 2 * s.delay_ms;
    if (there || late) this.settling = null;
  }

  private makePlots(): void {
    const at = (name: string): number => this.layout.place(name), i = this.axis, name = ['x', 'y', 'z'][i]!;
    const scale = (this.scene?.motion_scale ?? 1) * 1e3;
    const curve = (label: string, colour: string, place: number, factor: number, absent = -Infinity): Curve => ({
      label,
      colour,
      value: (s) => (s[place]! <= absent ? null : factor * s[place]!),
    });
    const plot = (title: string, unit: string, ...curves: Curve[]): PlotSpec => ({ title, unit, curves });
    const { leader } = this.scene!;
    /** A curve for each joint; a prismatic one has another unit than the plot's. */
    const torques = (field: string): Curve[] =>
      leader!.joints.map(({ slides }, j) => curve(`${j + 1}${slides ? ' [N]' : ''}`, `--joint-${j + 1}`, at(field) + j, 1));
    const hand: Curve = { label: leader ? 'leader' : 'hand', colour: '--hand', value: (s) => scale * s[at('hand_x_m') + i]! + 1e3 * this.first!.origin[i]! };
    const specs = [
      plot(`Position ${name}`, 'mm', hand, curve(leader ? 'follower' : 'robot', '--robot', at('robot_x_m') + i, 1e3)),
      plot(`Force ${name}`, 'N',
        curve('wanted', '--third', at('unlimited_n') + i, 1),
        curve('on the environment', '--robot', at('environment_n') + i, 1),
        curve('felt', '--felt', at('felt_n') + i, 1)),
      ...(leader ? [plot('Torque displayed, by joint', 'N\u00a0m', ...torques('leader_torque')), plot('Torque measured, by joint', 'N\u00a0m', ...torques('follower_torque'))] : []),
      plot('Energy', 'mJ',
        { label: 'in at the hand', colour: '--hand', value: (s) => 1e3 * (s[at('hand_energy_j')]! + this.first!.told.earlier_debt_j) },
        curve('in at the robot', '--robot', at('robot_energy_j'), 1e3),
        curve('dissipated', '--felt', at('dissipated_j'), 1e3),
        curve('not dissipated yet', '--third', at('deficit_j'), 1e3)),
      plot('Gripper', 'mm', curve('handle', '--hand', at('gripper_hand_m'), 1e3), curve('fingers', '--robot', at('gripper_robot_m'), 1e3)),
      plot('Force at the gripper', 'N', curve('on the object', '--robot', at('gripper_object_n'), -1), curve('felt', '--felt', at('gripper_felt_n'), 1)),
      plot('Energy at the gripper', 'mJ', curve('in at the hand', '--hand', at('gripper_energy_j'), 1e3)),
      plot('Round trip', 'ms', curve('round trip', '--hand', at('round_trip_ms'), 1, -1e-9)),
      plot('Wake-up latency', 'µs', curve('latency', '--hand', at('late_us'), 1)),
    ];
    this.plots = new Plots(element('plots'), specs.filter(
      (s) =>
        (this.scene?.linked || s.title !== 'Round trip') && (this.scene?.gripper_m != null || !/gripper/i.test(s.title)) &&
        !(this.channel.compare && s.title === 'Wake-up latency'),
    ));
  }

  private makeSliders(scene: Introduction): void {
    const hand = element('hand-controls');
    hand.hidden = !scene.pointer;
    const grip = element<HTMLInputElement>('grip');
    [grip.min, grip.max] = scene.grip_limits_n_per_m.map(String) as [string, string];
    grip.value = String(scene.grip_n_per_m);
    const tellGrip = (): string => (element('grip-value').textContent = `${grip.value} N/m`);
    const sendGrip = (): void => {
      tellGrip();
      this.channel.send(`grip ${grip.value}`);
    };
    grip.oninput = sendGrip;
    tellGrip();

    for (const row of document.querySelectorAll<HTMLElement>('.gripper')) row.hidden = scene.gripper_m === null;
    const opening = element<HTMLInputElement>('opening'), start = scene.gripper_m ?? 0;
    opening.max = String(1e3 * (start > 0 ? start : 0.1));
    opening.value = String(1e3 * start);
    opening.oninput = () => this.sendOpening();

    this.makeSurfaceSliders(scene);

    element('network-controls').hidden = !scene.linked;
    const of = (n: Network): string =>
      n.delay_ms + n.jitter_ms + n.loss > 0 ? `${n.delay_ms} ± ${n.jitter_ms} ms, ${(100 * n.loss).toFixed(1)} % loss` : 'none';
    element('scene-network').textContent =
      `Delay and loss of the scene: to the slave ${of(scene.to_slave)}, to the master ${of(scene.to_master)}.`;
    const both = element<HTMLInputElement>('both');
    const limits = scene.network_limits;
    const rows: { key: keyof Network; name: string; most: number; step: number; unit: string; factor: number }[] = [
      { key: 'delay_ms', name: 'Delay', most: limits.delay_ms, step: 1, unit: 'ms', factor: 1 },
      { key: 'jitter_ms', name: 'Jitter, s.d.', most: limits.jitter_ms, step: 0.5, unit: 'ms', factor: 1 },
      { key: 'loss', name: 'Loss', most: 100 * limits.loss, step: 1, unit: '%', factor: 0.01 },
    ];
    const directions = ['to_slave', 'to_master'] as const;
    const sliders = (direction: string): string =>
      rows.map((r) => `<label class="slider"><span>${r.name}</span><input id="${direction}-${r.key}" type="range" min="0" max="${r.most}" step="${r.step}" value="0"><output></output></label>`).join('');
    element('network').innerHTML = directions.map((direction) => `<div class="direction"><b></b>${sliders(direction)}</div>`).join('');
    const boxes = [...document.querySelectorAll<HTMLElement>('#network .direction')];
    const inputs = boxes.map((box) => [...box.querySelectorAll('input')]);
    const tell = (d: number): void => boxes[d]!.querySelectorAll('output').forEach((out, i) => (out.textContent = `${inputs[d]![i]!.value} ${rows[i]!.unit}`));
    const send = (d: number): void => {
      const words = rows.map((row, i) => Number(inputs[d]![i]!.value) * row.factor);
      this.channel.send(`network ${directions[d]} ${words.join(' ')}`);
      tell(d);
    };
    inputs.forEach((list, d) => list.forEach((input, i) => (input.oninput = () => {
      if (both.checked) inputs[1 - d]![i]!.value = input.value;
      send(d);
      if (both.checked) send(1 - d);
    })));
    const arrange = (): void => {
      boxes[1]!.hidden = both.checked;
      boxes[0]!.querySelector('b')!.textContent = both.checked ? 'Each direction' : 'To the slave';
      boxes[1]!.querySelector('b')!.textContent = 'To the master';
    };
    both.onchange = () => {
      arrange();
      if (!both.checked) return;
      inputs[0]!.forEach((input, i) => (inputs[1]![i]!.value = input.value));
      send(1);
    };
    arrange();
    tell(0);
    tell(1);
    this.sendAll = () => {
      send(0);
      send(1);
      sendGrip();
      this.sendOpening();
    };

    element('method-controls').hidden = scene.methods.length < 2;
    const method = element<HTMLSelectElement>('method');
    method.replaceChildren(...scene.methods.map((m, i) => new Option(m, String(i))));
    method.onchange = () => this.channel.send(`method ${method.value}`, 0);
  }

  // Clutch, locks and scales.

  private clutching = false; // this page holds the clutch pressed
  private workTouchedAt = -Infinity; // [ms]

  private clutch(pressed: boolean): void {
    if (pressed === this.clutching) return;
    this.clutching = pressed;
    this.channel.send(`clutch ${pressed ? 1 : 0}`);
  }
  /** A release that nobody sees, as of a key while another window has the focus, leaves it pressed: the robot stays. */
  private takeClutch(): void {
    const button = element('clutch');
    button.addEventListener('pointerdown', (e) => {
      e.preventDefault(); // the picture keeps the focus, and with it the handle
      button.setPointerCapture(e.pointerId);
      this.clutch(true);
    });
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture'] as const) button.addEventListener(name, () => this.clutch(false));
    button.addEventListener('contextmenu', (e) => e.preventDefault()); // a long touch
    const of = (e: KeyboardEvent): boolean => e.key.toLowerCase() === 'x' && !e.ctrlKey && !e.altKey && !e.metaKey;
    const pressing = (e: KeyboardEvent): boolean => of(e) || ((e.key === ' ' || e.key === 'Enter') && e.target === button);
    window.addEventListener('keydown', (e) => {
      if (!pressing(e)) return;
      e.preventDefault();
      if (!e.repeat && !element('work-controls').hidden) this.clutch(true);
    });
    window.addEventListener('keyup', (e) => pressing(e) && this.clutch(false));
    element('rehome').onclick = () => this.channel.send('rehome');
    element('zero').onclick = () => this.channel.send('zero');
    for (const id of ['rehome', 'zero']) element(id).addEventListener('pointerdown', (e) => e.preventDefault());
  }
  private makeWorkControls(scene: Introduction): void {
    this.clutching = false;
    this.workTouchedAt = -Infinity;
    const names = ['x', 'y', 'z', 'about x', 'about y', 'about z'].slice(0, scene.dof);
    element('locks').innerHTML = names.map((name) => `<label class="check"><input type="checkbox">lock ${name}</label>`).join('');
    const boxes = [...document.querySelectorAll<HTMLInputElement>('#locks input')];
    for (const box of boxes)
      box.onchange = () => {
        this.workTouchedAt = performance.now();
        this.channel.send(`lock ${boxes.reduce((sum, b, i) => sum + (b.checked ? 2 ** i : 0), 0)}`);
      };
    const motion = element<HTMLInputElement>('motion'), force = element<HTMLInputElement>('force');
    motion.oninput = force.oninput = () => {
      this.workTouchedAt = performance.now();
      this.tellScales();
      this.channel.send(`scale ${Number(motion.value) / 100} ${Number(force.value) / 100}`);
    };
  }
  private tellScales(): void {
    for (const id of ['motion', 'force']) element(`${id}-value`).textContent = `${element<HTMLInputElement>(id).value} %`;
  }
  /** What the master has: the controls follow, but for a second after they were used here. */
  private followWork(): void {
    const number = (name: string): number => this.first!.number(name);
    element('clutch').setAttribute('aria-pressed', String(number('clutched') === 1));
    if (performance.now() - this.workTouchedAt < 1000) return;
    document.querySelectorAll<HTMLInputElement>('#locks input').forEach((box, i) => (box.checked = ((number('locked') >> i) & 1) === 1));
    for (const id of ['motion', 'force']) element<HTMLInputElement>(id).value = String(Math.round(100 * number(id)));
    this.tellScales();
  }

  // The environment.

  private makeSurfaceSliders(scene: Introduction): void {
    const surfaces = scene.environment.filter((e) => e.kind !== 'spring').slice(0, this.layout.count('surface_friction'));
    const same = (e: { kind: string }): number => surfaces.filter((o) => o.kind === e.kind).length;
    const choice = element<HTMLSelectElement>('surface');
    choice.replaceChildren(
      ...surfaces.map((e, i) => new Option(same(e) > 1 ? `${e.kind} ${surfaces.slice(0, i + 1).filter((o) => o.kind === e.kind).length}` : e.kind, String(i))),
    );
    this.surface = 0;
    choice.onchange = () => {
      this.surface = Number(choice.value);
      this.surfaceTouchedAt = -Infinity;
    };
    element('surface-row').hidden = surfaces.length < 2;
    element('surface-controls').hidden = surfaces.length === 0;
    const stiffness = element<HTMLInputElement>('stiffness'), friction = element<HTMLInputElement>('friction');
    // Logarithmic.
    const most = Math.max(20000, ...surfaces.map((e) => e.stiffness_n_per_m ?? 0));
    stiffness.min = String(Math.log10(50));
    stiffness.max = String(Math.log10(Math.min(most, scene.surface_limits.stiffness_n_per_m)));
    friction.max = String(Math.min(1.5, scene.surface_limits.friction));
    const send = (): void => {
      this.surfaceTouchedAt = performance.now();
      this.showSurface();
      if (this.material.stiffness > 0) this.channel.send(`surface ${this.surface} ${this.material.stiffness} ${this.material.friction}`);
    };
    stiffness.oninput = () => {
      this.material.stiffness = Number((10 ** Number(stiffness.value)).toPrecision(3));
      send();
    };
    friction.oninput = () => {
      this.material.friction = Number(friction.value);
      send();
    };
  }
  /** The sliders' values in words. */
  private showSurface(): void {
    const text = `${Number(this.material.stiffness.toPrecision(3))} N/m`;
    element('stiffness-value').textContent = text;
    element('stiffness').setAttribute('aria-valuetext', text);
    const friction = element<HTMLInputElement>('friction');
    element('friction-value').textContent = friction.disabled ? '–' : Number(friction.value).toFixed(2);
  }
  /** What the slave says of its environment: the sliders follow, but for a second after they were moved here. */
  private followEnvironment(): void {
    const scene = this.scene!, at = (name: string): number => this.last![this.layout.place(name)]!;
    const answer = at('environment_answer'), adjustable = answer === ADJUSTABLE || answer === OUT_OF_RANGE;
    const note = scene.linked
      ? (scene.environment_answers[answer] ?? '')
      : 'Without a link the environment is a part of the controller, and cannot be changed while it runs.';
    const said = element('environment-note');
    if (said.textContent !== note) said.textContent = note;
    said.hidden = note === '';
    const stiffness = element<HTMLInputElement>('stiffness'), friction = element<HTMLInputElement>('friction');
    const place = (name: string): number => this.last![this.layout.place(name) + this.surface]!;
    const has = place('surface_friction') >= 0;
    stiffness.disabled = !adjustable;
    friction.disabled = !adjustable || !has;
    element('friction-note').hidden = !adjustable || has;
    element('friction-note').textContent = scene.dof === 1 ? 'One axis has no friction.' : 'A wall with viscous friction has no other.';
    const value = adjustable ? place('surface_stiffness_n_per_m') : (scene.environment.filter((e) => e.kind !== 'spring')[this.surface]?.stiffness_n_per_m ?? NaN);
    if (performance.now() - this.surfaceTouchedAt > 1000 && Number.isFinite(value) && value > 0) {
      this.material = { stiffness: value, friction: Math.max(0, place('surface_friction')) };
      stiffness.value = String(Math.log10(value));
      friction.value = String(this.material.friction);
      this.showSurface();
    }
    stiffness.dataset.there = String(value);
    friction.dataset.there = String(place('surface_friction'));
    showEnergy('environment-energy', at('environment_energy_j'));
    const drift = at('sensor_drift_n'), zeroNote = at('zero_asked') === 1 ? 'asked; hold still and touch nothing for 0.5 s' : (scene.zero_answers[at('zero_answer')] ?? '');
    element('sensor-drift').textContent = drift < 0 ? '–' : `${drift.toFixed(2)} N`;
    if (element('zero-note').textContent !== zeroNote) element('zero-note').textContent = zeroNote;
  }

  // The hand.

  /** The opening that the hand intends at the gripper. */
  private sendOpening(): void {
    const mm = element<HTMLInputElement>('opening').value;
    element('opening-value').textContent = `${mm} mm`;
    if (this.scene?.pointer && this.scene.gripper_m !== null) this.channel.send(`opening ${(1e-3 * Number(mm)).toFixed(6)}`);
  }
  private openBy(mm: number): void {
    const opening = element<HTMLInputElement>('opening');
    opening.value = String(Number(opening.value) + mm);
    this.sendOpening();
  }

  private grab(): void {
    this.stay();
    if (!this.scene?.pointer || !this.last || this.held) return;
    // Who watches and takes the handle asks for control; the server grants it while nobody holds the handle.
    this.held = true;
    this.target = this.first!.vector('handle_x_m');
    this.turn = rotationVector(this.first!.attitude('handle_attitude'));
    element('pictures').classList.add('held');
    this.sendTarget();
    this.sendOpening(); // another page may have set it meanwhile
  }
  /** Ends the way home. */
  private stay(): void {
    if (this.homing === 'handle') this.clutch(false);
    this.homing = null;
  }
  letGo(): void {
    this.stay();
    if (!this.held) return;
    this.held = false;
    element('pictures').classList.remove('held');
    this.channel.send('release');
  }
  private sendTarget(): void {
    this.channel.send(`target ${[...this.target, ...this.turn].map((x) => x.toFixed(6)).join(' ')}`);
  }
  private move(dx: number, dy: number, depth: number, turning: boolean): void {
    if (!this.held || !this.first || !this.scene) return;
    const picture = this.first.picture, { right, up, out } = picture.view;
    if (turning && this.scene.dof === 6) {
      // To the right turns about the upward axis, upward about the axis to the left; 300 pixels are one radian.
      const most = 1.5;
      this.turn = this.turn.map((x, i) =>
        Math.max(-most, Math.min(most, x + (dx * up[i]! + dy * right[i]! + depth * out[i]!) / 300)),
      ) as Vec;
    } else {
      const by = picture.displacement(dx, dy);
      this.target = this.target.map((x, i) => {
        const moved = x + (by[i]! + (depth * out[i]!) / picture.scale) / this.scene!.motion_scale;
        return Math.max(-REACH_M, Math.min(REACH_M, moved));
      }) as Vec;
    }
  }

  /** The hand follows the first pointer. In six axes the secondary button, or a second finger, turns the view. */
  private takePointer(box: HTMLElement, which: number): void {
    let at: [number, number] | null = null, looking: { id: number; x: number; y: number } | null = null;
    box.addEventListener('contextmenu', (e) => e.preventDefault());
    box.addEventListener('pointerdown', (e) => {
      box.setPointerCapture(e.pointerId);
      if (e.button === 2 || at) {
        looking = { id: e.pointerId, x: e.clientX, y: e.clientY };
      } else if (e.button === 0) {
        at = [e.clientX, e.clientY];
        this.grab();
      }
    });
    box.addEventListener('pointermove', (e) => {
      if (e.pointerId === looking?.id) {
        if (this.scene && isSolid(this.scene)) for (const { picture } of this.sessions) picture.orbit(e.clientX - looking.x, e.clientY - looking.y);
        looking = { id: e.pointerId, x: e.clientX, y: e.clientY };
      } else if (at) {
        this.move(e.clientX - at[0], e.clientY - at[1], 0, e.shiftKey);
        at = [e.clientX, e.clientY];
      }
    });
    const end = (e: PointerEvent): void => {
      if (e.pointerId === looking?.id) looking = null;
      else if (at) {
        at = null;
        this.letGo();
      }
    };
    for (const name of ['pointerup', 'pointercancel', 'lostpointercapture'] as const) box.addEventListener(name, end);
    box.addEventListener(
      'wheel',
      (e) => {
        if (!this.held) return;
        e.preventDefault();
        if (this.scene?.gripper_m != null && (e.ctrlKey || this.scene.dof === 1)) this.openBy(-0.02 * e.deltaY);
        else this.move(0, 0, -0.1 * e.deltaY, e.shiftKey);
      },
      { passive: false },
    );
    box.addEventListener('keydown', (e) => {
      const step = 0.001 * (this.sessions[which]?.picture.scale ?? 1000); // 1 mm
      const moves: Record<string, Vec> = {
        ArrowLeft: [-step, 0, 0],
        ArrowRight: [step, 0, 0],
        ArrowUp: [0, -step, 0],
        ArrowDown: [0, step, 0],
        PageUp: [0, 0, step],
        PageDown: [0, 0, -step],
      };
      const by = moves[e.key];
      if (e.key === ' ') {
        e.preventDefault();
        if (e.repeat) return;
        if (this.held) this.letGo();
        else this.grab();
      } else if (e.key === 'o' || e.key === 'c') {
        this.openBy(e.key === 'o' ? 1 : -1);
      } else if (by && this.held) {
        e.preventDefault();
        this.move(by[0], by[1], by[2], e.shiftKey);
      }
    });
    box.addEventListener('blur', () => at === null && this.letGo());
  }

  // Samples.

  private take(numbers: Float64Array, which = 0): void {
    const size = this.layout.size, session = this.sessions[which];
    if (!session || size === 0 || numbers.length % size !== 0) return;
    if (which === 0) this.receivedAt = performance.now();
    for (let at = 0; at < numbers.length; at += size) {
      const sample = numbers.subarray(at, at + size);
      const t = sample[this.layout.place('t_s')]!;
      if (which === 0 && this.last && t < this.last[this.layout.place('t_s')]!) this.plots?.clear();
      const begins = session.last === null;
      session.take(sample);
      if (which > 0) continue;
      if (begins && this.scene!.leader) this.look();
      const limits = sample[this.layout.place('limits')]!;
      for (let bit = 0; limits > 0 && bit < 16; ++bit) if ((limits >> bit) & 1) this.limitsSeen.push({ at: this.receivedAt, bit });
      this.watchPress();
      const late = sample[this.layout.place('late_us')]!;
      this.latest.push({ at: t, late });
      if (this.samples++ % PLOT_EVERY === 0) this.plots?.add(t, sample);
      this.recording?.push(Array.from(sample).join(','));
    }
    if (which > 0) return;
    const now = this.last![this.layout.place('t_s')]!;
    this.latest = this.latest.filter((x) => x.at > now - 1);
  }

  private press = { t: 0, pressed: 0, felt: 0, known_s: 0 }; // means of the last second [N], and when a press was last felt or absent
  private muted = false;
  private watchPress(): void {
    const first = this.first!, t = first.number('t_s'), size = (name: string): number => Math.hypot(...first.vector(name)), p = this.press;
    const now = Math.max(0, Math.min(1, (t - p.t) / MUTED_FOR_S)), share = MUTED_SHARE * this.scene!.force_scale * first.number('force');
    p.pressed += now * (size('environment_n') - p.pressed);
    p.felt += now * (size('felt_n') - p.felt);
    if (!this.coupled || size('environment_n') < PRESS_N || share === 0 || p.felt > share * p.pressed || t < p.t) p.known_s = t;
    p.t = t;
    this.muted = t > p.known_s + MUTED_FOR_S + 1e-3 * Math.max(0, first.number('round_trip_ms'));
  }

  /** Shows both arms from the first frame on. */
  private look(): void {
    const { picture } = this.first!;
    this.first!.draw(null, this.age);
    this.fit();
    picture.look(picture);
  }

  private framed = 0; // [ms]
  private frame(count: number): void {
    const now = performance.now();
    const passed_s = Math.min(0.05, (now - this.framed) / 1000);
    if (this.homing && this.last) this.stepHome(passed_s);
    if (this.settling && this.last) this.stepSettling(passed_s);
    this.framed = now;
    if (this.held) this.sendTarget();
    if (!this.last) return;
    for (const session of this.sessions) session.draw(this.held ? this.target : null, this.age);
    this.sound.follow(this.sessions.filter((s) => s.last).map((s) => s.vector('felt_n')), now);
    if (count % 3 === 0) this.plots?.draw();
    if (count % 6 === 0) this.values();
    this.tour?.watch();
  }

  private values(): void {
    const first = this.first!, number = (name: string): number => first.number(name);
    show('felt', Math.hypot(...first.vector('felt_n')), 2, 'N');
    show('wanted', Math.hypot(...first.vector('unlimited_n')), 2, 'N');
    show('environment', Math.hypot(...first.vector('environment_n')), 2, 'N');
    show('behind', 1e3 * Math.hypot(...first.vector('behind_m')), 2, 'mm');
    show('gripper-hand', 1e3 * number('gripper_hand_m'), 1, 'mm');
    show('gripper-robot', 1e3 * number('gripper_robot_m'), 1, 'mm');
    show('gripper-felt', number('gripper_felt_n'), 2, 'N');
    showEnergy('hand-energy', number('hand_energy_j') + first.told.earlier_debt_j);
    showEnergy('robot-energy', number('robot_energy_j'));
    showEnergy('dissipated', number('dissipated_j'));
    showEnergy('deficit', number('deficit_j'));
    for (const [name, unit] of this.figures)
      if (name.endsWith('_share')) show(name, 100 * number(name), 0, '%');
      else show(name, number(name), 3, unit);
    element('picture').dataset.inView = String(first.inView());
    element('picture').dataset.readable = String(first.picture.readable);
    element('picture').dataset.fromHome = String(1e3 * Math.max(Math.hypot(...this.robotFromHome()), this.scene!.leader ? 0 : Math.hypot(...this.handleFromHome())));
    this.followEnvironment();
    this.followWork();
    const trip = number('round_trip_ms');
    show('round-trip', trip < 0 ? NaN : trip, 1, 'ms');
    show('late', Math.max(...this.latest.map((x) => x.late)), 0, 'µs');
    const now = { at: performance.now(), received: number('received'), lost: number('lost') };
    this.lossWindow.push(now);
    while (this.lossWindow.length > 2 && this.lossWindow[0]!.at < now.at - 2000) this.lossWindow.shift();
    const then = this.lossWindow[0]!, lost = now.lost - then.lost, all = now.received - then.received + lost;
    show('loss', all > 0 ? (100 * lost) / all : NaN, 1, '%');
    show('stale', number('stale'), 0, '');
    const methods = this.scene!.methods;
    if (methods.length > 1) {
      const method = element<HTMLSelectElement>('method'), now = String(number('epoch') % methods.length);
      if (document.activeElement !== method) method.value = now;
    }
  }

  private pause(): void {
    if (!this.plots) return;
    this.plots.paused = !this.plots.paused;
    element('pause').setAttribute('aria-pressed', String(this.plots.paused));
  }

  /** The samples received between two presses, as a file. */
  private record(): void {
    const button = element('record');
    if (!this.recording) {
      this.recording = [this.layout.columns().join(',')];
      button.setAttribute('aria-pressed', 'true');
      button.textContent = 'Stop and save';
      return;
    }
    const link = document.createElement('a');
    link.href = URL.createObjectURL(new Blob([this.recording.join('\n') + '\n'], { type: 'text/csv' }));
    link.download = 'twoport.csv';
    link.click();
    URL.revokeObjectURL(link.href);
    this.recording = null;
    button.setAttribute('aria-pressed', 'false');
    button.textContent = 'Record CSV';
  }
}

new Page();
