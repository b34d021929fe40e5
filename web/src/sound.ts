// Contact as a sound: noise that is as loud as the displayed force changes; of two runs the first is heard on the left, the second on the
// right. A gamepad rumbles with it. Off until somebody switches it on.

import type { Vec } from './channel';

const LOUDEST_N_PER_S = 200;
const RUMBLE_MS = 60;

export class Sound {
  private context: AudioContext | null = null;
  private voices: { volume: GainNode; pan: StereoPannerNode }[] = [];
  private on = false;
  private before: { forces: Vec[]; at: number } | null = null;
  private rumbled = 0;

  /** Returns whether it is on. */
  toggle(): boolean {
    this.on = !this.on;
    if (this.on && !this.context) this.make();
    if (this.on) void this.context!.resume();
    else void this.context?.suspend();
    return this.on;
  }
  private make(): void {
    const context = new AudioContext(), noise = context.createBuffer(1, context.sampleRate, context.sampleRate);
    const samples = noise.getChannelData(0);
    for (let i = 0; i < samples.length; ++i) samples[i] = 2 * Math.random() - 1;
    const source = new AudioBufferSourceNode(context, { buffer: noise, loop: true });
    const dull = new BiquadFilterNode(context, { type: 'lowpass', frequency: 400 });
    source.connect(dull);
    this.voices = [0, 1].map(() => ({ volume: new GainNode(context, { gain: 0 }), pan: new StereoPannerNode(context) }));
    for (const { volume, pan } of this.voices) dull.connect(volume).connect(pan).connect(context.destination);
    source.start();
    this.context = context;
  }

  /** Call with each frame: the forces on the hand, of each run, and the page's clock [ms]. */
  follow(forces: Vec[], at: number): void {
    const before = this.before;
    this.before = { forces, at };
    if (!this.on || !before || at <= before.at || forces.length !== before.forces.length) return;
    const each = forces.map((force, run) => {
      const change = Math.hypot(...force.map((f, i) => f - before.forces[run]![i]!)) / (1e-3 * (at - before.at));
      return Math.min(1, change / LOUDEST_N_PER_S);
    });
    this.voices.forEach(({ volume, pan }, run) => {
      pan.pan.value = forces.length > 1 ? 2 * run - 1 : 0;
      volume.gain.setTargetAtTime(each[run] ?? 0, this.context!.currentTime, 0.01);
    });
    const loud = Math.max(...each);
    if (loud < 0.05 || at < this.rumbled + RUMBLE_MS) return;
    this.rumbled = at;
    for (const pad of navigator.getGamepads())
      void pad?.vibrationActuator?.playEffect('dual-rumble', { duration: 2 * RUMBLE_MS, strongMagnitude: loud, weakMagnitude: loud });
  }
}
