// The tour from a wall, or with two arms a table, to the budget, by somebody who lets go of the handle after each press; then home. Prints
// one line for each step; throws at the first that fails.
import { page, pause, run, set, take, takePicture, text, there, until } from './chromium.mjs';

const verdict = () => text('verdict');
const fromHome = async () => Number(await page.locator('#picture').getAttribute('data-from-home'));
const gauge = () => page.locator('#gauge span').evaluate((bar) => bar.getBoundingClientRect().width);
const click = (id) => page.locator(`#${id}`).evaluate((b) => b.click());
const free = () => until('the handle is free, and both sides wait', async () => (await text('held')) === 'handle free' && (await text('mode')) === 'master: waiting for a hand' && (await text('slave-mode')) === 'slave: waiting for a hand');

await run(async () => {
  await free();
  const table = (await text('scene')).includes('joints'), direction = table ? [0, 1] : [1, 0];
  if (table) await page.locator('#view').selectOption({ label: 'x – z' });
  const wall = await there('stiffness');

  /// A step begins, or what it asks for is done: everything is as at the beginning but for these two.
  const begins = async (button, delay_ms, method) => {
    const before = await fromHome(), began = Date.now();
    await click(button);
    await pause(200);
    await until('hand and robot have gone back', async () => !(await text('tour-text')).startsWith('Hand and robot go back'), 30000);
    await until('they are where they began', async () => (await fromHome()) < 5, 8000);
    const chosen = await page.locator('#method').evaluate((m) => m.selectedOptions[0].text), is = [await page.locator('#to_slave-delay_ms').inputValue(), await fromHome(), await there('stiffness')];
    console.log(`${await text('tour-step')} ${chosen}, ${is[0]} ms, ${before.toFixed(0)} -> ${is[1].toFixed(1)} mm from the beginning in ${((Date.now() - began) / 1000).toFixed(1)} s`);
    if (!chosen.startsWith(method)) throw new Error(`it begins with ${chosen}`);
    if (is[0] !== String(delay_ms)) throw new Error(`it begins with ${is[0]} ms`);
    if (is[2] !== wall) throw new Error(`it begins with ${is[2]} N/m`);
    await until('the handle is let go', async () => (await text('held')) === 'handle free', 5000);
  };
  const press = async (m, meanwhile = () => pause(1000)) => {
    const to = await take(direction);
    await to(m);
    await meanwhile(to);
    const pressing = await gauge();
    await page.mouse.up();
    await free();
    return pressing;
  };
  const done = (step) => until(`step ${step} is done`, async () => (await text('tour-step')).startsWith(`${step} `) && (await text('tour-step')).includes('✓'), 40000);
  const [first] = (await page.locator('#method option').first().textContent()).split(',');

  await begins('tour-begin', 0, first);
  if (!(await text('tour-step')).includes(table ? 'A table.' : 'A wall.')) throw new Error(`the first step: ${await text('tour-step')}`);
  if (!(await text('tour-text')).includes(table ? ' down until the robot presses the table' : ' to the right until the robot presses the wall')) throw new Error(`the way to the wall: ${await text('tour-text')}`);
  await press(0.045);
  await done(1);
  if ((await verdict()) !== 'passive') throw new Error(`at a wall: ${await verdict()}`);

  await begins('tour-next', 0, first);
  await begins('tour-do', 60, first);
  await press(0.045);
  await done(2);
  if (!table) {
    await set('stiffness', 3);
    await until('the slave has a wall of 1000 N/m', async () => Math.abs((await there('stiffness')) - 1000) < 1);
  }

  await begins('tour-next', 60, first);
  await begins('tour-do', 60, 'NONE');
  await press(table ? 0.045 : 0.09, async (to) => {
    if (!table) { // an arm's limits are far
      await until('the tour says to press less, or is content', async () => /Press less/.test(await text('tour-text')) || (await text('tour-step')).includes('✓'));
      await to(0.045);
    }
    await done(3);
    await until('the gauge shows that the budget is spent', async () => (await text('budget-left')).startsWith('spent'), 20000);
    console.log(`NONE at 60 ms each way: ${await verdict()}, ${await text('budget-left')}; ${await page.locator('#verdict').getAttribute('title')}`);
    await takePicture();
    // It flies off: the picture follows.
    for (let i = 0; i < 10; ++i) {
      await until('hand and robot are in the picture', async () => (await page.locator('#picture').getAttribute('data-in-view')) === 'true', 3000);
      const arrows = await page.locator('#picture').getAttribute('data-readable');
      if (arrows !== 'true') throw new Error('an arrow leaves the picture, or a label is struck through');
      await pause(100);
    }
    if (table) await begins('tour-next', 60, 'NONE'); // arms that fly off come back by a restart only
  });
  if (!table) {
    if (!((await fromHome()) > 20)) throw new Error('without control a robot that is let go stays where it was');
    await begins('tour-next', 60, 'NONE');
  }
  await begins('tour-do', 60, first);
  await press(0.045);
  await done(4);
  console.log(`the cure: ${await verdict()}, ${await text('budget-left')}`);

  await begins('tour-next', 60, first);
  for (let i = 0; i < 6 && !(await text('tour-step')).includes('✓'); ++i) {
    if (table) { // arms that are thrown back drift
      await click('home');
      await until('hand and robot are home', async () => (await fromHome()) < 5, 20000);
      await free();
    }
    const pressing = await press(0.045), after = await gauge();
    console.log(`pressed and let go: ${pressing.toFixed(0)} -> ${after.toFixed(0)} pixels; ${await text('budget-left')}`);
    if (!table && !(after < pressing)) throw new Error('the gauge does not show what the hand gets back');
    if ((await text('budget-left')).startsWith('spent')) throw new Error('the hand got more than E(0)');
  }
  await done(5);
  await click('tour-next');
  if (await page.locator('#tour').isVisible()) throw new Error('the tour has not ended');
  await page.locator('#home').click();
  await until('hand and robot are home', async () => (await fromHome()) < 5, 20000);
  await free();
});
