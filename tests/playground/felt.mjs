// node felt.mjs URL CHROMIUM MODULES [PICTURE.png]: opens the playground's file, presses the wall, and compares what is felt with
//
//     F (1/k_h + 1/K_c + 1/K) = x_t - x_wall       hand, coupling and wall as springs one behind the other
import { page, pause, run, set, takePicture, text, until, value } from '../page/chromium.mjs';

const say = (line) => console.log(line);

await run(async () => {
  await until('the page has a scene', async () => (await text('connection')) === 'connected');
  const box = await page.locator('#picture').boundingBox();
  const [x, y] = [box.x + 0.4 * box.width, box.y + 0.5 * box.height];
  const scale = Number(await page.locator('#zoom').inputValue());
  const press_m = Math.round(0.045 * scale) / scale;
  await page.mouse.move(x, y);
  await page.mouse.down();
  await until('both sides are coupled', async () => (await text('mode')) === 'master: coupled' && (await text('slave-mode')) === 'slave: coupled');
  await page.mouse.move(x + press_m * scale, y, { steps: 30 });
  const felt = async (k) => {
    const wanted = (press_m - 0.03) / (1 / 400 + 1 / 1000 + 1 / k);
    await until(`${wanted.toFixed(2)} N are felt`, async () => Math.abs((await value('felt')) - wanted) < 0.02 * wanted, 20000);
    await pause(1000);
    const now = await value('felt');
    say(`wall of ${k} N/m: ${now.toFixed(3)} N felt, by the closed form ${wanted.toFixed(3)} N`);
    if (Math.abs(now - wanted) > 0.02 * wanted) throw new Error('that is not the same');
  };
  await felt(3000);
  const drawn = await page.evaluate(() => {
    const plot = [...document.querySelectorAll('#plots figure')].find((f) => f.textContent.startsWith('Round trip')).querySelector('canvas');
    const { data } = plot.getContext('2d').getImageData(0, 0, plot.width, plot.height);
    return data.filter((blue, i) => i % 4 === 2 && blue > data[i - 2] + 60).length;
  });
  if (!(drawn > 20)) throw new Error('no curve of the round trip, which was not known in the first moments');
  await takePicture();
  await set('stiffness', 3);
  await felt(1000);
  await set('to_slave-delay_ms', 40);
  await until('the round trip grows to 80 ms', async () => Math.abs((await value('round-trip')) - 80) < 5);
  await set('to_slave-loss', 20);
  await until('packets are lost', async () => Math.abs((await value('loss')) - 20) < 8);
  await felt(1000);
  say(`round trip ${await text('round-trip')}, ${await text('loss')} of the packets lost`);
  await page.mouse.up();
  await until('the handle is free', async () => (await text('held')) === 'handle free');
  await until('the force vanishes', async () => (await value('felt')) < 0.2);
  for (const scene of ['one_axis', 'six_axes', 'assembly']) {
    await page.locator('#playground-scene').selectOption(scene);
    await until(`${scene} begins`, async () => (await text('scene')).length > 0);
    await pause(500);
  }
});
