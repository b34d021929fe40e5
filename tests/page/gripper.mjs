// Opens and closes the gripper from the live page in Chromium. Prints one line for each step; throws at the first that fails.
//
//   node gripper.mjs URL CHROMIUM MODULES [PICTURE.png]      MODULES: a node_modules folder with playwright-core
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

try {
  await page.goto(url);
  await until('the gripper is open', async () => Math.abs((await value('gripper-hand')) - 60) < 0.5);
  await page.locator('#picture').focus();
  await page.keyboard.press('Space');
  await until('the handle is held', async () => (await text('held')) === 'handle held');
  await until('both sides are coupled', async () => (await text('mode')) === 'master: coupled' && (await text('slave-mode')) === 'slave: coupled');
  for (let i = 0; i < 30; ++i) await page.keyboard.press('c');
  await until('the object is felt', async () => (await value('gripper-felt')) > 1.5);
  await new Promise((r) => setTimeout(r, 1500));
  const fingers = await value('gripper-robot');
  console.log(`closed to 30 mm: fingers at ${fingers.toFixed(1)} mm, ${(await value('gripper-felt')).toFixed(2)} N felt`);
  if (!(fingers < 40 && fingers > 37)) throw new Error('the fingers do not squeeze the object');
  if (picture) await page.screenshot({ path: picture });
  for (let i = 0; i < 25; ++i) await page.keyboard.press('o');
  await until('the fingers open', async () => (await value('gripper-robot')) > 50 && Math.abs(await value('gripper-felt')) < 0.3);
  console.log(`opened to 55 mm: fingers at ${(await value('gripper-robot')).toFixed(1)} mm`);
  if (errors.length) throw new Error(errors.join('\n'));
} finally {
  await browser.close();
}
