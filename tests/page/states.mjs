// What is old looks old, a page that watches changes nothing, and the end of a run is said. Prints one line for each step; throws at the
// first that fails. Environment: SLAVE_PID, MASTER_PID. The slave is killed and the master ended.
import { context, page, pause, run, take, takePicture, text, there, until, url, value } from './chromium.mjs';

const slave = Number(process.env.SLAVE_PID), master = Number(process.env.MASTER_PID);
const isOld = (id) => page.locator(`#values > div:has(#${id})`).evaluate((row) => row.classList.contains('old'));
const shown = (id) => page.locator(`#${id}`).isVisible();

await run(async () => {
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: waiting for a hand');

  // A second page, with the controls at rest, and a connection that sends all the same.
  const watcher = await context.newPage();
  await watcher.goto(url);
  await until('the second page watches', async () => watcher.locator('#watching').isVisible(), 60000);
  for (const id of ['method', 'to_slave-delay_ms', 'grip', 'stiffness', 'clutch', 'motion'])
    if (await watcher.locator(`#${id}`).isEnabled()) throw new Error(`${id} can be moved on the page that watches`);
  const attack = () =>
    watcher.evaluate(async () => {
      const socket = new WebSocket(`ws://${location.host}/live`);
      await new Promise((r) => (socket.onopen = r));
      for (const line of ['grip 2000', 'network to_slave 200 0 0', 'network to_master 0 0 0.9', 'surface 0 300 0', 'method 2', 'clutch 1', 'lock 7', 'scale 0.05 0', 'release', 'restart'])
        socket.send(line);
      await new Promise((r) => setTimeout(r, 1500));
      socket.close();
    });
  await page.bringToFront();
  const to = await take();
  await to(0.045);
  await until('a force is felt', async () => (await value('felt')) > 1);
  await pause(2000); // until it rests
  const before = { method: await page.locator('#method').inputValue(), felt: await value('felt') };
  await attack();
  const trip = await value('round-trip');
  if (trip > 150) throw new Error(`a page that watches has delayed the network: ${trip} ms`);
  if ((await page.locator('#method').inputValue()) !== before.method) throw new Error('a page that watches has changed the method');
  if ((await there('stiffness')) !== 3000) throw new Error('a page that watches has changed the wall');
  if (Math.abs((await value('felt')) - before.felt) > 1) throw new Error('a page that watches has changed the grip');
  if ((await page.locator('#clutched').isVisible()) || (await page.locator('#locks input').first().isChecked()) || (await page.locator('#motion').inputValue()) !== '100')
    throw new Error('a page that watches has clutched, locked or scaled');
  if ((await value('loss')) > 30) throw new Error('a page that watches has lost packets');
  console.log('a page that watches changes nothing');
  await page.mouse.up();
  await until('the handle is free', async () => (await text('held')) === 'handle free');
  await watcher.locator('#take').click();
  await until('the second page has taken over', async () => page.locator('#watching').isVisible());
  await page.locator('#take').click();
  await until('and the first one again', async () => watcher.locator('#watching').isVisible());
  await watcher.close();

  // The master stands still.
  process.kill(master, 'SIGSTOP');
  await until('the page shows that the master is silent', async () => (await text('connection')).startsWith('master silent'), 2000);
  const silent = Number(/[\d.]+/.exec(await text('connection'))[0]);
  console.log(`master stopped: first seen as "${await text('connection')}"`);
  if (silent > 1) throw new Error(`seen after ${silent} s`);
  if (!(await isOld('felt')) || (await shown('mode'))) throw new Error('its values do not look old');
  process.kill(master, 'SIGCONT');
  await until('it goes on', async () => (await text('connection')) === 'connected' && !(await isOld('felt')));

  // The slave dies.
  process.kill(slave, 'SIGKILL');
  await until('the page shows that the slave is silent', async () => (await text('slave-mode')).startsWith('slave: no report'), 2000);
  const age = Number(/[\d.]+/.exec(await text('slave-mode'))[0]);
  console.log(`slave killed: first seen as "${await text('slave-mode')}"`);
  if (age > 1) throw new Error(`seen after ${age} s`);
  if (!(await isOld('environment')) || (await isOld('felt'))) throw new Error('the values of the slave, and only those, look old');
  await takePicture();

  process.kill(master, 'SIGINT');
  await until('the page says that the run is over', async () => (await shown('ended')) && /interrupted/.test(await text('ended')), 5000);
  await until('and nothing else', async () => (await text('connection')) === 'the run is over' && !(await shown('mode')) && !(await shown('slave-mode')), 5000);
  console.log(await text('ended'));
  for (const id of ['method', 'home', 'clutch']) if (await page.locator(`#${id}`).isEnabled()) throw new Error(`${id} can be used when the run is over`);
  await pause(700);
  if ((await page.locator('.state.bad:visible').count()) > 0) throw new Error('a red state beside the end of the run');
}, { errors: false });
