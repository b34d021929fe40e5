// A ring as the tool and a ring in the environment, both meshes: one sees through them. Throws at the first step that fails.
import { page, pause, run, takePicture, text, until } from './chromium.mjs';

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  await until('six axes are drawn as solids', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true');
  const scene = await page.evaluate(
    () => new Promise((done) => {
      const socket = new WebSocket(`ws://${location.host}/live`);
      socket.onmessage = ({ data }) => (socket.close(), done(JSON.parse(data)));
    }),
  );
  for (const { vertices_m: vertices, triangles } of [...scene.meshes, ...scene.tool_parts])
    if (triangles.length < 3000 || triangles.length > 15000 || Math.max(...triangles) !== vertices.length / 3 - 1) throw new Error(`a mesh has ${triangles.length / 3} triangles`);
  if (scene.meshes.length !== 1 || scene.tool_parts.length !== 1 || scene.tool_alone !== 0) throw new Error('the meshes are not told');
  // What is drawn in the middle of the tool, beside it in the environment's ring, and in the empty corner.
  await page.locator('#view').selectOption({ label: 'x – z' });
  await pause(500);
  const [through, tool, below] = await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => {
    const from = document.querySelector('#picture canvas'), copy = document.createElement('canvas'), scale = Number(document.getElementById('zoom').value);
    [copy.width, copy.height] = [from.width, from.height];
    copy.getContext('2d').drawImage(from, 0, 0);
    const at = (x_m, z_m) => copy.getContext('2d').getImageData(0.45 * copy.width + x_m * scale, 0.5 * copy.height - z_m * scale, 1, 1).data[3];
    done([at(0.002, -0.002), at(0.025, 0.002), at(0.06, -0.045)]);
  })));
  if (through !== 0) throw new Error('the ring of the tool is filled');
  if (tool !== 255 || below !== 255) throw new Error(`the rings are not drawn: opacity ${tool}, ${below}`);
  await page.locator('#view').selectOption({ label: 'oblique' });
  await pause(1500);
  await takePicture();
});
