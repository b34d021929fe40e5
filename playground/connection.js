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

  class Core {
    constructor(on) {
      this.on = on;
      this.begin().catch((error) => {
        on.state(false);
        throw error;
      });
    }

    async begin() {
      const module = await WebAssembly.compile(await unpacked('core'));
      const imports = {};
      for (const { module: from, name } of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = () => 0;
      const instance = await WebAssembly.instantiate(module, imports);
      this.core = instance.exports;
      this.core._initialize?.();
      this.scenes = JSON.parse(new TextDecoder().decode(await unpacked('scenes')));
      this.offer();
      this.start(location.hash.slice(1));
      const frame = (now) => {
        this.frame(now);
        requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
    }

    /** The choice of scenes, in front of the scene's name. */
    offer() {
      const select = document.createElement('select');
      select.id = 'playground-scene';
      select.setAttribute('aria-label', 'Scene');
      select.append(...this.scenes.map((s) => new Option(s.name, s.name)));
      select.onchange = () => {
        this.start(select.value);
        select.blur();
      };
      document.getElementById('scene').before(select);
      this.select = select;
    }

    start(name) {
      const scene = this.scenes.find((s) => s.name === name) ?? this.scenes[0];
      this.select.value = scene.name;
      location.replace(`#${scene.name}`);
      this.write(fromHex(scene.values));
      this.core.start(0);
      this.ran = 0;
      this.last = undefined;
      this.judged = -Infinity;
      this.on.introduction(scene.introduction);
      this.on.state(true);
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
        end: null,
      });
    }
    write(bytes) {
      const at = this.core.input(bytes.length);
      new Uint8Array(this.core.memory.buffer, at, bytes.length).set(bytes);
    }
    send(text) {
      if (!this.core) return;
      if (text === 'restart') return this.start(this.select.value);
      this.write(new TextEncoder().encode(text));
      this.core.command();
    }

    frame(now) {
      const passed = this.last === undefined ? 0 : Math.min(1e-3 * (now - this.last), kLongestFrame);
      this.last = now;
      this.ran += passed;
      const count = this.core.until(this.ran);
      if (count > 0) this.on.samples(new Float64Array(this.core.memory.buffer, this.core.samples(), count).slice());
      if (now - this.judged < kJudging) return;
      this.judged = now;
      this.tell();
    }
  }

  window.twoportConnect = (on) => new Core(on);
})();
