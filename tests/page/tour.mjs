// The tour from a wall, or with two arms a table, to the budget, done as it says; then home. Prints one line for each step; throws at the first that fails.
import { page, pause, run, take, takePicture, text, until, value } from './chromium.mjs';

const done = (step) => until(`step ${step} is done`, async () => (await text('tour-step')) .startsWith(`${step} `) && (await text('tour-step')).includes('✓'), 40000);
const verdict = () => text('verdict');

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  const table = (await text('scene')).includes('joints');
  if (table) await page.locator('#view').selectOption({ label: 'x – z' });
  await page.locator('#tour-begin').click();
  if (!(await text('tour-text')).includes(table ? ' down until' : ' to the right until')) throw new Error(`the way to the wall: ${await text('tour-text')}`);
  const to = await take(table ? [0, 1] : [1, 0]);
  await to(0.045);
  await done(1);
  if ((await verdict()) !== 'passive') throw new Error(`at a wall: ${await verdict()}`);
  await page.locator('#tour-next').evaluate((b) => b.click());
  await page.locator('#tour-do').evaluate((b) => b.click());
  await done(2);
  await page.locator('#tour-next').evaluate((b) => b.click());
  await page.locator('#tour-do').evaluate((b) => b.click());
  if (!table) { // an arm's limits are far
    await to(0.09);
    await until('the tour says to press less', async () => /Press less/.test(await text('tour-text')));
    await to(0.045);
  }
  await done(3);
  console.log(`NONE at 60 ms each way: ${await verdict()}, ${await text('budget-left')}; ${await page.locator('#verdict').getAttribute('title')}`);
  await until('the gauge shows that the budget is spent', async () => (await text('budget-left')).startsWith('spent'), 20000);
  await takePicture();
  // It has flown off, or is about to: the picture follows.
  for (let i = 0; i < 10; ++i) {
    await until('hand and robot are in the picture', async () => (await page.locator('#picture').getAttribute('data-in-view')) === 'true', 3000);
    await pause(100);
  }
  await page.locator('#tour-next').evaluate((b) => b.click());
  await page.locator('#tour-do').evaluate((b) => b.click());
  await done(4);
  console.log(`the cure: ${await verdict()}, ${await text('budget-left')}`);
  await page.locator('#tour-next').evaluate((b) => b.click());
  for (let i = 0; i < 20 && !(await text('tour-step')).includes('✓'); ++i) {
    await to(0.0);
    await pause(250);
    await to(0.05);
    await pause(250);
  }
  await done(5);
  console.log(`the budget: ${await text('budget-left')}`);
  await page.locator('#tour-next').evaluate((b) => b.click());
  if (await page.locator('#tour').isVisible()) throw new Error('the tour has not ended');
  await page.mouse.up();
  await page.locator('#home').click();
  await until('the hand is home', async () => (await text('held')) === 'handle free' && Math.abs(await value('felt')) < 0.3, 20000);
});
