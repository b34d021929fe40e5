// In place of the WebSocket to twoport-master: the core in this file, in step with the page's frames.
'use strict';
(() => {
  const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const fromHex = (text) => Uint8Array.from(text.match(/../g), (pair) => parseInt(pair, 16));
  const unpacked = async (id) => {
    const packed = new Blob([bytesOf(document.getElementById(id).textContent.trim())]);
    return new Response(packed.stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
  };
  const kJudging = 250; // [ms]
  const kLongestFrame = 0.1; // of the run; a page that was hidden does not catch up [s]

  /** One run, in an instance of the core of its own. */
  class Run {
    constructor(exports, on) {
      this.core = exports;
      this.on = on;
      this.core._initialize?.();
    }
    start(scene) {
      this.write(scene);
      this.core.start(0);
      this.judged = -Infinity;
    }
    text(at) {
      const memory = new Uint8Array(this.core.memory.buffer);
      return new TextDecoder().decode(memory.slice(at, memory.indexOf(0, at)));
    }
    /** What the master tells its pages. */
    tell() {
      this.on.told({
        controls: true,
        verdict: this.text(this.core.verdict()),
        reason: this.text(this.core.reason()),
        initial_energy_j: this.core.initial_energy_j(),
        earlier_debt_j: this.core.earlier_debt_j(),
        both_initial_energy_j: this.core.both_initial_energy_j(),
        both_earlier_debt_j: this.core.both_earlier_debt_j(),
        end: null,
      });
    }
    write(bytes) {
      const at = this.core.input(bytes.length);
      new Uint8Array(this.core.memory.buffer, at, bytes.length).set(bytes);
    }
    command(text) {
      this.write(new TextEncoder().encode(text));
      this.core.command();
    }
    until(end_s, now) {
      const count = this.core.until(end_s);
      if (count > 0) this.on.samples(new Float64Array(this.core.memory.buffer, this.core.samples(), count).slice());
      if (now - this.judged < kJudging) return;
      this.judged = now;
      this.tell();
    }
  }

  class Core {
    constructor(on) {
      this.on = on;
      this.runs = [];
      this.begin().catch((error) => {
        on.state(false);
        throw error;
      });
    }

    async begin() {
      this.module = await WebAssembly.compile(await unpacked('core'));
      this.runs = [await this.make(this.on)];
      this.scenes = JSON.parse(new TextDecoder().decode(await unpacked('scenes')));
      this.offer();
      this.open(location.hash.slice(1));
      const frame = (now) => {
        this.frame(now);
        requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    }
    async make(on) {
      const imports = {};
      for (const { module: from, name } of WebAssembly.Module.imports(this.module)) (imports[from] ??= {})[name] = () => 0;
      return new Run((await WebAssembly.instantiate(this.module, imports)).exports, on);
    }

    /** The choice of scenes, in front of the scene's name. */
    offer() {
      const select = document.createElement('select');
      select.id = 'playground-scene';
      select.setAttribute('aria-label', 'Scene');
      select.append(...this.scenes.map((s) => new Option(s.name, s.name)));
      select.onchange = () => {
        this.open(select.value);
        select.blur();
      };
      document.getElementById('scene').before(select);
      this.select = select;
    }

    open(name) {
      this.scene = this.scenes.find((s) => s.name === name) ?? this.scenes[0];
      this.select.value = this.scene.name;
      location.replace(`#${this.scene.name}`);
      this.runs.length = 1;
      this.start();
      this.on.introduction(this.scene.introduction);
      this.on.state(true);
    }
    /** All runs from their beginning. */
    start() {
      for (const run of this.runs) run.start(fromHex(this.scene.values));
      this.ran = 0;
      this.last = undefined;
    }
    async compare(on) {
      const second = on && (await this.make(on));
      this.runs = second ? [this.runs[0], second] : [this.runs[0]];
      this.start();
    }

    send(text, run) {
      if (this.runs.length === 0) return;
      if (text === 'restart') return this.open(this.scene.name);
      for (const each of run === undefined ? this.runs : [this.runs[run]]) each?.command(text);
    }

    frame(now) {
      const passed = this.last === undefined ? 0 : Math.min(1e-3 * (now - this.last), kLongestFrame);
      this.last = now;
      this.ran += passed;
      for (const run of this.runs) run.until(this.ran, now);
    }
  }

  window.twoportConnect = (on) => new Core(on);

  // The page's script, which the policy knows by its hash.
  addEventListener('DOMContentLoaded', async () => {
    const script = document.createElement('script');
    script.type = 'module';
    script.textContent = new TextDecoder().decode(await unpacked('page'));
    document.body.append(script);
  });
})();
