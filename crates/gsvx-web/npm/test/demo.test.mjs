// The page of `cargo xtask demo` for the room, in Chromium.
import assert from 'node:assert/strict';
import { readFileSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { afterEach, test } from 'node:test';
import { pathToFileURL } from 'node:url';
import { CAMERA, browser, closePages, folder, gsvx, missing, nearing, open, pictures, psnr, quiet, server, setUp } from './browser.mjs';

const skip = missing() || (!process.env.GSVX_DEMO && 'SKIPPED: GSVX_DEMO does not name the folder of the demo');
const demo = process.env.GSVX_DEMO;
const FILES = ['original.gsvx', 'tuned.gsvx'];
const DESK = { viewport: { width: 1440, height: 900 } };
const PHONE = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 1 };

setUp(skip, async () => {
  writeFileSync(join(folder, 'cameras.json'), JSON.stringify([CAMERA]));
  for (const name of FILES) gsvx('render', join(demo, name), '--cameras', join(folder, 'cameras.json'), '-o', join(folder, `${name}.png`));
  return { demo };
});
afterEach(closePages);

const address = () => `${server.base}/demo/index.html`;
const loaded = (page) => page.waitForFunction(() => window.gsvx?.slots.length === 2 && window.gsvx.slots.every((s) => s.complete), null, { timeout: 120000 });
const text = (page, id) => page.locator(`#${id}`).textContent();
const bytes = async (page, id) => Number((await text(page, id)).replace(/\D/g, ''));
const length = (name) => statSync(join(demo, name)).size;
const split = async (page) => Number(await page.locator('#divider').getAttribute('aria-valuenow'));
/** Asks for the streams with a query of the test's server. */
const asked = (page, query) => page.route('**/*.gsvx', (route) => route.continue({ url: `${route.request().url()}?${query}` }));

async function shot(page, name) {
  const png = await page.screenshot();
  writeFileSync(join(pictures, `${name}.png`), png);
  return png;
}

for (const [name, options] of [['desk', DESK], ['phone', PHONE]]) {
  test(`on a ${name} both scenes load, and the line between them moves`, { skip, timeout: 400000 }, async () => {
    const page = await open(browser, address(), { ...options, colorScheme: name === 'desk' ? 'dark' : 'light' });
    await loaded(page);
    for (const [id, file] of [['left', FILES[0]], ['right', FILES[1]]]) {
      assert.equal(await bytes(page, `${id}-bytes`), length(file));
      assert.equal(await page.locator(`#${id}-progress`).evaluate((bar) => bar.value), 1);
    }
    const ply = statSync(join(process.env.GSVX_ROOT, 'fixtures/room/point_cloud.ply')).size;
    assert.equal(await bytes(page, 'ply'), ply);
    await page.waitForTimeout(4000);
    await shot(page, `demo-${name}`);
    if (name === 'phone') {
      await page.locator('#about summary').tap();
      await page.waitForTimeout(500);
      await shot(page, 'demo-phone-about');
    }
    const { width } = options.viewport;
    await page.mouse.move(width / 2, 450);
    await page.mouse.down();
    await page.mouse.move(0.25 * width, 450, { steps: 4 });
    await page.mouse.up();
    assert.ok(Math.abs((await split(page)) - 25) <= 1, `${await split(page)} %`);
    const box = await page.locator('#divider').boundingBox();
    assert.ok(Math.abs(box.x + box.width / 2 - 0.25 * width) <= 0.01 * width + 1, JSON.stringify(box));
    await page.locator('#divider').press('ArrowRight');
    assert.ok(Math.abs((await split(page)) - 27) <= 1);
    const outside = await page.evaluate(() => [...document.querySelectorAll('.side, .side *, #about, #title')].filter((e) => {
      const { left, right, top, bottom } = e.getBoundingClientRect();
      const cut = e.clientWidth && (e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight + 1);
      return left < 0 || top < 0 || right > innerWidth || bottom > innerHeight || cut;
    }).map((e) => e.id || e.className));
    assert.deepEqual(outside, []);
    assert.deepEqual(quiet(page), []);
    assert.deepEqual(page.outside, []);
  });
}

test('a finger turns the scene on a phone', { skip, timeout: 400000 }, async () => {
  const page = await open(browser, address(), PHONE);
  await loaded(page);
  const eye = () => page.evaluate(() => window.gsvx.camera.camera.position.toArray());
  const before = await eye();
  const finger = await page.context().newCDPSession(page);
  const touch = (type, x) => finger.send('Input.dispatchTouchEvent', { type, touchPoints: type === 'touchEnd' ? [] : [{ x, y: 500 }] });
  await touch('touchStart', 90);
  for (let x = 100; x <= 160; x += 10) await touch('touchMove', x);
  await touch('touchEnd');
  await page.waitForFunction((from) => window.gsvx.camera.camera.position.toArray().some((v, i) => Math.abs(v - from[i]) > 0.01), before);
});

/** A picture of the left of one and the right of another, with the border at a share of the width. */
const joined = async (page, left, right, share) => Buffer.from(await page.evaluate(async ([pair, at]) => {
  const images = await Promise.all(pair.map(async (base64) => createImageBitmap(await (await fetch(`data:image/png;base64,${base64}`)).blob())));
  const { width, height } = images[0];
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext('2d');
  const border = Math.round(at * width);
  context.drawImage(images[0], 0, 0);
  context.drawImage(images[1], border, 0, width - border, height, border, 0, width - border, height);
  const bytes = new Uint8Array(await (await canvas.convertToBlob()).arrayBuffer());
  return btoa(Array.from(bytes, (b) => String.fromCharCode(b)).join(''));
}, [[left, right].map((png) => png.toString('base64')), share]), 'base64');

test('each side of the line is what gsvx render draws of its stream', { skip, timeout: 400000 }, async () => {
  const page = await open(browser, address(), { viewport: { width: CAMERA.width, height: CAMERA.height } });
  await loaded(page);
  await page.addStyleTag({ content: '.side, #about, #divider { display: none !important }' });
  await page.evaluate((camera) => {
    const stage = window.gsvx;
    stage.camera.fixed(camera);
    stage.background = '#000';
    stage.theme();
  }, CAMERA);
  const [original, tuned] = FILES.map((name) => readFileSync(join(folder, `${name}.png`)));
  for (const percent of [50, 20]) {
    await page.evaluate((at) => window.gsvx.split(at), percent);
    const picture = () => shot(page, `demo-split-${percent}`);
    const got = await nearing(page, picture, await joined(page, original, tuned, percent / 100), 40);
    const swapped = await psnr(page, await picture(), await joined(page, tuned, original, percent / 100));
    const says = `demo, line at ${percent} %: ${got.toFixed(2)} dB; the sides swapped: ${swapped.toFixed(2)} dB`;
    console.log(says);
    assert.ok(got >= 40 && swapped < 40, says);
  }
});

test('bytes are counted while they arrive, and the coarse level comes first', { skip, timeout: 400000 }, async () => {
  const page = await browser.newPage(DESK);
  await asked(page, `rate=${Math.round(length(FILES[0]) / 6)}`);
  await page.goto(address());
  await page.waitForFunction(() => /coarse/.test(document.getElementById('left-state').textContent), null, { timeout: 60000 });
  const counted = await bytes(page, 'left-bytes');
  assert.ok(counted > 0 && counted < length(FILES[0]), `${counted}`);
  await loaded(page);
  // Of the tuned scene too.
  for (const [number, side] of ['left', 'right'].entries()) {
    const first = await page.evaluate((i) => window.gsvx.log.find((c) => c.number === i), number);
    assert.ok(first.lod > 0, JSON.stringify(first));
    assert.doesNotMatch(await text(page, `${side}-state`), /coarse/);
  }
  assert.equal(await bytes(page, 'left-bytes'), length(FILES[0]));
});

test('a host without ranges will do', { skip, timeout: 400000 }, async () => {
  const page = await browser.newPage(DESK);
  await asked(page, 'ranges=no');
  await page.goto(address());
  await loaded(page);
  assert.equal(await bytes(page, 'left-bytes'), length(FILES[0]));
  assert.equal(await page.locator('#message').isVisible(), false);
});

test('what fails is said in words', { skip, timeout: 400000 }, async () => {
  const lacking = await browser.newPage(DESK);
  await lacking.route('**/tuned.gsvx', (route) => route.continue({ url: `${server.base}/demo/nothing.gsvx` }));
  await lacking.goto(address());
  await loaded(lacking);
  assert.match(await text(lacking, 'message'), /tuned\.gsvx: HTTP 404/);
  assert.equal(await bytes(lacking, 'left-bytes'), length(FILES[0]));

  const flat = await browser.newPage(DESK);
  await flat.addInitScript(() => {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function context(kind, ...more) { return /webgl/.test(kind) ? null : get.call(this, kind, ...more); };
  });
  await flat.goto(address());
  await flat.waitForFunction(() => document.getElementById('message').textContent);
  assert.match(await text(flat, 'message'), /WebGL 2 is missing/);

  const local = await browser.newPage(DESK);
  await local.goto(pathToFileURL(join(demo, 'index.html')).href);
  assert.match(await text(local, 'message'), /put it on a web host/);
});
