// A follower's fingers push the box of the scene: the page draws it where the simulated robot has it. Throws at the first step that fails.
import { readFile } from 'node:fs/promises';
import { page, pause, run, take, takePicture, text, until } from './chromium.mjs';

// Middle of what is drawn in the box's colour [pixels], and how many there are.
const drawn = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => {
  const from = document.querySelector('#picture canvas'), copy = document.createElement('canvas');
  [copy.width, copy.height] = [from.width, from.height];
  const context = copy.getContext('2d', { willReadFrequently: true });
  context.drawImage(from, 0, 0);
  const { data, width } = context.getImageData(0, 0, copy.width, copy.height);
  let count = 0, sum = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [r, g, b, a] = data.slice(i, i + 4);
    if (a === 255 && b > r + 15 && r > g + 10) ++count, (sum += (i / 4) % width);
  }
  done({ count, x: sum / count });
})));

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand', 40000);
  await page.locator('#view').selectOption({ label: 'y – z' });
  await pause(1000);
  const scale = Number(await page.locator('#zoom').inputValue()), before = await drawn();
  console.log(`the box: ${before.count} pixels`);
  if (!(before.count > 0.2 * 0.06 * 0.06 * scale ** 2)) throw new Error('the box is not drawn');
  await page.locator('#record').click();
  const down = await take([0, 1]);
  await down(0.12);
  await pause(2000);
  const box = await page.locator('#picture').boundingBox(), x = box.x + 0.45 * box.width, y = box.y + 0.5 * box.height + 0.12 * scale;
  await page.mouse.move(x + 0.06 * scale, y, { steps: 20 });
  await pause(4000);
  const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#record').evaluate((b) => b.click())]);
  const after = await drawn();
  const [names, ...rows] = (await readFile(await download.path(), 'utf8')).trim().split('\n').map((line) => line.split(','));
  const place = (row, i) => Number(row[names.indexOf(`object_x_m_${i}`)]), first = rows[0], last = rows.at(-1);
  const moved_m = place(last, 1) - place(first, 1), drawn_m = (after.x - before.x) / scale;
  console.log(`pushed aside by ${(1e3 * moved_m).toFixed(1)} mm, drawn ${(1e3 * drawn_m).toFixed(1)} mm aside; its height ${(1e3 * place(first, 2)).toFixed(1)} mm`);
  await takePicture();
  if (Math.abs(place(first, 2) + 0.1204) > 1e-3) throw new Error('it did not stand on the table');
  if (!(moved_m > 0.01)) throw new Error('the fingers do not push it');
  if (!(Math.abs(drawn_m - moved_m) < 0.3 * moved_m)) throw new Error('it is drawn elsewhere');
  await page.mouse.up();
});
