// A method that takes nearly all of a press is passive, and the page says that the press is not felt; under another one it does not. Words
// that stand on the page alone are explained where the pointer rests. Throws at the first step that fails.
import { page, pause, run, take, takePicture, text, until, value } from './chromium.mjs';

const said = async () => (await page.locator('#muted').isVisible()) && (await text('muted')) === 'press not felt';
const choose = async (name) => {
  const option = await page.locator('#method option', { hasText: name }).getAttribute('value');
  await page.locator('#method').selectOption(option);
};

await run(async () => {
  await until('the page shows the run', async () => page.locator('#verdict').isVisible());
  for (const id of ['contact_spring_share', 'stale', 'wanted'])
    if (!(await page.locator(`#values div:has(#${id})`).getAttribute('title'))) throw new Error(`${id} has no explanation`);
  await page.locator('#tour-begin').click();
  await until('the tour has begun', async () => (await text('tour-text')).startsWith('Drag'));
  const to = await take();
  await to(0.09);
  await until('the robot presses', async () => (await value('environment')) > 2);
  await until('the page says that nothing is felt', said);
  // What the press has set in motion dies away first.
  await until('the badge says passive', async () => (await text('verdict')) === 'passive', 20000);
  await until('so does the tour', async () => (await text('tour-text')).includes('FORCE_PROJECTED holds no press here'));
  console.log(`${await text('muted')}: ${(await value('felt')).toFixed(2)} N felt of ${(await value('environment')).toFixed(2)} N; ${await page.locator('#muted').getAttribute('title')}`);
  await page.mouse.up();
  await page.locator('#tour-end').click();
  await page.locator('#home').click();
  await until('robot and hand are home', async () => (await text('held')) === 'handle free' && Number(await page.locator('#picture').getAttribute('data-from-home')) < 5, 20000);
  await choose('INTERNAL_MODEL');
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');
  const again = await take();
  await again(0.04);
  await until('it is felt', async () => (await value('felt')) > 2);
  await pause(2500);
  if (await said()) throw new Error('a press that is felt is said not to be');
  await takePicture();
  await page.mouse.up();
});
