// Opens the live page in Chromium and drags the hand into the wall of examples/play/one_axis.textproto:
// node first_force.mjs URL CHROMIUM MODULES START_MS SERVED_MS
import { createRequire } from 'node:module';

const [url, executablePath, modules, start, served] = process.argv.slice(2);
const { chromium } = createRequire(`${modules}/`)('playwright-core');
const since = (ms) => ((ms - Number(start)) / 1000).toFixed(2);
const browser = await chromium.launch({
  executablePath,
  args: ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
         '--disable-component-update', '--disable-sync'],
});
try {
  const page = await (await browser.newContext({ bypassCSP: true })).newPage();
  const launched = Date.now();
  await page.goto(url);
  await page.waitForFunction(() => document.querySelector('#mode')?.textContent?.startsWith('master:'));
  const shown = Date.now();
  const box = await page.locator('#picture').boundingBox();
  const scale = Number(await page.locator('#zoom').inputValue());
  const [x, y] = [box.x + 0.45 * box.width, box.y + 0.5 * box.height];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 0.045 * scale, y, { steps: 10 });
  await page.waitForFunction(() => Number(document.querySelector('#felt')?.getAttribute('data-value')) > 0.5);
  console.log(`page served ${since(Number(served))} s, Chromium up ${since(launched)} s, page shown ${since(shown)} s, ` +
              `force felt ${since(Date.now())} s`);
} finally {
  await browser.close();
}
