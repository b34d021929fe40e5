// What a frame costs: draw calls, triangles, CPU time of the page's main thread while the handle is dragged, and frames a second. The
// draw calls are counted and, for the times, not made: they are the graphics processor's part. Throws above the bounds.
//
// Environment: MOST_TRIANGLES, 100000 where it is absent.
import { context, page, pause, run, takePicture, text, until } from './chromium.mjs';

const MOST_CALLS = 200, MOST_SCRIPT_MS = 4; // per frame
const mostTriangles = Number(process.env.MOST_TRIANGLES ?? 100000);

await context.addInitScript(() => {
  const seen = (window.seen = { calls: 0, triangles: 0, frames: 0, draws: true });
  const gl = WebGL2RenderingContext.prototype;
  for (const [name, at] of [['drawArrays', 2], ['drawElements', 1], ['drawArraysInstanced', 2], ['drawElementsInstanced', 1]]) {
    const draw = gl[name];
    gl[name] = function (...of) {
      seen.calls += 1;
      if (of[0] === gl.TRIANGLES) seen.triangles += (of[at] / 3) * (name.endsWith('Instanced') ? of.at(-1) : 1);
      if (seen.draws) draw.apply(this, of);
    };
  }
  const next = () => ((seen.frames += 1), requestAnimationFrame(next));
  requestAnimationFrame(next);
});

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand', 60000);
  await until('it is drawn as solids', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true');
  await page.locator('#fit').evaluate((b) => b.click()); // all of it is drawn; a click would wait for frames
  const devtools = await context.newCDPSession(page);
  await devtools.send('Performance.enable', { timeDomain: 'threadTicks' });
  const now = async () => {
    const { metrics } = await devtools.send('Performance.getMetrics');
    return { ...Object.fromEntries(metrics.map((m) => [m.name, m.value])), ...(await page.evaluate(() => window.seen)), at: performance.now() };
  };
  // The hand moves while the page is measured.
  const box = await page.locator('#picture').boundingBox(), [x, y] = [box.x + 0.45 * box.width, box.y + 0.5 * box.height];
  await page.mouse.move(x, y);
  await page.mouse.down();
  const measure = async (seconds) => {
    const before = await now();
    for (let i = 0; i < 20 * seconds; ++i) {
      await page.mouse.move(x + 15 * Math.sin(i / 5), y + 15 * Math.cos(i / 7));
      await pause(50);
    }
    const after = await now(), frames = after.frames - before.frames;
    const each = (name, factor = 1) => (factor * (after[name] - before[name])) / frames;
    return { frames, each, rate: (1000 * frames) / (after.at - before.at) };
  };
  await pause(4000); // a browser that is slow has left out the shadow by then
  const drawn = await measure(4);
  await takePicture();
  await page.evaluate(() => (window.seen.draws = false));
  await pause(1000);
  const { each, rate } = await measure(6);
  await page.mouse.up();
  const [calls, triangles, script] = [each('calls'), each('triangles'), each('ScriptDuration', 1e3)];
  console.log(`${await text('scene')}: ${calls.toFixed(0)} draw calls, ${triangles.toFixed(0)} triangles; scripts ${script.toFixed(2)} ms, ` +
    `layout and style ${(each('LayoutDuration', 1e3) + each('RecalcStyleDuration', 1e3)).toFixed(2)} ms, main thread ${each('TaskDuration', 1e3).toFixed(2)} ms per frame; ` +
    `${rate.toFixed(0)} frames a second without the draw calls, ${drawn.rate.toFixed(0)} with them by software (${drawn.each('calls').toFixed(0)} calls)`);
  if (!(calls > 0 && calls <= MOST_CALLS)) throw new Error(`${calls} draw calls a frame; at most ${MOST_CALLS} are allowed`);
  if (!(triangles > 0 && triangles <= mostTriangles)) throw new Error(`${triangles} triangles a frame; at most ${mostTriangles} are allowed`);
  if (!(script > 0 && script <= MOST_SCRIPT_MS)) throw new Error(`${script} ms of scripts a frame; at most ${MOST_SCRIPT_MS} are allowed`);
});
