// On a telephone and on a small laptop, picture and sliders are on the screen together. Throws at the first step that fails.
import { browser, page, picture, run, text, until, url } from './chromium.mjs';

const inside = async (p, id) => {
  const box = await p.locator(id).first().boundingBox(), size = p.viewportSize();
  return box !== null && box.x >= -1 && box.y >= -1 && box.x + box.width <= size.width + 1 && box.y + box.height <= size.height + 1;
};

await run(async () => {
  await until('the page is connected', async () => (await text('connection')) === 'connected');
  for (const colorScheme of ['light', 'dark']) {
    const laptop = await (await browser.newContext({ viewport: { width: 1440, height: 900 }, colorScheme })).newPage();
    await laptop.goto(url);
    await until('the laptop shows the run', async () => (await laptop.locator('#verdict').isVisible()));
    for (const id of ['#picture', '#gauge', '#method', '#to_slave-delay_ms', '#to_slave-loss', '#grip', '#stiffness', '#felt', '#plots figure'])
      if (!(await inside(laptop, id))) throw new Error(`1440x900: ${id} is not on the screen`);
    if (picture) await laptop.screenshot({ path: picture.replace(/[.]png$/, `_laptop_${colorScheme}.png`) });
    await laptop.close();

    const phone = await (await browser.newContext({ viewport: { width: 390, height: 844 }, colorScheme, hasTouch: true, isMobile: true })).newPage();
    await phone.goto(url);
    await until('the telephone shows the run', async () => (await phone.locator('#verdict').isVisible()));
    if (picture) await phone.screenshot({ path: picture.replace(/[.]png$/, `_phone_${colorScheme}.png`) });
    for (const id of ['#method', '#to_slave-loss', '#grip', '#stiffness', '#felt']) {
      await phone.locator(id).evaluate((e) => e.scrollIntoView({ block: 'end' }));
      if (!(await inside(phone, '#picture')) || !(await inside(phone, id))) throw new Error(`390x844: the picture and ${id} are not on the screen together`);
    }
    const wide = await phone.evaluate(() => document.documentElement.scrollWidth);
    if (wide > 390) throw new Error(`390x844: the page is ${wide} pixels wide`);
    if (!(await phone.locator('#hint').isVisible()) || /wheel|Shift|Keyboard/.test(await phone.locator('#hint').textContent())) throw new Error('a telephone shows no words on touch, or some of a wheel or keyboard');
    await phone.close();
  }
  console.log('picture and sliders are together at 1440x900 and 390x844, light and dark');
});
