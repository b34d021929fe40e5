// node same.mjs CORE.wasm ROWS_PROGRAM SCENES: scripted runs of the playground's core against the laboratory's.
//
// To the bit, or within the tolerance stated: another C library's sine, cosine, logarithm and power differ in the last digit, and
// Eigen adds in pairs where the processor can. Where contacts magnify that without bound, the run is compared up to a time.
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';

const [file, program, scenes] = process.argv.slice(2);
const module = new WebAssembly.Module(readFileSync(file)), imports = {};
for (const { module: from, name } of WebAssembly.Module.imports(module)) (imports[from] ??= {})[name] = () => 0;
const core = new WebAssembly.Instance(module, imports).exports;
core._initialize?.();

const bit = 0;
const pairs = 1e-4; // [N], after a slide with friction over seconds, which magnifies the last digit of a sum
const until = (end_s) => ({ end_s });
const of_method = (name) => [`control.passivity.method=${name}`];
const runs = [
  ['one_axis_wall', bit], ['encoder_30um', bit], ['render_wall_projected', bit], ['demo', 1e-8], ['internal_model_50ms', 1e-8],
  ['stiff_wall_50ms', pairs], ['burst_loss_in_contact', pairs], ['reorder_and_duplicate', pairs], ['blackout_in_contact', pairs],
  ['two_rates', pairs], ['measured_force_50ms', pairs], ['rough_cylinder', pairs], ['heavy_tail_jitter', pairs],
  ['six_dof_plate', 1e-8, until(2)], ['render_peg_in_hole', 1e-8], ['assembly', 1e-8, until(2.5)],
  ...['CLASSIC', 'FORCE_PROJECTED', 'FIXED_DAMPING', 'WAVE_VARIABLES', 'SET_POSITION_MODULATION', 'ENERGY_TANK', 'ENERGY_BOUNDING',
    'FRACTAL_IMPEDANCE', 'MODEL_MEDIATED'].map((m) => ['one_axis_wall', 1e-8, ...of_method(m)]),
  ...[['CONTACT_SPRING', 'ENERGY_SPRING_TWO_PORT'], ['FOUR_CHANNEL', 'ENERGY_TANK'], ['SURFACE_MODEL', 'FORCE_PROJECTED']].map(
    ([t, p]) => ['one_axis_wall', 1e-8, `control.transparency.layer=${t}`, `control.passivity.layer=${p}`]),
];

const work = mkdtempSync(join(tmpdir(), 'playground-'));
let failed = 0;
try {
  for (const [name, tolerance, ...more] of runs) {
    const overrides = more.filter((m) => typeof m === 'string'), end_s = more.find((m) => m.end_s)?.end_s ?? Infinity;
    const out = join(work, 'run');
    execFileSync(program, [out, join(scenes, `${name}.textproto`), ...overrides]);
    const scene = readFileSync(`${out}.scene`), bytes = readFileSync(`${out}.rows`);
    const wanted = new Float64Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
    new Uint8Array(core.memory.buffer, core.input(scene.length), scene.length).set(scene);
    core.start(1);
    let at = 0, most = 0, first = -1;
    for (let t = 1; at < wanted.length && t <= Math.ceil(end_s); ++t) {
      const count = core.until(Math.min(t, end_s)), got = new Float64Array(core.memory.buffer, core.samples(), count);
      if (count === 0) break;
      for (let i = 0; i < count && at < wanted.length; ++i, ++at) {
        if (Number.isNaN(wanted[at]) || got[i] === wanted[at]) continue;
        if (first < 0) first = at;
        const error = Math.abs(got[i] - wanted[at]);
        most = Math.max(most, Number.isNaN(error) ? Infinity : error);
      }
    }
    const good = (at === wanted.length || end_s < Infinity) && at > 0 && most <= tolerance;
    if (!good) ++failed;
    console.log(`${good ? 'good' : 'BAD '} ${name} ${overrides.join(' ')}: ${most === 0 ? 'the same to the bit' : `differs by ${most}`}` +
      ` in ${at} numbers${first < 0 ? '' : `, first at ${first}`}`);
  }
} finally {
  rmSync(work, { recursive: true });
}
if (failed > 0) throw new Error(`${failed} of ${runs.length} runs differ from the laboratory's`);
