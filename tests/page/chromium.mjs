// What the scripts here share: the live page in Chromium, its values, waiting. Each of them is called
//
//   node SCRIPT.mjs URL CHROMIUM MODULES [PICTURE.png]      MODULES: a node_modules folder with playwright-core
import { createRequire } from 'node:module';

const [url, executablePath, modules, picture] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)('playwright-core');

export { url, picture };
export const browser = await chromium.launch({
  executablePath,
  headless: true,
  args: ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
         '--disable-component-update', '--disable-sync'],
});
export const context = await browser.newContext({ bypassCSP: true, acceptDownloads: true, viewport: { width: 1280, height: 1000 } });
export const page = await context.newPage();
const errors = [];
page.on('pageerror', (e) => errors.push(String(e)));
page.on('console', (m) => m.type() === 'error' && errors.push(m.text()));

export const value = async (id) => Number(await page.locator(`#${id}`).getAttribute('data-value'));
export const text = (id) => page.locator(`#${id}`).textContent();
/// What the slave says it has, beside a slider.
export const there = async (id) => Number(await page.locator(`#${id}`).getAttribute('data-there'));
export const pause = (ms) => new Promise((r) => setTimeout(r, ms));
export const takePicture = async () => {
  if (!picture) return;
  await page.evaluate(() => scrollTo(0, 0));
  await page.screenshot({ path: picture, clip: { x: 0, y: 0, width: 1280, height: 780 } });
};

export async function until(what, condition, patience_ms = 15000) {
  const end = Date.now() + patience_ms;
  while (!(await condition())) {
    if (Date.now() > end) {
      if (!page.isClosed()) await takePicture();
      throw new Error(`${what}: not within ${patience_ms} ms`);
    }
    await pause(50);
  }
}
export const coupled = () =>
  until('both sides are coupled', async () => (await text('mode')) === 'master: coupled' && (await text('slave-mode')) === 'slave: coupled');

/// Takes the handle near the middle of the picture; to(m) then moves it along x, or along another direction of the picture, as a person
/// does: in 0.7 s, fastest in the middle, beside the straight line, trembling.
export async function take([right, down] = [1, 0]) {
  await until('the page shows the run', async () => page.locator('#verdict').isVisible());
  const box = await page.locator('#picture').boundingBox(), scale = Number(await page.locator('#zoom').inputValue());
  const [x, y] = [box.x + 0.45 * box.width + 6, box.y + 0.5 * box.height - 4];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await coupled();
  let at = 0;
  return async (m) => {
    const from = at, began = Date.now(), tremble = () => 2 * (Math.random() - 0.5);
    for (let s = 0; s < 1; await pause(12)) {
      s = Math.min(1, (Date.now() - began) / 700);
      at = from + (m - from) * s ** 3 * (10 - 15 * s + 6 * s * s);
      const beside = s < 1 ? 0.08 * (m - from) * scale * Math.sin(Math.PI * s) + tremble() : 0;
      await page.mouse.move(x + right * at * scale + down * beside, y + down * at * scale - right * beside);
    }
  };
}

export async function set(id, to) {
  await page.locator(`#${id}`).evaluate((input, v) => {
    input.value = v;
    input.dispatchEvent(new Event('input'));
  }, String(to));
}

/// Runs the steps; the page may report no error, unless its programs end. Closes the browser in any case.
export async function run(steps, { errors: judged = true } = {}) {
  try {
    await page.goto(url);
    await steps();
    if (judged && errors.length > 0) throw new Error(`errors on the page: ${errors.join('; ')}`);
  } finally {
    await browser.close();
  }
}
