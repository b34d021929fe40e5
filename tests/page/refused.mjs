// A slave whose environment cannot be changed: the page says why (the environment variable REASON has a part of the sentence), its sliders
// are disabled, and a command that is sent all the same changes nothing. Throws at the first step that fails.
import { page, run, takePicture, text, until, value } from './chromium.mjs';

const reason = process.env.REASON;
if (!reason) throw new Error('REASON is not set');

await run(async () => {
  await until('the page says why', async () => (await text('environment-note')).includes(reason));
  if (await page.locator('#stiffness').isEnabled()) throw new Error('the stiffness can be moved');
  if (await page.locator('#friction').isEnabled()) throw new Error('the friction can be moved');
  const disabled = await page.locator('#stiffness').getAttribute('data-there');
  // By hand, through a connection of its own.
  await page.evaluate(async () => {
    const socket = new WebSocket(`ws://${location.host}/live`);
    await new Promise((r) => (socket.onopen = r));
    socket.send('surface 0 300 0');
    await new Promise((r) => setTimeout(r, 1000));
    socket.close();
  });
  if ((await value('environment-energy')) !== 0) throw new Error('a change has done work');
  if ((await page.locator('#stiffness').getAttribute('data-there')) !== disabled) throw new Error('the stiffness has changed');
  if (!(await text('environment-note')).includes(reason)) throw new Error('the answer has changed');
  console.log(`disabled: ${await text('environment-note')}`);
  await takePicture();
});
