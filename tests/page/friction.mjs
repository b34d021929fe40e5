// Slides along a wall with friction in Chromium, and changes the friction from the page. Prints one line for each step; throws at the
// first that fails.
//
//   node friction.mjs URL CHROMIUM MODULES [PICTURE.png]      MODULES: a node_modules folder with playwright-core
import { createRequire } from 'node:module';

const [url, chromiumPath, modules, picture] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)('playwright-core');

const browser = await chromium.launch({
  executablePath: chromiumPath,
  headless: true,
  args: ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
         '--disable-component-update', '--disable-sync'],
});
const context = await browser.newContext({ bypassCSP: true, viewport: { width: 1280, height: 1000 } });
const page = await context.newPage();
const errors = [];
page.on('pageerror', (e) => errors.push(String(e)));
page.on('console', (m) => m.type() === 'error' && errors.push(m.text()));

const value = async (id) => Number(await page.locator(`#${id}`).getAttribute('data-value'));
const text = (id) => page.locator(`#${id}`).textContent();
async function until(what, condition, patience_ms = 15000) {
  const end = Date.now() + patience_ms;
  while (!(await condition())) {
    if (Date.now() > end) {
      if (picture) await page.screenshot({ path: picture });
      throw new Error(`${what}: not within ${patience_ms} ms`);
    }
    await new Promise((r) => setTimeout(r, 50));
  }
}

async function set(id, to) {
  await page.locator(`#${id}`).evaluate((input, v) => {
    input.value = v;
    input.dispatchEvent(new Event('input'));
  }, String(to));
}
const there = async (id) => Number(await page.locator(`#${id}`).getAttribute('data-there'));

try {
  await page.goto(url);
  await until('both sides wait for a hand', async () => (await text('slave-mode')) === 'slave: let go');
  await until('the slave tells its friction', async () => (await there('friction')) === 0.2 && (await page.locator('#friction').isEnabled()));
  const box = await page.locator('#picture').boundingBox();
  const [x, y] = [box.x + 0.45 * box.width, box.y + 0.4 * box.height];
  const scale = Number(await page.locator('#zoom').inputValue());
  await page.mouse.move(x, y);
  await page.mouse.down();
  await until('both sides are coupled', async () => (await text('mode')) === 'master: coupled' && (await text('slave-mode')) === 'slave: coupled');
  await page.mouse.move(x + 0.045 * scale, y, { steps: 30 });
  await until('the wall is felt', async () => (await value('felt')) > 1);
  await set('friction', 1);
  await until('the slave has a friction of 1', async () => (await there('friction')) === 1);
  // Along the wall: with friction 1 the robot stays behind the hand, with 0 it follows.
  const aside = async () => {
    for (let i = 1; i <= 20; ++i) {
      await page.mouse.move(x + 0.045 * scale, y - 0.015 * scale * (i / 20));
      await new Promise((r) => setTimeout(r, 20));
    }
    await new Promise((r) => setTimeout(r, 1500));
    return value('behind');
  };
  const rough = await aside();
  await set('friction', 0);
  await until('the slave has no friction', async () => (await there('friction')) === 0);
  await new Promise((r) => setTimeout(r, 1500));
  const smooth = await value('behind');
  console.log(`moved 15 mm along the wall: the robot is ${rough.toFixed(1)} mm behind with friction 1, ${smooth.toFixed(1)} mm with 0`);
  if (!(rough > smooth + 0.5)) throw new Error('friction holds nothing back');
  if ((await value('environment-energy')) !== 0) throw new Error('friction stores no energy');
  // The sphere is another surface.
  await page.locator('#surface').selectOption({ label: 'sphere' });
  await until('the sliders show the sphere', async () => (await there('stiffness')) === 2000);
  if (picture) await page.screenshot({ path: picture });
  if (errors.length) throw new Error(errors.join('\n'));
} finally {
  await browser.close();
}
