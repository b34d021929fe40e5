// Drags the hand into the wall, changes sliders, closes the tab. Prints one line for each step; throws at the first that fails.
// Afterwards the caller checks that the robot was let go.
import { context, coupled, page, pause, run, set, takePicture, text, there, until, url, value } from './chromium.mjs';

const started = Date.now();
const say = (line) => console.log(`${((Date.now() - started) / 1000).toFixed(1)} s: ${line}`);

await run(async () => {
  const empty = await page.locator('header .state').evaluateAll((all) => all.filter((s) => s.offsetParent && !s.textContent.trim()).length);
  if (empty > 0) throw new Error('a state in the header is empty');
  await until('both sides wait for a hand', async () => (await text('mode')) === 'master: waiting for a hand' && (await text('slave-mode')) === 'slave: waiting for a hand');
  say('the page shows that nobody holds the handle');
  if ((await value('felt')) > 0.2) throw new Error(`a force is felt before the drag: ${await text('felt')}`);

  const box = await page.locator('#picture').boundingBox();
  const [x, y] = [box.x + 0.45 * box.width, box.y + 0.5 * box.height];
  const scale = Number(await page.locator('#zoom').inputValue());
  await page.mouse.move(x, y);
  await page.mouse.down();
  await until('the handle is held', async () => (await text('held')) === 'handle held');
  await coupled();
  await page.mouse.move(x + 0.045 * scale, y, { steps: 30 });
  await until('a force above 1 N is felt', async () => (await value('felt')) > 1);
  await pause(1500);
  const soft = await value('felt');
  const robot = await value('environment');
  say(`dragged 45 mm, 25 mm of it into the wall: ${soft.toFixed(2)} N felt, ${robot.toFixed(2)} N on the environment`);
  if (robot < 1) throw new Error('the robot does not press the wall');

  await set('grip', 1200);
  await until('a stiffer hand feels a larger force', async () => (await value('felt')) > 1.2 * soft);
  await pause(1000);
  say(`stiffness of the hand 1200 N/m: ${(await value('felt')).toFixed(2)} N felt`);
  await takePicture();

  // The wall becomes softer while it is pressed, and stiff again.
  const stiff = await value('felt');
  await until('the slave tells the stiffness of its wall', async () => (await there('stiffness')) === 3000 && (await page.locator('#stiffness').isEnabled()));
  if (await page.locator('#friction').isEnabled()) throw new Error('friction can be changed on a line');
  await set('stiffness', Math.log10(300));
  await until('the slave has a wall of 300 N/m', async () => Math.abs((await there('stiffness')) / 300 - 1) < 1e-3);
  await until('a softer wall is felt as a smaller force', async () => (await value('felt')) < 0.75 * stiff);
  await pause(1000);
  if (!((await value('environment-energy')) < -1)) throw new Error(`work of a wall that becomes softer: ${await text('environment-energy')}`);
  say(`wall of 300 N/m: ${(await value('felt')).toFixed(2)} N felt, work of the change ${await text('environment-energy')}`);
  await set('stiffness', Math.log10(3000));
  await until('the stiff wall is felt again', async () => Math.abs((await value('felt')) / stiff - 1) < 0.1 && Math.abs((await there('stiffness')) / 3000 - 1) < 1e-3);
  say(`wall of 3000 N/m: ${(await value('felt')).toFixed(2)} N felt, work of both changes ${await text('environment-energy')}`);

  const before = await value('round-trip');
  await set('to_slave-delay_ms', 40);
  await until('the round trip grows by 80 ms', async () => Math.abs((await value('round-trip')) - before - 80) < 10);
  say(`delay 40 ms each way: round trip ${before.toFixed(1)} -> ${(await value('round-trip')).toFixed(1)} ms`);
  await set('to_slave-loss', 20);
  await until('packets are lost', async () => Math.abs((await value('loss')) - 20) < 8);
  say(`loss 20 %: ${(await value('loss')).toFixed(1)} % of the packets from the slave are lost`);
  await set('to_slave-loss', 0);
  await set('to_slave-delay_ms', 0);

  await page.mouse.up();
  await until('the handle is free', async () => (await text('held')) === 'handle free');
  await until('the force vanishes', async () => (await value('felt')) < 0.2);
  say('pointer released: the handle is free and feels no force');

  // By keyboard, and closed while it presses.
  await page.locator('#picture').focus();
  await page.keyboard.press('Space');
  await until('the keyboard holds the handle', async () => (await text('held')) === 'handle held');
  for (let i = 0; i < 60 && (await value('felt')) < 2; ++i) {
    await page.keyboard.press('ArrowRight');
    await pause(40);
  }
  await until('the keyboard presses the wall', async () => (await value('felt')) > 1);
  say(`moved by keyboard: ${(await value('felt')).toFixed(2)} N felt`);

  // A second page watches while the first one is closed.
  const watcher = await context.newPage();
  await watcher.goto(url);
  const watched = async (id) => Number(await watcher.locator(`#${id}`).getAttribute('data-value'));
  await until('the second page sees the force', async () => (await watched('environment')) > 1);
  await page.close({ runBeforeUnload: false });
  const end = Date.now() + 10000;
  while (!((await watched('environment')) < 0.2 && (await watcher.locator('#held').textContent()) === 'handle free')) {
    if (Date.now() > end) throw new Error('the robot presses the wall although the tab is closed');
    await pause(50);
  }
  say('the tab is closed: the handle is free and the robot does not press the wall');
});
