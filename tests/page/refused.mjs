// A slave whose environment cannot be changed: the page says why (the environment variable REASON has a part of the sentence), its sliders
// are disabled, and a command that is sent all the same changes nothing. Throws at the first step that fails.
//
//   REASON=... node refused.mjs URL CHROMIUM MODULES [PICTURE.png]      MODULES: a node_modules folder with playwright-core
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


const reason = process.env.REASON;
if (!reason) throw new Error('REASON is not set');

try {
  await page.goto(url);
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
  if (picture) await page.screenshot({ path: picture });
  if (errors.length) throw new Error(errors.join('\n'));
} finally {
  await browser.close();
}
