// Hand, robot, environment and forces, projected on the picture's plane. In six axes, and where the environment has shapes that are no
// flat figures, the solids are by three.js (space.ts), and forces and words are drawn over them; a browser without WebGL shows what is flat.

import type { Element, Introduction, Vec } from './channel';
import { Space } from './space';

export type Attitude = [number, number, number, number]; // w, x, y, z
type Point = [number, number]; // pixels

/** A direction of view: which directions of space point right, up and out of the picture. */
export interface View {
  name: string;
  azimuth: number;
  elevation: number;
  right: Vec;
  up: Vec;
  out: Vec;
}

/** From this azimuth and elevation [rad]; z points up. */
function viewFrom(name: string, azimuth: number, elevation: number): View {
  const whole = (v: Vec): Vec => v.map((x) => Math.round(1e12 * x) / 1e12) as Vec;
  const [c, s, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
  return { name, azimuth, elevation, right: whole([c, s, 0]), up: whole([-s * se, c * se, ce]), out: whole([s * ce, -c * ce, se]) };
}

const FLAT = ['wall', 'sphere', 'cylinder', 'box', 'spring'];
/** Is it shown as solids, in a view that turns? */
export function isSolid(scene: Introduction): boolean {
  return scene.dof === 6 || scene.meshes.length > 0 || scene.environment.some((e) => !FLAT.includes(e.kind));
}
export function viewsFor(scene: Introduction): View[] {
  if (scene.dof === 1) return [{ ...viewFrom('x', 0, 0), up: [0, 0, 0], out: [0, 0, 0] }];
  const along = [viewFrom('x – y', 0, Math.PI / 2), viewFrom('x – z', 0, 0), viewFrom('y – z', Math.PI / 2, 0)];
  return isSolid(scene) ? [viewFrom('oblique', -0.45, 0.39), ...along] : along;
}

export interface Shown {
  hand: Vec; // in the robot's world
  handAttitude: Attitude;
  robot: Vec;
  robotAttitude: Attitude;
  joints: number[]; // of the robot's arm [rad]
  leaderJoints: number[]; // of the leader
  object: Vec; // centre of the box that the fingers may take, where there is one
  fingers: number | null; // opening of the robot's gripper [m]; null: none
  handle: number; // of the handle's, where there is one
  target: Vec | null; // of the pointer, in the robot's world
  felt: Vec;
  feltTorque: Vec;
  wanted: Vec; // before the passivity controller
  environment: Vec;
  environmentTorque: Vec;
  old: boolean; // is nothing of now?
  robotOld: boolean;
  robotNote: string; // why, in words
}

const dot = (a: Vec, b: Vec): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const add = (a: Vec, b: Vec, s = 1): Vec => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const norm = (a: Vec): number => Math.sqrt(dot(a, a));
const cross = (a: Vec, b: Vec): Vec => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
/** A direction across another one. */
const across = (n: Vec): Vec => {
  const u = cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
  return u.map((x) => x / norm(u)) as Vec;
};
/** An arrow's head at x, y [pixels], along the unit vector u. */
const tip = (x: number, y: number, ux: number, uy: number, long: number, wide: number): Point[] => [
  [x + long * ux, y + long * uy],
  [x - wide * uy, y + wide * ux],
  [x + wide * uy, y - wide * ux],
];
/** Does the line from a to b cross the rectangle? */
function crosses(a: Point, b: Point, left: number, top: number, right: number, bottom: number): boolean {
  let from = 0, to = 1;
  for (const [at, by, low, high] of [[a[0], b[0] - a[0], left, right], [a[1], b[1] - a[1], top, bottom]] as const) {
    if (by === 0 && (at < low || at > high)) return false;
    if (by === 0) continue;
    const [first, last] = by > 0 ? [(low - at) / by, (high - at) / by] : [(high - at) / by, (low - at) / by];
    from = Math.max(from, first);
    to = Math.min(to, last);
  }
  return from <= to;
}
const PIXELS_PER_NEWTON = 12;
const RADIANS_PER_NEWTON_METRE = 6; // of a torque's arc
const LINE = 13; // pixels
const EDGE = 14, TOP = 30; // pixels that an arrow keeps from the edge, and from the legend's
const MARGIN = 24; // pixels in which hand and robot are not left

export class Picture {
  view: View;
  /** What the user has chosen: pixels per metre, and the point of space in the middle. */
  chosen = { scale: 2500, centre: [0, 0, 0] as Vec };
  /** What is shown: the same, but for a hand or robot that has left it. */
  private shown = { scale: 2500, centre: [0, 0, 0] as Vec };
  private readonly canvas = document.createElement('canvas');
  private readonly context: CanvasRenderingContext2D;
  private paper = ''; // colour behind it
  private written: { x: number; y: number; wide: number }[] = []; // words of this frame
  private labels: { text: string; x: number; y: number; colour: string }[] = []; // that have yet to find a place
  private shafts: [Point, Point][] = []; // of this frame's arrows
  /** Has every arrow its head in the picture, and does each label stand there beside all of them? */
  readable = true;
  private readonly space: Space | null = null;

  constructor(
    box: HTMLElement,
    private readonly scene: Introduction,
  ) {
    this.view = viewsFor(scene)[0]!;
    this.context = this.canvas.getContext('2d')!;
    const behind = document.createElement('canvas');
    if (isSolid(scene)) this.space = Space.on(behind, scene);
    box.replaceChildren(...(this.space ? [behind] : []), this.canvas);
    box.dataset.solid = String(this.space !== null);
  }
  dispose(): void {
    this.space?.dispose();
  }
  /** At once from where another one, or itself, is to look. */
  look(as: Picture): void {
    this.view = as.view;
    this.chosen = { ...as.chosen };
    this.shown = { ...as.chosen };
  }
  /** Turns the view by a drag in pixels. */
  orbit(dx: number, dy: number): void {
    const { name, azimuth, elevation } = this.view;
    this.view = viewFrom(name, azimuth - dx / 150, Math.max(-Math.PI / 2, Math.min(Math.PI / 2, elevation + dy / 150)));
  }
  armPlaces(): Vec[] {
    return this.space?.armPlaces() ?? [];
  }

  get scale(): number {
    return this.shown.scale;
  }
  /** Chooses the view that shows these points and the origin. */
  fit(points: Vec[]): void {
    this.chosen = this.around([[0, 0, 0], ...points], 8000);
  }
  private around(points: Vec[], most: number): { scale: number; centre: Vec } {
    const span = (axis: Vec): [number, number] => {
      const along = points.map((p) => dot(p, axis));
      return [Math.min(...along), Math.max(...along)];
    };
    const [left, right] = span(this.view.right), [low, high] = span(this.view.up);
    const room = (pixels: number, from: number, to: number): number => (pixels - 6 * MARGIN) / Math.max(to - from, 1e-3);
    const scale = Math.max(5, Math.min(most, room(this.width, left, right), room(this.height, low, high)));
    const x = (left + right) / 2, y = (low + high) / 2;
    return { scale, centre: [0, 1, 2].map((i) => x * this.view.right[i]! + y * this.view.up[i]!) as Vec };
  }
  sees(points: Vec[], view = this.shown): boolean {
    return points.every((p) => {
      const [x, y] = this.point(p, view);
      return x > MARGIN && x < this.width - MARGIN && y > MARGIN && y < this.height - MARGIN;
    });
  }
  /** Follows a hand or a robot that leaves the chosen view, and returns to that view with it. */
  private follow(points: Vec[]): void {
    const inside = (view: { scale: number; centre: Vec }): boolean => this.sees(points, view);
    const to = inside(this.chosen) ? this.chosen : this.around([this.chosen.centre, ...points], this.chosen.scale);
    const share = inside(this.shown) ? 0.08 : 0.4;
    const near = Math.abs(Math.log(to.scale / this.shown.scale)) < 1e-3 && norm(add(to.centre, this.shown.centre, -1)) * to.scale < 0.5;
    if (near) {
      this.shown = { scale: to.scale, centre: [...to.centre] };
      return;
    }
    this.shown.scale *= (to.scale / this.shown.scale) ** share;
    this.shown.centre = add(this.shown.centre, add(to.centre, this.shown.centre, -1), share);
  }

  private get width(): number {
    return this.canvas.clientWidth;
  }
  private get height(): number {
    return this.canvas.clientHeight;
  }
  private point(p: Vec, view = this.shown): Point {
    const from = add(p, view.centre, -1);
    return [
      0.45 * this.width + view.scale * dot(from, this.view.right),
      0.5 * this.height - view.scale * dot(from, this.view.up),
    ];
  }
  /** The displacement in space of a displacement in pixels. */
  displacement(dx: number, dy: number): Vec {
    const { right, up } = this.view;
    return [0, 1, 2].map((i) => (dx * right[i]! - dy * up[i]!) / this.scale) as Vec;
  }

  draw(s: Shown): void {
    const c = this.context;
    const ratio = window.devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(this.width * ratio) || this.canvas.height !== Math.round(this.height * ratio)) {
      this.canvas.width = Math.round(this.width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
    }
    const colour = (name: string): string => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
    this.paper = colour('--panel');
    this.follow([s.hand, s.robot]);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    this.written = [];
    this.labels = [];
    this.shafts = [];
    if (this.space) this.space.draw(s, this.view, this.shown.centre, this.shown.scale, this.width, this.height);
    this.grid(colour('--grid'), colour('--muted'));
    for (const e of this.scene.environment) if (!this.space || e.kind === 'spring') this.element(e, s, colour('--surface'), colour('--surface-line'));
    const muted = colour('--muted'), [ofHand, ofForce, ofWanted] = ['--hand', '--felt', '--third'].map((of) => (s.old ? muted : colour(of))) as [string, string, string];
    const ofRobot = s.robotOld ? muted : colour('--robot');
    if (!this.space) this.fill(ofRobot, 1, this.circle(s.robot, 7));
    if (!this.space && s.fingers !== null) {
      this.fingers(s.robot, s.fingers, ofRobot, 5, 9);
      this.fingers(s.hand, s.handle, ofHand, 2, 15);
    }
    const differ = norm(add(s.wanted, s.felt, -1)) > 0.05;
    this.legend(colour('--text'), [
      [ofHand, this.scene.leader ? 'leader' : 'hand'],
      [ofRobot, this.scene.leader ? 'follower' : 'robot'],
      [ofForce, 'force felt'],
      ...(differ ? [[ofWanted, 'force wanted'] as [string, string]] : []),
    ]);
    if (s.robotNote) this.label(s.robot, s.robotNote, ofRobot);
    this.hand(s, ofHand, muted);
    if (!s.robotOld) {
      this.arrow(s.robot, s.environment, ofRobot, 'on the environment', 18);
      this.arc(s.robot, s.environmentTorque, ofRobot, 34);
    }
    this.arc(s.hand, s.feltTorque, ofForce, 26);
    if (differ) this.arrow(s.hand, s.wanted, ofWanted, 'wanted', -44, true);
    this.arrow(s.hand, s.felt, ofForce, 'felt', -14);
    this.readable = this.shafts.every(([, [x, y]]) => x >= EDGE - 1 && x <= this.width - EDGE + 1 && y >= TOP - 1 && y <= this.height - EDGE + 1);
    c.font = '12px system-ui, sans-serif';
    for (const label of this.labels) this.place(label);
  }

  private label(at: Vec, text: string, colour: string): void {
    const [x, y] = this.point(at);
    this.labels.push({ text, x: x + 12, y: y + 34, colour });
  }
  /** At the line of text next to its place that no other words and no arrow have. */
  private place({ text, x: wanted, y: near, colour }: { text: string; x: number; y: number; colour: string }): void {
    const wide = this.context.measureText(text).width, x = Math.max(4, Math.min(wanted, this.width - wide - 4));
    const lines = Array.from({ length: 40 }, (_, i) => near + (i % 2 ? -1 : 1) * Math.ceil(i / 2) * LINE);
    const inside = lines.filter((y) => y >= TOP && y <= this.height - 4);
    const free = inside.find(
      (y) =>
        !this.written.some((w) => Math.abs(w.y - y) < LINE && x < w.x + w.wide && w.x < x + wide) &&
        !this.shafts.some(([a, b]) => crosses(a, b, x - 3, y - LINE, x + wide + 3, y + 4)),
    );
    if (free === undefined) this.readable = false;
    this.words(text, x, free ?? inside[0] ?? near, colour);
  }
  /** Text that is read on lines and solids too. */
  private words(text: string, x: number, y: number, colour: string): void {
    const c = this.context;
    this.written.push({ x, y, wide: c.measureText(text).width });
    c.lineWidth = 3;
    c.lineJoin = 'round';
    c.strokeStyle = this.paper;
    c.strokeText(text, x, y);
    c.fillStyle = colour;
    c.fillText(text, x, y);
  }

  /** Lines through points in pixels. */
  private stroke(colour: string, width: number, ...lines: Point[][]): void {
    const c = this.context;
    c.beginPath();
    for (const line of lines) line.forEach((p, i) => (i === 0 ? c.moveTo(...p) : c.lineTo(...p)));
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.stroke();
  }
  /** A polygon of points in pixels. */
  private fill(colour: string, opacity: number, points: Point[]): void {
    const c = this.context;
    c.beginPath();
    for (const p of points) c.lineTo(...p);
    c.fillStyle = colour;
    c.globalAlpha = opacity;
    c.fill();
    c.globalAlpha = 1;
  }
  private circle(at: Vec, radius: number): Point[] {
    const [x, y] = this.point(at);
    return Array.from({ length: 129 }, (_, i) => [x + radius * Math.cos((i * Math.PI) / 64), y + radius * Math.sin((i * Math.PI) / 64)]);
  }

  private grid(line: string, text: string): void {
    const c = this.context;
    const steps = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5];
    const step = steps.find((x) => x * this.scale > 45) ?? 10, apart = step * this.scale;
    const [ox, oy] = this.point([0, 0, 0]);
    const places = (o: number, most: number): number[] => {
      const first = ((o % apart) + apart) % apart;
      return Array.from({ length: Math.max(0, Math.ceil((most - first) / apart)) }, (_, i) => first + i * apart);
    };
    // Solids have no paper behind them.
    if (!this.space) {
      this.stroke(line, 1, ...places(ox, this.width).map((x): Point[] => [[x, 0], [x, this.height]]));
      this.stroke(line, 1, ...places(oy, this.height).map((y): Point[] => [[0, y], [this.width, y]]));
    }
    c.font = '11px system-ui, sans-serif';
    c.fillStyle = text;
    this.stroke(text, 1.5, [[12, this.height - 14], [12 + apart, this.height - 14]]);
    c.fillText(`${(1e3 * step).toFixed(0)} mm`, 12, this.height - 20);
    // Axes of the world.
    const names = ['x', 'y', 'z'];
    for (let i = 0; i < (this.scene.dof === 1 ? 1 : 3); ++i) {
      const axis: Vec = [0, 0, 0];
      axis[i] = 28 / this.scale;
      const [ax, ay] = this.point(axis);
      if (Math.hypot(ax - ox, ay - oy) < 6) continue;
      this.stroke(text, 1.5, [[ox, oy], [ax, ay]]);
      c.fillText(names[i]!, ax + 3, ay - 3);
    }
  }

  private polygon(corners: Vec[], fill: string, line: string): void {
    const points = corners.map((p) => this.point(p));
    this.fill(fill, 0.35, points);
    this.stroke(line, 1.5, [...points, points[0]!]);
  }

  private element(e: Element, s: Shown, fill: string, line: string): void {
    if (e.kind === 'wall' && e.normal && e.offset_m !== undefined) {
      this.wall(e.normal, e.offset_m, fill, line);
    } else if (e.kind === 'sphere' && e.center_m && e.radius_m !== undefined) {
      if (this.scene.dof === 1) {
        this.band(e.center_m[0] - e.radius_m, e.center_m[0] + e.radius_m, fill, line);
        return;
      }
      const circle = this.circle(e.center_m, e.radius_m * this.scale);
      this.fill(fill, 0.5, circle);
      this.stroke(line, 1.5, circle);
    } else if (e.kind === 'cylinder' && e.point_m && e.axis && e.radius_m !== undefined) {
      const along = Math.hypot(dot(e.axis, this.view.right), dot(e.axis, this.view.up));
      if (along < 0.05) {
        this.element({ kind: 'sphere', center_m: e.point_m, radius_m: e.radius_m }, s, fill, line);
        return;
      }
      const depth = cross(this.view.right, this.view.up);
      let side = cross(e.axis, depth);
      side = side.map((v) => v / (norm(side) || 1)) as Vec;
      const a = add(e.point_m, e.axis, -1), b = add(e.point_m, e.axis, 1), r = e.radius_m;
      this.polygon([add(a, side, r), add(b, side, r), add(b, side, -r), add(a, side, -r)], fill, line);
    } else if (e.kind === 'box' && e.center_m && e.half_size_m) {
      const h = e.half_size_m, m = e.center_m;
      for (let axis = 0; axis < 3; ++axis)
        for (const sign of [-1, 1]) {
          const [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
          const corner = (u: number, v: number): Vec => {
            const p: Vec = [...m];
            p[axis] = m[axis]! + sign * h[axis]!;
            p[i] = m[i]! + u * h[i]!;
            p[j] = m[j]! + v * h[j]!;
            return p;
          };
          this.polygon([corner(-1, -1), corner(1, -1), corner(1, 1), corner(-1, 1)], fill, line);
        }
    } else if (e.kind === 'spring' && e.anchor_m) {
      const [ax, ay] = this.point(e.anchor_m), [bx, by] = this.point(s.robot);
      const length = Math.hypot(bx - ax, by - ay) || 1, nx = -(by - ay) / length, ny = (bx - ax) / length;
      const turn = (i: number): Point => {
        const side = i % 2 ? 6 : -6;
        return [ax + ((bx - ax) * i) / 16 + side * nx, ay + ((by - ay) * i) / 16 + side * ny];
      };
      this.stroke(line, 1.5, [[ax, ay], ...Array.from({ length: 15 }, (_, i) => turn(i + 1)), [bx, by]]);
    }
  }

  private band(from: number, to: number, fill: string, line: string): void {
    const [a] = this.point([from, 0, 0]), [b] = this.point([to, 0, 0]), h = this.height;
    this.fill(fill, 1, [[a, 0], [b, 0], [b, h], [a, h]]);
    this.stroke(line, 2, [[a, 0], [a, h]], [[b, 0], [b, h]]);
  }

  /** The half space behind a plane, to the edge of the picture; a plane that is not seen from the side as a part of it. */
  private wall(normal: Vec, offset: number, fill: string, line: string): void {
    const a = dot(normal, this.view.right), b = dot(normal, this.view.up), inPlane = Math.hypot(a, b);
    const at: Vec = normal.map((n) => n * offset) as Vec;
    if (inPlane < 0.99) {
      // A part of the plane as large as the picture, with lines every 20 mm: it has no edge in truth.
      const u = across(normal), v = cross(normal, u);
      const lines = Math.max(4, Math.ceil((0.42 * this.height) / this.scale / 0.02)), size = 0.02 * lines;
      const place = (i: number, j: number): Vec => add(add(at, u, i * size), v, j * size);
      this.polygon([place(-1, -1), place(1, -1), place(1, 1), place(-1, 1)], fill, line);
      const drawn: Point[][] = [];
      for (let k = 1 - lines; k < lines; ++k)
        for (const ends of [[place(k / lines, -1), place(k / lines, 1)], [place(-1, k / lines), place(1, k / lines)]])
          drawn.push(ends.map((p) => this.point(p)));
      this.context.globalAlpha = 0.2;
      this.stroke(line, 1, ...drawn);
      this.context.globalAlpha = 1;
      return;
    }
    const [x, y] = this.point(at), nx = a / inPlane, ny = -b / inPlane, far = 20000;
    const corner = (t: number, d: number): Point => [x - ny * t - nx * d, y + nx * t - ny * d];
    this.fill(fill, 1, [corner(-far, 0), corner(far, 0), corner(far, far), corner(-far, far)]);
    this.stroke(line, 2, [corner(-far, 0), corner(far, 0)]);
  }

  private hand(s: Shown, colour: string, muted: string): void {
    const c = this.context, [x, y] = this.point(s.hand);
    if (s.target) {
      const [tx, ty] = this.point(s.target);
      c.setLineDash([4, 4]);
      this.stroke(muted, 1.5, [[x, y], [tx, ty]]);
      c.setLineDash([]);
      this.stroke(muted, 1.5, [[tx - 6, ty], [tx + 6, ty]], [[tx, ty - 6], [tx, ty + 6]]);
    }
    if (!this.space) this.stroke(colour, 3, this.circle(s.hand, 13));
  }

  /** A gripper's opening, to scale. */
  private fingers(at: Vec, opening: number, colour: string, wide: number, half: number): void {
    const [x, y] = this.point(at);
    for (const h of [-0.5 * opening * this.scale, 0.5 * opening * this.scale]) this.stroke(colour, wide, [[x - half, y + h], [x + half, y + h]]);
  }
  private arrow(from: Vec, force: Vec, colour: string, name: string, offset: number, hollow = false): void {
    const size = norm(force);
    if (size < 0.02) return;
    const c = this.context, [x, y] = this.point(from);
    let dx = dot(force, this.view.right) * PIXELS_PER_NEWTON, dy = -dot(force, this.view.up) * PIXELS_PER_NEWTON;
    const length = Math.hypot(dx, dy) || 1, ux = dx / length, uy = dy / length, y0 = y + (this.scene.dof === 1 ? offset : 0);
    // A large force ends where head and number are still seen.
    const room = (at: number, by: number, least: number, most: number): number => (by > 0 ? (most - at) / by : by < 0 ? (least - at) / by : Infinity);
    const drawn = Math.max(0, Math.min(length, 0.4 * this.width, room(x, ux, EDGE, this.width - EDGE), room(y0, uy, TOP, this.height - EDGE)));
    dx = drawn * ux;
    dy = drawn * uy;
    if (hollow) c.setLineDash([5, 4]);
    this.stroke(colour, hollow ? 2 : 3, [[x, y0], [x + dx, y0 + dy]]);
    c.setLineDash([]);
    if (length > 6) this.fill(colour, 1, tip(x + dx, y0 + dy, ux, uy, 8, 5));
    this.shafts.push([[x, y0], [x + dx, y0 + dy]]);
    c.font = '12px system-ui, sans-serif';
    const text = `${size.toFixed(2)} N ${name}`;
    this.labels.push({ text, x: x + dx + (ux < 0 ? -c.measureText(text).width - 12 : 12), y: y0 + dy + (offset > 0 ? 18 : hollow ? -24 : -10), colour });
  }

  /** A torque: an arc about its axis, as long as it is large. */
  private arc(at: Vec, torque: Vec, colour: string, pixels: number): void {
    const size = norm(torque);
    if (this.scene.dof !== 6 || size < 0.03) return;
    const axis = torque.map((x) => x / size) as Vec, r = pixels / this.scale;
    const u = across(axis), v = cross(axis, u), angle = Math.min(5.5, RADIANS_PER_NEWTON_METRE * size);
    const place = (a: number): Point => this.point(add(add(at, u, r * Math.cos(a)), v, r * Math.sin(a)));
    const [x, y] = place(angle), [bx, by] = place(angle - 0.3), length = Math.hypot(x - bx, y - by) || 1;
    this.stroke(colour, 2.5, Array.from({ length: 25 }, (_, k) => place((angle * k) / 24)));
    this.fill(colour, 1, tip(x, y, (x - bx) / length, (y - by) / length, 6, 4));
    this.labels.push({ text: `${size.toFixed(2)} N m`, x: x + 10, y: y + 4, colour });
  }

  private legend(text: string, entries: [string, string][]): void {
    const c = this.context;
    c.font = '12px system-ui, sans-serif';
    let x = 12;
    for (const [colour, name] of entries) {
      c.fillStyle = colour;
      c.fillRect(x, 14, 12, 4);
      this.words(name, x + 17, 20, text);
      x += c.measureText(name).width + 32;
    }
  }
}
