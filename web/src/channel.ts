// The page's connection: one introduction as JSON, then states as JSON and samples as little-endian doubles; commands as text. At the
// other end is twoport-master, through a WebSocket, or the core that the playground's file holds.

export type Vec = [number, number, number];

export interface Element {
  kind: string;
  stiffness_n_per_m?: number;
  friction?: number;
  normal?: Vec;
  offset_m?: number;
  center_m?: Vec;
  point_m?: Vec;
  axis?: Vec;
  radius_m?: number;
  half_size_m?: Vec;
  anchor_m?: Vec;
  tube_radius_m?: number;
  start_m?: Vec;
  end_m?: Vec;
  attitude?: [number, number, number, number];
  holes_m?: Vec[]; // of a plate: centre and radius
  profile_m?: [number, number][]; // of a solid of revolution: radius, and height along the axis
  vertices_m?: number[]; // of a mesh: x, y, z of each, in the axes of what it is a part of
  triangles?: number[]; // three vertices each
}
/** A serial arm: each joint turns about the z axis of its frame, or slides along it; a mirrored one is two fingers, to both sides of the tool. */
export interface Arm {
  joints: { origin_m: Vec; attitude: [number, number, number, number]; slides: boolean; mirrored: boolean }[];
  flange_m: Vec;
  links: Element[] | null; // meshes of the base and of the link behind each joint, in its axes; empty, or without triangles: not known; null: the robot's
  left_out: string[]; // what of them could not be read, in sentences
}

export interface Network {
  delay_ms: number;
  jitter_ms: number;
  loss: number;
}

export interface Introduction {
  scene: string;
  dof: number; // of handle and tool
  joints: number; // of leader and robot, which are coupled joint by joint; 0: handle and tool are
  rate_hz: number;
  architecture: string;
  method: string;
  methods: string[];
  plain_method: string; // the one without a controller
  initial_energies_j: number[];
  restarts: boolean; // may the page have both programs started again?
  device: string;
  pointer: boolean;
  home_m: Vec; // where the handle began
  robot_home_m: Vec; // where a simulated robot began
  without_motor: number[]; // axes of the device that display no force
  grip_n_per_m: number;
  grip_limits_n_per_m: [number, number];
  motion_scale: number;
  force_scale: number;
  limits: string[]; // names, by bit of a sample's `limits`
  linked: boolean;
  to_slave: Network;
  to_master: Network;
  network_limits: Network;
  environment: Element[];
  meshes: Element[]; // of the environment's meshes, which have no triangles there
  environment_answers: string[]; // sentences, by number
  zero_answers: string[]; // to requests to zero the force sensor, by number
  surface_limits: { stiffness_n_per_m: number; friction: number };
  layer_figures: [string, string, number][]; // fields of a sample: unit, least dof
  tool: Vec[]; // contact points; so many first ones belong to no part:
  tool_alone: number;
  tool_parts: Element[];
  arm: Arm | null; // of the robot
  leader: Arm | null; // whose tool the hand holds
  object_half_size_m: Vec | null; // of the box that the robot's fingers may take
  gripper_m: number | null; // where the gripper of the handle starts; null: none
  fields: [string, number][];
}

/** What a page is told besides the introduction and samples, whenever it changes. */
export interface Told {
  controls: boolean; // do commands of this page have an effect?
  verdict: 'passive' | 'not passive' | 'restless' | 'unstable';
  reason: string;
  initial_energy_j: number;
  earlier_debt_j: number; // got beyond its own by the hand under earlier methods
  both_initial_energy_j: number; // of hand and robot together; negative: the method does not bound the robot's port
  both_earlier_debt_j: number;
  end: string | null; // how the run has ended
}

/** One sample: numbers by field, at their place. */
export class Layout {
  readonly size: number;
  private readonly at = new Map<string, number>();
  constructor(readonly fields: [string, number][]) {
    let size = 0;
    for (const [name, count] of fields) {
      this.at.set(name, size);
      size += count;
    }
    this.size = size;
  }
  place(name: string): number {
    const at = this.at.get(name);
    if (at === undefined) throw new Error(`the program sends no ${name}`);
    return at;
  }
  /** Numbers of a field. */
  count(name: string): number {
    return this.fields.find(([field]) => field === name)?.[1] ?? 0;
  }
  /** Names of all numbers, vectors with their index. */
  columns(): string[] {
    return this.fields.flatMap(([name, count]) =>
      count === 1 ? [name] : Array.from({ length: count }, (_, i) => `${name}_${i}`),
    );
  }
}

export interface Listener {
  introduction(i: Introduction): void;
  told(t: Told): void;
  samples(numbers: Float64Array): void;
  state(connected: boolean): void;
}
export interface Connection {
  /** To one run, or to all. */
  send(text: string, run?: number): void;
  /**
   * Of the playground: starts the run anew, and a second one with the same seed, link and hand, which `on` hears; null: without one.
   * Resolves when both are at their beginning.
   */
  compare?(on: Pick<Listener, 'told' | 'samples'> | null): Promise<void>;
}

declare global {
  interface Window {
    /** Of the playground: the core in the page in place of the master. */
    twoportConnect?: (on: Listener) => Connection;
  }
}
export function connect(on: Listener): Connection {
  return window.twoportConnect ? window.twoportConnect(on) : new MasterSocket(on);
}

class MasterSocket implements Connection {
  private socket: WebSocket | null = null;

  constructor(private readonly on: Listener) {
    this.connect();
  }

  send(text: string): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(text);
  }

  private connect(): void {
    const socket = new WebSocket(`ws://${location.host}/live${location.search}`);
    let introduced = false;
    socket.binaryType = 'arraybuffer';
    socket.onmessage = (event: MessageEvent<string | ArrayBuffer>) => {
      if (typeof event.data !== 'string') {
        this.on.samples(new Float64Array(event.data));
      } else if (introduced) {
        this.on.told(JSON.parse(event.data) as Told);
      } else {
        introduced = true;
        this.on.introduction(JSON.parse(event.data) as Introduction);
        this.on.state(true);
      }
    };
    socket.onclose = () => {
      this.on.state(false);
      window.setTimeout(() => this.connect(), 500);
    };
    this.socket = socket;
  }
}
