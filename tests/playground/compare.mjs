// node compare.mjs URL CHROMIUM MODULES [PICTURE.png]: one hand, two methods with a robot each, over the same delay; then the picture of six
// axes. Prints one line for each step; throws at the first that fails.
import { context, page, pause, picture, run, set, text, until, value } from '../page/chromium.mjs';

const say = (line) => console.log(line);
const second = (name) => page.locator(`#second-caption .${name}`);
const shot = (name) => picture && page.screenshot({ path: picture.replace(/[.]png$/, `_${name}.png`) });
const choose = async (id, name) => page.locator(`#${id}`).selectOption({ label: name });
const options = (id) => page.locator(`#${id} option`).allTextContents();

// What is heard of either run, and what a gamepad is told.
await context.addInitScript(() => {
  const all = [], set = AudioParam.prototype.setTargetAtTime;
  window.heard = { loud: [0, 0], rumble: 0 };
  AudioParam.prototype.setTargetAtTime = function (value, ...more) {
    if (!all.includes(this)) all.push(this);
    window.heard.loud[all.indexOf(this)] += value;
    return set.call(this, value, ...more);
  };
  const playEffect = async (_, { strongMagnitude }) => (window.heard.rumble = Math.max(window.heard.rumble, strongMagnitude));
  navigator.getGamepads = () => [{ vibrationActuator: { playEffect } }];
});

await run(async () => {
  await until('the page has a scene', async () => (await text('connection')) === 'connected');
  await set('to_slave-delay_ms', 60);
  const none = (await options('compare')).find((m) => m.startsWith('NONE'));
  await choose('compare', none);
  await until('both runs are shown', async () => (await second('name').textContent()) === none && (await page.locator('#first-caption .state').textContent()) === 'passive');
  const box = await page.locator('#picture').boundingBox(), scale = Number(await page.locator('#zoom').inputValue());
  const [x, y] = [box.x + 0.45 * box.width, box.y + 0.5 * box.height];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await until('both sides are coupled', async () => (await text('mode')) === 'master: coupled' && (await text('slave-mode')) === 'slave: coupled');
  await page.mouse.move(x + 0.05 * scale, y, { steps: 20 });
  await until('without control the hand is paid', async () => /spent/.test(await second('hand').textContent()), 30000);
  await until('and the badge says so', async () => ['not passive', 'unstable'].includes(await second('state').textContent()));
  await shot('pair');
  await page.locator('#sound').evaluate((b) => b.click()); // the mouse holds the handle
  await pause(3000);
  const { loud, rumble } = await page.evaluate(() => window.heard);
  say(`heard: left ${loud[0].toFixed(1)}, right ${loud[1].toFixed(1)}; rumble ${rumble.toFixed(2)}`);
  if (!(loud[1] > 5 * loud[0]) || !(rumble > 0)) throw new Error('the difference is not heard');
  const first = await page.locator('#first-caption .state').textContent();
  say(`${await page.locator('#first-caption .name').textContent()}: ${first}, ${await text('budget-left')}; ${none}: ${await second('state').textContent()}, ${await second('hand').locator('output').textContent()}`);
  if (first !== 'passive') throw new Error('the first one is not passive');
  if (Math.abs((await value('round-trip')) - 120) > 10) throw new Error('the comparison has changed the network');
  await page.mouse.up();

  // The budget of both ports, where the layer bounds the robot's.
  if (!/Not bounded/.test(await second('both').textContent())) throw new Error('NONE bounds no port');
  await choose('compare', (await options('compare')).find((m) => m.startsWith('FORCE_PROJECTED')));
  await until('FORCE_PROJECTED has a budget for both ports', async () => /of 2\.00\smJ left/.test(await second('both').textContent()));
  say(`FORCE_PROJECTED, both ports: ${await second('both').locator('output').textContent()}`);
  await choose('compare', 'nothing');
  await until('one picture is left', async () => !(await page.locator('#second').isVisible()));

  // Six axes by WebGL: the view turns by the right button, and Fit shows the arm.
  await page.locator('#playground-scene').selectOption('assembly');
  await until('the assembly is drawn', async () => (await page.locator('#picture').getAttribute('data-solid')) === 'true' && (await text('verdict')) === 'passive');
  // The solids alone, small, right after they are drawn.
  const seen = () => page.evaluate(() => new Promise((done) => requestAnimationFrame(() => {
    const small = new OffscreenCanvas(120, 60).getContext('2d');
    small.drawImage(document.querySelector('#picture canvas'), 0, 0, 120, 60);
    done(Array.from(small.getImageData(0, 0, 120, 60).data));
  })));
  await pause(1000);
  const before = await seen();
  const frames = await page.evaluate(() => new Promise((done) => {
    let count = 0;
    const end = performance.now() + 3000, next = () => (performance.now() < end ? (++count, requestAnimationFrame(next)) : done(count / 3));
    next();
  }));
  say(`assembly: ${frames.toFixed(0)} frames a second (no graphics processor: software rendering)`);
  await shot('assembly');
  await page.mouse.move(x, y);
  await page.mouse.down({ button: 'right' });
  await page.mouse.move(x + 120, y + 40, { steps: 5 });
  await page.mouse.up({ button: 'right' });
  await pause(300);
  const after = await seen(), changed = after.filter((x, i) => Math.abs(x - before[i]) > 20).length;
  say(`turned by the right button: ${changed} of ${after.length} values of the picture change`);
  if (!(changed > 500)) throw new Error('the view does not turn');
  if ((await text('held')) === 'handle held') throw new Error('the right button holds the handle');
  await shot('turned');
  await page.locator('#fit').click();
  await pause(1500);
  await shot('fit');
});
