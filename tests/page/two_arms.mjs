// Two arms joint by joint: both are drawn on their bases, the follower goes where the leader's tool is dragged, and all joints' torques are
// plotted. Throws at the first step that fails.
import { readFile } from 'node:fs/promises';
import { page, pause, run, take, takePicture, text, until, value } from './chromium.mjs';

const COLUMN_M = 0.0675, APART_M = 0.6; // of the drawn Pandas: the lowest link's width, and from base to base

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  await until('they are drawn as solids', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true');
  if (!(await text('scene')).includes('7 joints')) throw new Error(`the scene: ${await text('scene')}`);
  for (const title of ['Torque displayed, by joint [N m]', 'Torque measured, by joint [N m]']) {
    const labels = await page.locator('#plots figcaption', { hasText: title }).locator('i').allTextContents();
    if (labels.join() !== '1,2,3,4,5,6,7') throw new Error(`${title}: ${labels.join()}`);
  }
  if (await page.locator('#work-controls').isVisible()) throw new Error('the page offers a clutch, which joints have not');

  // Seen along x, the lowest row of pixels with two runs as wide as the columns of both arms: x of their middles, y of the bases below.
  await page.locator('#view').selectOption({ label: 'y – z' });
  await page.locator('#fit').click();
  const columns = () => page.evaluate((ratio) => new Promise((done) => requestAnimationFrame(() => {
    const from = document.querySelector('#picture canvas'), copy = document.createElement('canvas');
    [copy.width, copy.height] = [from.width, from.height];
    const context = copy.getContext('2d', { willReadFrequently: true });
    context.drawImage(from, 0, 0);
    const { data, width, height } = context.getImageData(0, 0, copy.width, copy.height);
    for (let y = height - 1; y >= 0; --y) {
      const runs = [];
      for (let x = 0; x < width; ++x)
        if (data[4 * (y * width + x) + 3] === 255) runs.at(-1)?.[1] === x - 1 ? (runs.at(-1)[1] = x) : runs.push([x, x]);
      const middles = runs.map(([a, b]) => (a + b) / 2), wide = ratio * (middles[1] - middles[0]);
      if (runs.length !== 2 || runs.some(([a, b]) => Math.abs(b - a + 1 - wide) > 3)) continue;
      const below = (x) => Array.from({ length: height - y }, (_, i) => y + i).findLast((at) => data[4 * (at * width + x) + 3] === 255);
      return done([...middles, ...middles.map((x) => below(Math.round(x)))]);
    }
    done(null);
  })), COLUMN_M / APART_M);
  let stand = null;
  await until('both arms stand on their bases', async () => {
    const before = stand;
    await pause(1000); // the view comes to the chosen one frame by frame
    stand = await columns();
    return stand && before && stand.join() === before.join();
  }, 60000);

  await page.locator('#record').click();
  const to = await take([0, 1]);
  await to(0.05);
  await until('the follower presses the table', async () => (await value('environment')) > 2);
  await pause(4000);
  const [download] = await Promise.all([page.waitForEvent('download'), page.locator('#record').evaluate((b) => b.click())]);
  const now = await columns();
  if (!now || now.some((x, i) => Math.abs(x - stand[i]) > 2)) throw new Error(`the bases stood at ${stand}, and stand at ${now}`);
  const [names, ...rows] = (await readFile(await download.path(), 'utf8')).trim().split('\n').map((line) => line.split(','));
  // Means of the last second.
  const last = rows.slice(-500), mean = (name, of = last) => of.reduce((sum, row) => sum + Number(row[names.indexOf(name)]), 0) / of.length;
  const list = (name, size, of) => Array.from({ length: size }, (_, i) => mean(`${name}_${i}`, of));
  const far = (a, b) => Math.max(...a.map((x, i) => Math.abs(x - b[i])));
  const leader = list('leader_rad', 8), moved = far(list('leader_rad', 8, rows.slice(0, 1)), leader), apart = far(leader, list('joint_rad', 8));
  const felt = Math.hypot(...list('felt_n', 3)), pressed = Math.hypot(...list('environment_n', 3));
  const displayed = list('leader_torque', 8), measured = list('follower_torque', 8);
  console.log(`dragged 50 mm down, 20 mm of it into the table: ${felt.toFixed(2)} N felt of ${pressed.toFixed(2)} N; a joint moved by ${moved.toFixed(3)} rad, the follower's are within ${apart.toFixed(3)} rad; ` +
    `${displayed.map((x) => x.toFixed(2))} N m displayed of ${measured.map((x) => x.toFixed(2))}`);
  if (!(moved > 0.03 && apart < 0.4 * moved)) throw new Error('the follower does not go where the leader goes');
  if (!(Math.abs(felt / pressed - 1) < 0.2)) throw new Error('the hand does not feel what the follower presses');
  if (!(far(displayed, measured) < 0.2 * Math.hypot(...measured))) throw new Error('the leader does not display what the follower measures');

  await page.locator('#view').selectOption({ label: 'oblique' });
  await page.locator('#fit').evaluate((b) => b.click());
  await pause(2500);
  await takePicture();
  await page.mouse.up();
  await page.locator('#home').click();
  await until('the hand is home', async () => (await text('held')) === 'handle free' && Math.abs(await value('felt')) < 0.5, 20000);
});
