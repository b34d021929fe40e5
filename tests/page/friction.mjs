// Slides along a wall with friction, and changes the friction from the page. Prints one line for each step; throws at the first that fails.
import { coupled, page, pause, run, set, takePicture, text, there, until, value } from './chromium.mjs';

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  await until('the slave tells its friction', async () => (await there('friction')) === 0.2 && (await page.locator('#friction').isEnabled()));
  const box = await page.locator('#picture').boundingBox();
  const [x, y] = [box.x + 0.45 * box.width, box.y + 0.4 * box.height];
  const scale = Number(await page.locator('#zoom').inputValue());
  await page.mouse.move(x, y);
  await page.mouse.down();
  await coupled();
  await page.mouse.move(x + 0.045 * scale, y, { steps: 30 });
  await until('the wall is felt', async () => (await value('felt')) > 1);
  await pause(1500);
  await takePicture();
  await set('friction', 1);
  await until('the slave has a friction of 1', async () => (await there('friction')) === 1);
  // Along the wall: with friction 1 the robot stays behind the hand, with 0 it follows.
  const aside = async () => {
    for (let i = 1; i <= 20; ++i) {
      await page.mouse.move(x + 0.045 * scale, y - 0.015 * scale * (i / 20));
      await pause(20);
    }
    await pause(1500);
    return value('behind');
  };
  const rough = await aside();
  await set('friction', 0);
  await until('the slave has no friction', async () => (await there('friction')) === 0);
  await pause(1500);
  const smooth = await value('behind');
  console.log(`moved 15 mm along the wall: the robot is ${rough.toFixed(1)} mm behind with friction 1, ${smooth.toFixed(1)} mm with 0`);
  if (!(rough > smooth + 0.5)) throw new Error('friction holds nothing back');
  if ((await value('environment-energy')) !== 0) throw new Error('friction stores no energy');
  // Both ports have a budget where the method bounds the robot's. The wall that is pressed has got energy from the robot.
  if (!/Not bounded/.test(await text('both-left'))) throw new Error(`the method of the scene: ${await text('both-left')}`);
  const methods = await page.locator('#method option').allTextContents();
  await page.locator('#method').selectOption(String(methods.findIndex((m) => m.startsWith('FORCE_PROJECTED'))));
  await until('FORCE_PROJECTED bounds both ports', async () => /of 2\.00\smJ left/.test(await text('both-left')));
  console.log(`FORCE_PROJECTED: ${await text('budget-left')}; with the robot's port ${await text('both-left')}`);
  const hand = await value('hand-energy'), both = 1e3 * (await value('both-left')) - 2;
  if (!(hand > 2 && both < hand - 1)) throw new Error(`${hand} mJ in at the hand, ${both} mJ at both ports`);
  // The sphere is another surface.
  await page.locator('#surface').selectOption({ label: 'sphere' });
  await until('the sliders show the sphere', async () => (await there('stiffness')) === 2000);
});
