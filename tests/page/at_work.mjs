// Clutch, re-homing, locks and scales from the live page. Prints one line for each step; throws at the first that fails.
import { coupled, page, pause, run, set, take, takePicture, text, until, value } from './chromium.mjs';

const chip = (words) => until(`the page says "${words}"`, async () => (await text('clutched')) === words || (words === '' && !(await page.locator('#clutched').isVisible())));
const stays = async (before, what) => {
  const now = await value('environment');
  if (!(Math.abs(now - before) < 0.05 * before)) throw new Error(`${what}: the robot pressed the wall with ${before} N, now with ${now} N`);
};

await run(async () => {
  const to = await take();
  await to(0.04);
  await until('the wall is felt', async () => (await value('felt')) > 1);
  await pause(1000);
  const pressed = await value('environment'), felt = await value('felt');

  // With the key: the pointer goes on dragging, 50 mm back.
  await page.keyboard.down('x');
  await chip('clutched');
  await until('the hand feels nothing', async () => (await value('felt')) === 0);
  await to(-0.01);
  await pause(1000);
  await stays(pressed, 'clutched');
  await takePicture();
  await page.keyboard.up('x');
  await chip('');
  await until('the wall is felt again', async () => (await value('felt')) > 0.2);
  console.log(`pressed ${pressed.toFixed(2)} N, felt ${felt.toFixed(2)} N; clutched and 50 mm back: felt again ${(await value('felt')).toFixed(2)} N`);
  await page.mouse.up();

  // With the button: the keyboard holds the handle.
  await page.locator('#picture').focus();
  await page.keyboard.press('Space');
  await until('the handle is held', async () => (await text('held')) === 'handle held');
  await coupled();
  for (let i = 0; i < 60 && (await value('felt')) < 1; ++i) await page.keyboard.press('ArrowRight');
  await pause(1000);
  const again = await value('environment');
  const button = await page.locator('#clutch').boundingBox();
  await page.mouse.move(button.x + 5, button.y + 5);
  await page.mouse.down();
  await chip('clutched');
  if ((await page.locator('#clutch').getAttribute('aria-pressed')) !== 'true') await until('the button looks pressed', async () => (await page.locator('#clutch').getAttribute('aria-pressed')) === 'true');
  for (let i = 0; i < 20; ++i) await page.keyboard.press('ArrowLeft');
  await pause(500);
  await stays(again, 'clutched by the button');
  if ((await text('held')) !== 'handle held') throw new Error('the button took the focus from the handle');
  await page.mouse.up();
  await chip('');
  await page.locator('#rehome').click();
  await until('no force is left', async () => (await value('felt')) < 0.1 && !(await page.locator('#clutched').isVisible()));
  console.log(`re-homed: felt ${(await value('felt')).toFixed(3)} N`);

  // A lock: the hand feels nothing, the robot stays.
  for (let i = 0; i < 60 && (await value('felt')) < 1; ++i) await page.keyboard.press('ArrowRight');
  await pause(1000);
  const locked = await value('environment');
  await page.locator('#locks input').first().evaluate((box) => box.click());
  await until('the locked axis is not felt', async () => (await value('felt')) < 0.01);
  for (let i = 0; i < 10; ++i) await page.keyboard.press('ArrowLeft');
  await pause(500);
  await stays(locked, 'locked');
  await page.locator('#locks input').first().evaluate((box) => box.click());
  console.log(`locked: the wall kept ${locked.toFixed(2)} N`);

  // Scales: what the master has comes back to the sliders.
  await set('motion', 50);
  await set('force', 40);
  await pause(1500);
  if ((await text('motion-value')) !== '50 %' || (await text('force-value')) !== '40 %') throw new Error('the master has other scales');
  console.log('motion 50 %, force 40 %');
});
