// An arm with the shapes of its URDF: meshes, cylinders, a box and a sphere; what cannot be read is said. Throws at the first step that
// fails.
import { page, pause, run, takePicture, text, until } from './chromium.mjs';

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  await until('six axes are drawn as solids', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true');
  if (!/Link "wrist_1" is drawn by its collision shape: package:\/\/page\/wrist.dae is neither STL nor OBJ/.test(await text('hint')))
    throw new Error(`nothing is said of what cannot be read: ${await text('hint')}`);
  // The upper arm is a beam that is 140 mm wide at its lower end; the rod that stands for a link is 34 mm thick to each side.
  await page.locator('#view').selectOption({ label: 'x – z' });
  await page.locator('#zoom').evaluate((e) => ((e.value = '600'), e.dispatchEvent(new Event('input'))));
  const opacities = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => {
    const from = document.querySelector('#picture canvas'), copy = document.createElement('canvas'), scale = Number(document.getElementById('zoom').value);
    [copy.width, copy.height] = [from.width, from.height];
    copy.getContext('2d').drawImage(from, 0, 0);
    // From the tool at the origin, by `twoport-lab arm`; the upper arm begins at 0, 0.16 and leans back by 0.6 rad.
    const tool = [0.1744, 0.592], up = [Math.sin(-0.6), Math.cos(0.6)], across = [up[1], -up[0]];
    const at = (along_m, aside_m) => {
      const [x, z] = [0, 1].map((i) => [0, 0.16][i] + along_m * up[i] + aside_m * across[i] - tool[i]);
      return copy.getContext('2d').getImageData(0.45 * copy.width + x * scale, 0.5 * copy.height - z * scale, 1, 1).data[3];
    };
    done([at(0.12, 0.055), at(0.12, 0.08), at(0.12, -0.055), at(0.12, -0.08)].join(' '));
  })));
  // The view comes to the chosen one frame by frame.
  await until('the beam is drawn in its place, and nothing beside it', async () => (await opacities()) === '255 0 255 0');
  await page.locator('#view').selectOption({ label: 'oblique' });
  await page.locator('#fit').click();
  await pause(2500);
  await takePicture();
});
