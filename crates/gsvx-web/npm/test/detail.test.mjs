// The viewer page with a scene that is larger than its budget of Gaussians, in Chromium.
import assert from 'node:assert/strict';
import { readFileSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { afterEach, test } from 'node:test';
import { gunzipSync } from 'node:zlib';
import { CAMERA, browser, closePages, folder, gsvx, missing, nearing, open, pictures, quiet, rooms, server, setUp } from './browser.mjs';

const skip = missing();
const COUNT = 300_000;
const BUDGET = 80_000;
/** In front of a room at one end, of one in the middle, and as far away as the page draws. */
const views = { first: 0, middle: 43, far: 43 };
const camera = (name) => ({ ...CAMERA, position: [CAMERA.position[0] + views[name], name === 'far' ? -90 : CAMERA.position[1], CAMERA.position[2]], ...(name === 'far' && { rotation: [[1, 0, 0], [0, 0, 1], [0, -1, 0]] }) });
let length;

setUp(skip, async () => {
  await rooms(join(folder, 'rooms.gsvx'), COUNT);
  length = statSync(join(folder, 'rooms.gsvx')).size;
  for (const name of Object.keys(views)) {
    writeFileSync(join(folder, 'cameras.json'), JSON.stringify([camera(name)]));
    gsvx('render', join(folder, 'rooms.gsvx'), '--cameras', join(folder, 'cameras.json'), '-o', join(folder, `${name}.png`));
  }
  writeFileSync(join(folder, 'viewer.html'), gunzipSync(readFileSync(join(process.env.GSVX_ROOT, 'crates/gsvx-cli/view/index.html.gz'))));
});
afterEach(closePages);

/** The page, which counts the Gaussians of each frame. */
async function page(name, query = {}) {
  const { budget = BUDGET, url = '/data/rooms.gsvx' } = query;
  const address = `${server.base}/data/viewer.html?${new URLSearchParams({ url, budget, background: '#000', camera: JSON.stringify(camera(name)) })}`;
  const opened = await open(browser, address, { viewport: { width: CAMERA.width, height: CAMERA.height } });
  await opened.evaluate(() => {
    const { view } = window.gsvx.slots[0];
    const { draw } = view;
    window.most = 0;
    view.draw = (from) => {
      window.most = Math.max(window.most, view.drawn());
      draw.call(view, from);
    };
  });
  await opened.keyboard.press('h');
  return opened;
}

const settled = (page) => page.waitForFunction(() => window.gsvx.slots[0].complete && window.gsvx.isAtRest(), null, { timeout: 120000 });
const state = (page) => page.evaluate(() => {
  const [slot] = window.gsvx.slots;
  return { drawn: slot.view.drawn(), most: window.most, received: slot.received, loaded: [...slot.detail?.loaded.keys() ?? []], total: slot.head.chunks.length };
});
const go = (page, name) => page.evaluate((to) => {
  window.gsvx.camera.fixed(to);
  window.gsvx.dirty();
}, camera(name));

async function near(page, name, least) {
  await settled(page);
  const picture = async () => {
    const png = await page.screenshot();
    writeFileSync(join(pictures, `detail-${name}.png`), png);
    return png;
  };
  const got = await nearing(page, picture, readFileSync(join(folder, `${name}.png`)), least);
  const now = await state(page);
  console.log(`detail, ${name}: ${got.toFixed(2)} dB, ${now.drawn} of ${COUNT} Gaussians, ${now.received} of ${length} bytes, ${now.loaded.length} of ${now.total} chunks`);
  assert.ok(got >= least, `${name}: ${got} dB`);
  assert.ok(now.most <= BUDGET, `${now.most} Gaussians in a frame`);
  return now;
}

test('a scene above the budget is fine where the camera is, near and far, and lets go of what it left', { skip, timeout: 400000 }, async () => {
  const viewer = await page('first');
  const first = await near(viewer, 'first', 40);
  assert.ok(first.received < 0.6 * length, `${first.received} of ${length} bytes`);
  await go(viewer, 'middle');
  const middle = await near(viewer, 'middle', 32);
  assert.ok(first.loaded.some((chunk) => !middle.loaded.includes(chunk)), 'nothing was let go of');
  await go(viewer, 'far');
  await near(viewer, 'far', 30);
  await go(viewer, 'first');
  await near(viewer, 'first', 40);
  assert.deepEqual(quiet(viewer), []);
});

test('the first picture comes before most bytes, and a far view fetches few', { skip, timeout: 400000 }, async () => {
  const viewer = await page('far', { url: `/data/rooms.gsvx?rate=${Math.round(length / 10)}` });
  await viewer.waitForFunction(() => window.most > 0);
  const first = await state(viewer);
  console.log(`detail, first picture: ${first.drawn} Gaussians, ${first.received} of ${length} bytes`);
  assert.ok(first.received < 0.15 * length, `${first.received} of ${length} bytes`);
  const far = await near(viewer, 'far', 30);
  assert.ok(far.received < 0.5 * length, `${far.received} of ${length} bytes`);
});

test('the panel says what is drawn, and of what', { skip, timeout: 400000 }, async () => {
  const viewer = await page('first');
  await settled(viewer);
  await viewer.keyboard.press('h');
  const text = (id) => viewer.locator(`#${id}`).innerText();
  const { drawn } = await state(viewer);
  assert.match(await text('count'), new RegExp(`^${drawn.toLocaleString('en')} of \\d{3},\\d{3}$`));
  assert.equal(await text('budget'), '80,000');
  await viewer.screenshot({ path: join(pictures, 'detail-panel.png') });
});

test('what fits the budget is loaded whole, and without parts of files all is', { skip, timeout: 400000 }, async () => {
  const small = await page('first', { budget: 2 * COUNT });
  await settled(small);
  assert.equal(await small.evaluate(() => window.gsvx.slots[0].detail), undefined);
  assert.equal(await small.locator('#budget-row').isVisible(), false);
  await small.close();
  const whole = await page('first', { url: '/data/rooms.gsvx?ranges=no' });
  await settled(whole);
  assert.equal((await state(whole)).received, length);
  assert.match(await whole.locator('#message').textContent(), /more than the budget of 80000: the host gives no parts/);
});
