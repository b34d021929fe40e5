// One run as it is shown: its newest sample, its picture, its verdict and its budgets of energy. The page has one, and a second one
// beside it where two methods are compared.

import type { Introduction, Layout, Told, Vec } from './channel';
import { Picture, type Attitude, type Shown } from './picture';

const COUPLED = 1;
const ASIDE: Vec = [-0.8, 0.6, 0]; // where a leader stands, from the follower [m]
export type Kind = '' | 'good' | 'bad' | 'warn' | 'old';
const KINDS = { passive: 'good', 'not passive': 'bad', restless: 'warn', unstable: 'bad' } as const;

export function element<T extends HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}
export function state(out: HTMLElement, text: string, kind: Kind = ''): void {
  if (out.textContent !== text) out.textContent = text;
  out.className = `state ${kind}`;
  out.hidden = text === '';
}
export const joules = (j: number): string => (Math.abs(j) >= 1 ? `${j.toFixed(2)}\u00a0J` : `${(1e3 * j).toFixed(2)}\u00a0mJ`);

/** The rotation of an attitude [rad]. */
export function rotationVector([w, ...v]: Attitude): Vec {
  const n = Math.hypot(...v), angle = 2 * Math.atan2(n, w);
  return n > 1e-9 ? (v.map((x) => (x / n) * (angle > Math.PI ? angle - 2 * Math.PI : angle)) as Vec) : [0, 0, 0];
}

/** What may still be got: E(0), up to the mark, and what has been put in. A bar as long as the most of it lately, and words. */
function gauge(bar: HTMLElement, out: HTMLElement, granted: number, energy: number, who: string, old: boolean, anew: boolean): void {
  const left = granted + energy, most = Math.max(granted, left, 0.95 * Number(bar.dataset.most ?? 0)), share = most > 0 ? Math.max(0, left / most) : 1;
  bar.dataset.most = String(most);
  (bar.firstElementChild as HTMLElement).style.width = `${(100 * share).toFixed(1)}%`;
  bar.style.setProperty('--granted', `${most > 0 ? (100 * granted) / most : 0}%`);
  bar.className = `gauge ${left < 0 ? 'spent' : left < 0.3 * granted ? 'low' : ''} ${old ? 'old' : ''}`;
  bar.setAttribute('aria-valuenow', share.toFixed(2));
  out.dataset.value = String(left);
  out.textContent =
    left < 0
      ? `spent: ${who} got ${joules(-left)} beyond it`
      : `${joules(Math.min(left, granted))} of ${joules(granted)} left` + (energy > 0 ? `; ${who} put in ${joules(energy)}${anew ? ' since the method was changed' : ''}` : '');
}

export class Session {
  last: Float64Array | null = null;
  told: Told;
  readonly picture: Picture;
  origin: Vec = [0, 0, 0]; // of the hand's world in the robot's
  private past: { t: number; hand: Vec }[] = [];
  private samples = 0;
  private coupledFor = 0; // samples
  private placed = false; // has a robot been seen?

  constructor(
    readonly scene: Introduction,
    private readonly layout: Layout,
    box: HTMLElement,
  ) {
    this.picture = new Picture(box, scene);
    this.told = {
      controls: true, verdict: 'passive', reason: '', initial_energy_j: scene.initial_energies_j?.[0] ?? 0, earlier_debt_j: 0,
      both_initial_energy_j: -1, both_earlier_debt_j: 0, end: null,
    };
  }

  number(name: string): number {
    return this.last![this.layout.place(name)]!;
  }
  vector(name: string): Vec {
    return this.list(name) as Vec;
  }
  attitude(name: string): Attitude {
    return this.list(name) as Attitude;
  }
  private list(name: string): number[] {
    const at = this.layout.place(name);
    return Array.from(this.last!.subarray(at, at + this.layout.count(name)));
  }
  inRobotWorld(p: Vec): Vec {
    if (this.scene.leader) return p.map((x, i) => x + ASIDE[i]!) as Vec;
    return p.map((x, i) => this.scene.motion_scale * x + this.origin[i]!) as Vec;
  }
  /** The handle's rotation that turns the robot back to how it began. */
  turnBack(): Vec {
    if (!this.scene.linked) return [0, 0, 0];
    const [w, x, y, z] = this.attitude('robot_attitude'), [a, b, c, d] = this.attitude('handle_attitude');
    return rotationVector([w * a + x * b + y * c + z * d, w * b - x * a - y * d + z * c, w * c + x * d - y * a - z * b, w * d - x * c + y * b - z * a]);
  }
  method(): string {
    const { methods, method } = this.scene;
    return methods.length > 1 && this.last ? methods[this.number('epoch') % methods.length]! : method;
  }

  take(sample: Float64Array): void {
    this.last = sample;
    this.samples += 1;
    this.register(this.number('t_s'));
  }
  /** The hand's place in the robot's world: where the robot was told to be, against the hand a round trip ago. */
  private register(t: number): void {
    if (this.scene.leader) return; // arms stand where they stand
    const hand = this.vector('hand_x_m');
    if (this.samples % 10 === 0) this.past.push({ t, hand });
    if (this.past.length > 200) this.past.shift();
    const coupled = this.number('slave_mode') === COUPLED, s = this.scene.motion_scale;
    // A page that is opened while nobody holds the handle: hand and robot will be coupled from where they are.
    if (!this.placed && this.scene.linked && this.number('report_age_ms') >= 0) {
      this.placed = true;
      if (!coupled) this.origin = this.vector('robot_x_m').map((x, i) => x - s * hand[i]!) as Vec;
    }
    const trip = this.number('round_trip_ms');
    if (!coupled) this.coupledFor = 0;
    if (!this.scene.linked || !coupled || trip < 0) return;
    const then = this.past.find((p) => p.t >= t - 1e-3 * trip) ?? this.past.at(-1);
    if (!then) return;
    const robot = this.vector('robot_x_m'), behind = this.vector('behind_m');
    // A coupling that begins has an origin of its own.
    if (this.coupledFor++ === 0) this.past = this.past.slice(-1);
    const share = this.coupledFor < 200 ? 1 : 0.005;
    this.origin = this.origin.map((o, i) => o + share * (robot[i]! - behind[i]! - s * then.hand[i]! - o)) as Vec;
  }

  /** A place of the handle, as the hand's world has it from the present one on. */
  private ofHandle(p: Vec): Vec {
    const hand = this.vector('hand_x_m'), handle = this.vector('handle_x_m'), motion = this.number('motion');
    return p.map((x, i) => hand[i]! + motion * (x - handle[i]!)) as Vec;
  }
  /** `target`: of the pointer, for the handle, while it holds that. */
  draw(target: Vec | null, age: Pick<Shown, 'old' | 'robotOld' | 'robotNote'>): void {
    if (!this.last) return;
    this.picture.draw({
      hand: this.inRobotWorld(this.vector('hand_x_m')),
      handAttitude: this.attitude('hand_attitude'),
      robot: this.vector('robot_x_m'),
      robotAttitude: this.attitude('robot_attitude'),
      joints: this.list('joint_rad'),
      leaderJoints: this.scene.leader ? this.list('leader_rad') : [],
      object: this.scene.object_half_size_m ? this.vector('object_x_m') : [0, 0, 0],
      handle: this.number('gripper_hand_m'),
      fingers: this.scene.gripper_m === null ? null : this.number('gripper_robot_m'),
      target: target && this.inRobotWorld(this.ofHandle(target)),
      felt: this.vector('felt_n'),
      feltTorque: this.vector('felt_n_m'),
      wanted: this.vector('unlimited_n'),
      environment: this.vector('environment_n'),
      environmentTorque: this.vector('environment_n_m'),
      ...age,
    });
  }
  inView(): boolean {
    return this.picture.sees([this.inRobotWorld(this.vector('hand_x_m')), this.vector('robot_x_m')]);
  }
  fit(): void {
    if (!this.last) return;
    const places = this.scene.environment.flatMap((e): Vec[] =>
      e.kind === 'wall' && e.normal && e.offset_m !== undefined
        ? [e.normal.map((n) => n * e.offset_m!) as Vec]
        : [e.center_m, e.point_m, e.anchor_m, e.start_m, e.end_m].filter((p): p is Vec => p !== undefined),
    );
    const corners = this.scene.meshes.flatMap(({ vertices_m: v }) => Array.from({ length: v!.length / 3 }, (_, i) => v!.slice(3 * i, 3 * i + 3) as Vec));
    const robot = this.vector('robot_x_m'), tool = this.scene.tool.map((p) => p.map((x, i) => robot[i]! + x) as Vec); // as if it were not turned
    this.picture.fit([this.inRobotWorld(this.vector('hand_x_m')), robot, ...tool, ...places, ...corners, ...this.picture.armPlaces()]);
  }

  badge(out: HTMLElement, old: boolean): void {
    const { verdict, reason } = this.told;
    state(out, reason === '' ? '' : verdict, old ? 'old' : KINDS[verdict]);
    out.title = `${reason}. The laboratory's judge, on the run so far; see docs/reference/stability.md.`;
    out.setAttribute('aria-label', `${verdict}: ${reason}`);
  }
  /** E(0) of the hand's port, and what is left of it. */
  budget(bar: HTMLElement, out: HTMLElement, old: boolean): void {
    gauge(bar, out, this.told.initial_energy_j, this.number('hand_energy_j') + this.told.earlier_debt_j, 'the hand has', old, this.told.earlier_debt_j > 0);
  }
  /** The same of both ports together, where the method bounds the robot's port. */
  bothBudget(bar: HTMLElement, out: HTMLElement, old: boolean): void {
    const granted = this.told.both_initial_energy_j;
    bar.hidden = granted < 0;
    if (granted >= 0)
      return gauge(bar, out, granted, this.number('hand_energy_j') + this.number('robot_port_j') + this.told.both_earlier_debt_j, 'both have', old, this.told.both_earlier_debt_j > 0);
    out.textContent = 'Not bounded by this method.';
    delete out.dataset.value;
  }
}
