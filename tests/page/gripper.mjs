// Opens and closes the gripper from the live page. Prints one line for each step; throws at the first that fails.
import { coupled, page, pause, run, takePicture, text, until, value } from './chromium.mjs';

await run(async () => {
  await until('the gripper is open', async () => Math.abs((await value('gripper-hand')) - 60) < 0.5);
  await page.locator('#picture').focus();
  await page.keyboard.press('Space');
  await until('the handle is held', async () => (await text('held')) === 'handle held');
  await coupled();
  for (let i = 0; i < 30; ++i) await page.keyboard.press('c');
  await until('the object is felt', async () => (await value('gripper-felt')) > 1.5);
  await pause(1500);
  const fingers = await value('gripper-robot');
  console.log(`closed to 30 mm: fingers at ${fingers.toFixed(1)} mm, ${(await value('gripper-felt')).toFixed(2)} N felt`);
  if (!(fingers < 40 && fingers > 37)) throw new Error('the fingers do not squeeze the object');
  await takePicture();
  for (let i = 0; i < 25; ++i) await page.keyboard.press('o');
  await until('the fingers open', async () => (await value('gripper-robot')) > 50 && Math.abs(await value('gripper-felt')) < 0.3);
  console.log(`opened to 55 mm: fingers at ${(await value('gripper-robot')).toFixed(1)} mm`);
});
