// The viewer page in Chromium, served by `gsvx view` and opened by itself.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { cpSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { afterEach, test } from 'node:test';
import { gunzipSync } from 'node:zlib';
import { CAMERA, browser, closePages, folder, gsvx, missing, nearing, open, pictures, quiet, rooms, server, setUp } from './browser.mjs';

const skip = missing();
const root = process.env.GSVX_ROOT;
const room = join(root, 'fixtures/room/point_cloud.ply');

setUp(skip, async () => {
  gsvx('encode', room, '-o', join(folder, 'room.gsvx'), '--web');
  gsvx('convert', room, join(folder, 'room.spz'));
  gsvx('convert', room, join(folder, 'room.splat'));
  gsvx('convert', join(folder, 'room.gsvx'), join(folder, 'room.glb'), '--compress');
  writeFileSync(join(folder, 'cameras.json'), JSON.stringify([CAMERA]));
  for (const name of ['room.gsvx', 'room.spz', 'room.glb']) gsvx('render', join(folder, name), '--cameras', join(folder, 'cameras.json'), '-o', join(folder, `${name}.png`));
  writeFileSync(join(folder, 'text.gsvx'), 'this is no stream, but text');
  writeFileSync(join(folder, 'viewer.html'), gunzipSync(readFileSync(join(root, 'crates/gsvx-cli/view/index.html.gz'))));
});
afterEach(closePages);

const page = (address, options = {}) => open(browser, address, { viewport: { width: 800, height: 560 }, ...options });
const local = (query) => `${server.base}/data/viewer.html?${new URLSearchParams(query)}`;
const loaded = (page) => page.waitForFunction(() => window.gsvx?.slots.length && window.gsvx.slots.every((s) => s.complete), null, { timeout: 120000 });
const text = (page, id) => page.locator(`#${id}`).innerText();
const shot = async (page, name) => {
  const png = await page.screenshot();
  writeFileSync(join(pictures, `${name}.png`), png);
  return png;
};

test('gsvx view opens a stream at the first camera beside it', { skip, timeout: 400000 }, async () => {
  const child = spawn(process.env.GSVX_BIN, ['view', '--no-open', room], { stdio: ['ignore', 'pipe', 'inherit'] });
  try {
    const [line] = await new Promise((resolve) => child.stdout.on('data', (d) => resolve(String(d).split('\n'))));
    assert.match(line, /&eye=/);
    const viewer = await page(line, { colorScheme: 'dark', viewport: { width: 1200, height: 760 } });
    await loaded(viewer);
    await viewer.waitForTimeout(4000);
    assert.equal(await text(viewer, 'title'), 'point_cloud.ply');
    assert.equal(await text(viewer, 'count'), '11,001');
    await shot(viewer, 'viewer-desktop-dark');
    assert.deepEqual(quiet(viewer), []);
    assert.deepEqual(viewer.outside, []);
    await viewer.close();
  } finally {
    child.kill('SIGINT');
  }
  assert.equal(await new Promise((resolve) => child.on('exit', resolve)), 0);
});

test('a sequence plays, and pauses and seeks by mouse and keys', { skip, timeout: 400000 }, async () => {
  cpSync(join(root, 'fixtures/sequences/tracked.gsvx'), join(folder, 'tracked.gsvx'));
  const viewer = await page(local({ url: 'tracked.gsvx' }));
  const number = () => viewer.evaluate(() => window.gsvx.player.clips[0].shown.number);
  const playing = () => viewer.evaluate(() => window.gsvx.player.isPlaying);
  await viewer.waitForFunction(() => window.gsvx.player.clips[0]?.shown?.number > 2);
  assert.ok(await playing());
  await viewer.click('#play');
  for (const frame of [3, 9, 11, 0]) {
    await viewer.locator('#time').fill(`${frame}`);
    await viewer.waitForFunction((n) => window.gsvx.player.clips[0].shown.number === n, frame);
  }
  await viewer.focus('#time');
  await viewer.keyboard.press('ArrowRight');
  await viewer.waitForFunction(() => window.gsvx.player.clips[0].shown.number === 1);
  assert.equal(await text(viewer, 'count'), '400');
  assert.ok(!(await playing()));
  await viewer.keyboard.press('Space');
  await viewer.waitForFunction(() => window.gsvx.player.clips[0].shown.number > 4);
  await viewer.keyboard.press('Space');
  assert.ok(!(await playing()) && (await number()) > 4);
  await shot(viewer, 'viewer-sequence');
  // What is opened next is no sequence.
  await viewer.evaluate(() => window.gsvx.open('room.gsvx', 'room.gsvx', 0));
  await loaded(viewer);
  assert.ok(!(await viewer.locator('#player').isVisible()));
  assert.deepEqual(quiet(viewer), []);
});

test('two sequences side by side share a time line; the shorter one stays at its end', { skip, timeout: 400000 }, async () => {
  for (const name of ['tracked', 'births']) cpSync(join(root, `fixtures/sequences/${name}.gsvx`), join(folder, `${name}.gsvx`));
  const viewer = await page(local({ url: 'tracked.gsvx', compare: 'births.gsvx' }));
  await viewer.waitForFunction(() => window.gsvx.player.clips.filter((clip) => clip.shown).length === 2);
  await viewer.click('#play');
  for (const want of [[3, 3], [11, 9], [0, 0]]) {
    await viewer.locator('#time').fill(`${want[0]}`);
    await viewer.waitForFunction((w) => window.gsvx.player.clips.every((clip, i) => clip.shown.number === w[i]), want);
  }
  assert.equal(await text(viewer, 'title'), 'tracked.gsvx | births.gsvx');
  assert.deepEqual(quiet(viewer), []);
});

/** A sphere of Gaussians as a .splat, away from the origin, and a few black ones far around it. */
function sphere(file) {
  const all = Buffer.alloc(32 * 3000);
  for (let i = 0; i < 3000; i += 1) {
    const height = 1 - (2 * (i + 0.5)) / 3000;
    const around = Math.sqrt(1 - height * height);
    const far = i % 100 ? 1 : 30;
    const at = [5 + far * around * Math.cos(2.4 * i), -2 + far * height, 9 + far * around * Math.sin(2.4 * i)];
    [...at, 0.04, 0.04, 0.04].forEach((v, k) => all.writeFloatLE(v, 32 * i + 4 * k));
    all.set([...(far > 1 ? [0, 0, 0] : [200, 110 + 50 * height, 40]), 255, 255, 128, 128, 128], 32 * i + 24);
  }
  writeFileSync(file, all);
}

/** Pixels that are lit, as a box in shares of the picture. */
const lit = (page, png) => page.evaluate(async (base64) => {
  const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${base64}`)).blob());
  const { width, height } = image;
  const canvas = new OffscreenCanvas(width, height).getContext('2d');
  canvas.drawImage(image, 0, 0);
  const { data } = canvas.getImageData(0, 0, width, height);
  const box = [1, 1, 0, 0];
  for (let i = 0; i < width * height; i += 1) {
    if (data[4 * i] < 60) continue;
    const [x, y] = [(i % width) / width, Math.floor(i / width) / height];
    box.splice(0, 4, Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y));
  }
  return box;
}, png.toString('base64'));

test('a single object is whole in the first view', { skip, timeout: 400000 }, async () => {
  const splat = join(folder, 'sphere.splat');
  sphere(splat);
  gsvx('encode', splat, '-o', join(folder, 'sphere.gsvx'), '--no-estimate');
  gsvx('encode', splat, '-o', join(folder, 'sphere-levels.gsvx'), '--web', '--no-estimate');
  for (const name of ['sphere.splat', 'sphere.gsvx', 'sphere-levels.gsvx']) {
    const viewer = await page(local({ url: `/data/${name}`, background: '#000' }), { viewport: { width: 640, height: 480 } });
    await loaded(viewer);
    await viewer.keyboard.press('h');
    await viewer.waitForTimeout(3000);
    const [left, top, right, bottom] = await lit(viewer, await shot(viewer, `viewer-${name}`));
    const says = `${name}: ${[left, top, right, bottom]}`;
    console.log(says);
    assert.ok(left > 0.02 && top > 0.02 && right < 0.98 && bottom < 0.98, says);
    assert.ok(bottom - top > 0.5, says);
    await viewer.close();
  }
});

test('gsvx view starts at the first camera of gsvx render --orbit', { skip, timeout: 400000 }, async () => {
  // A folder without cameras.
  const alone = mkdtempSync(join(tmpdir(), 'gsvx-alone-'));
  const file = join(alone, 'sphere.gsvx');
  sphere(join(alone, 'sphere.splat'));
  gsvx('encode', join(alone, 'sphere.splat'), '-o', file, '--no-estimate');
  gsvx('render', file, '--orbit', '3', '-o', join(alone, 'orbit'));
  const child = spawn(process.env.GSVX_BIN, ['view', '--no-open', file], { stdio: ['ignore', 'pipe', 'inherit'] });
  try {
    const [line] = await new Promise((resolve) => child.stdout.on('data', (d) => resolve(String(d).split('\n'))));
    const viewer = await page(`${line}&background=%23000`, { viewport: { width: 640, height: 480 } });
    await loaded(viewer);
    await viewer.keyboard.press('h');
    const reference = readFileSync(join(alone, 'orbit/orbit-0000.png'));
    const got = await nearing(viewer, () => shot(viewer, 'viewer-orbit'), reference, 35);
    console.log(`viewer at the first camera of an orbit: ${got.toFixed(2)} dB`);
    assert.ok(got >= 35, `${got} dB`);
    await viewer.close();
  } finally {
    child.kill('SIGINT');
    rmSync(alone, { recursive: true, force: true });
  }
});

test('gsvx view answers with ranges, and a coarser level is read by them', { skip, timeout: 400000 }, async () => {
  const file = join(folder, 'rooms.gsvx');
  await rooms(file);
  const { length } = readFileSync(file);
  const child = spawn(process.env.GSVX_BIN, ['view', '--no-open', file], { stdio: ['ignore', 'pipe', 'inherit'] });
  try {
    const [line] = await new Promise((resolve) => child.stdout.on('data', (d) => resolve(String(d).split('\n'))));
    const viewer = await page(line);
    await loaded(viewer);
    const answers = [];
    viewer.on('response', (answer) => {
      if (answer.url().endsWith('rooms.gsvx')) answers.push([answer.status(), Number(answer.headers()['content-length'])]);
    });
    await viewer.locator('#lod').selectOption('1');
    await viewer.waitForFunction(() => window.gsvx.slots[0].lod === 1 && window.gsvx.slots[0].complete);
    const bytes = answers.reduce((sum, [, n]) => sum + n, 0);
    console.log(`viewer, level 1: ${answers.length} answers, ${bytes} of ${length} bytes`);
    assert.ok(answers.length > 0 && answers.every(([status]) => status === 206) && bytes < 0.7 * length, JSON.stringify(answers));
    assert.deepEqual(quiet(viewer), []);
    await viewer.close();
  } finally {
    child.kill('SIGINT');
  }
});

for (const [name, least] of [['room.gsvx', 44], ['room.spz', 44], ['room.glb', 44]]) {
  test(`${name}: the picture is that of gsvx render`, { skip, timeout: 400000 }, async () => {
    const query = { url: `/data/${name}`, camera: JSON.stringify(CAMERA), background: '#000' };
    const viewer = await page(local(query), { viewport: { width: CAMERA.width, height: CAMERA.height } });
    await loaded(viewer);
    await viewer.keyboard.press('h');
    const got = await nearing(viewer, () => shot(viewer, `viewer-${name}`), readFileSync(join(folder, `${name}.png`)), least);
    console.log(`viewer, ${name}: ${got.toFixed(2)} dB`);
    assert.ok(got >= least, `${got} dB`);
    assert.deepEqual(quiet(viewer), []);
    await viewer.close();
  });
}

test('a phone shows the coarse level first, then two scenes beside each other', { skip, timeout: 400000 }, async () => {
  const rate = Math.round(readFileSync(join(folder, 'room.gsvx')).length / 8);
  const start = { up: '0,0,1', eye: '0,-2.2,1', ahead: '0,1,-0.1' };
  const phone = { viewport: { width: 390, height: 780 }, colorScheme: 'light', hasTouch: true, isMobile: true, deviceScaleFactor: 1 };
  const viewer = await page(local({ url: `/data/room.gsvx?rate=${rate}`, ...start }), phone);
  await viewer.waitForFunction(() => window.gsvx?.log?.length > 0, null, { timeout: 60000 });
  assert.match(await viewer.locator('#layers').textContent(), /coarse/);
  await viewer.waitForTimeout(1500);
  await shot(viewer, 'viewer-phone-coarse');
  await loaded(viewer);
  assert.equal(await viewer.locator('#layers').textContent(), 'base + SH 1–3');
  await viewer.close();
  const two = await page(local({ url: '/data/room.gsvx', compare: '/data/room.splat', ...start }), phone);
  await loaded(two);
  await two.waitForTimeout(5000);
  assert.equal(await two.locator('#divider').isVisible(), true);
  await shot(two, 'viewer-phone-split-light');
  await two.locator('#divider').press('ArrowRight');
  assert.equal(await two.locator('#divider').getAttribute('aria-valuenow'), '52');
  await two.locator('#toggle').tap();
  await two.locator('#compare').tap();
  assert.equal(await two.locator('#divider').isVisible(), false);
  assert.equal(await two.locator('canvas').count(), 1);
  assert.equal(await text(two, 'compare'), 'Compare');
  assert.deepEqual(quiet(two), []);
  await two.close();
});

test('all is done by keys, and every control has a name', { skip, timeout: 400000 }, async () => {
  const viewer = await page(local({ url: '/data/room.gsvx' }));
  await loaded(viewer);
  const names = await viewer.$$eval('button, input:not([type=file]), select, [role=separator]', (all) =>
    all.filter((e) => e.checkVisibility()).map((e) => (e.ariaLabel || e.labels?.[0]?.textContent || e.textContent).trim()));
  assert.ok(names.length >= 7 && names.every(Boolean), names.join());
  const seen = new Set();
  for (let i = 0; i < 10; i += 1) {
    await viewer.keyboard.press('Tab');
    seen.add(await viewer.evaluate(() => document.activeElement.id || document.activeElement.tagName));
  }
  for (const id of ['toggle', 'sh', 'lod', 'up', 'open', 'compare', 'reset']) assert.ok(seen.has(id), `${id} of ${[...seen]}`);
  const frames = () => viewer.evaluate(() => window.gsvx.frames);
  await viewer.waitForTimeout(3000);
  const before = await frames();
  // The last Tab may have left the page.
  await viewer.locator('canvas').focus();
  await viewer.keyboard.press('w', { delay: 300 });
  await viewer.waitForFunction((n) => window.gsvx.frames > n, before);
  await viewer.locator('#lod').selectOption('1');
  await viewer.waitForFunction(() => window.gsvx.slots[0].lod === 1 && window.gsvx.slots[0].complete);
  assert.match(await text(viewer, 'count'), /^1,\d{3}$/);
  await viewer.locator('#toggle').click();
  assert.equal(await viewer.locator('#body').isVisible(), false);
  assert.deepEqual(quiet(viewer), []);
  await viewer.close();
});

test('what fails says so, and what is there is shown', { skip, timeout: 400000 }, async () => {
  const cases = [
    ['room.gsvx?cut=30000', /room\.gsvx: the stream ends at byte 30000 of \d+: chunk 1/, true],
    ['room.gsvx?flip=45000', /room\.gsvx: chunk 1, layer 0 .* is damaged/, true],
    ['nothing.gsvx', /HTTP 404/, false], ['text.gsvx', /text\.gsvx: not a gsvx stream/, false],
  ];
  for (const [file, pattern, shows] of cases) {
    const viewer = await page(local({ url: `/data/${file}` }));
    await viewer.waitForFunction(() => document.getElementById('message').textContent);
    assert.match(await viewer.locator('#message').textContent(), pattern);
    assert.equal(await viewer.evaluate(() => (window.gsvx.log ?? []).some((c) => c.lod > 0)), shows, file);
    await viewer.close();
  }
});

test('the page opens from a file, without a server', { skip, timeout: 400000 }, async () => {
  const viewer = await page(`file://${join(folder, 'viewer.html')}`);
  assert.equal(await viewer.locator('#welcome').isVisible(), true);
  await viewer.setInputFiles('#file', join(folder, 'room.splat'));
  await loaded(viewer);
  assert.equal(await text(viewer, 'count'), '11,001');
  await viewer.waitForTimeout(2000);
  await shot(viewer, 'viewer-file');
  assert.deepEqual(quiet(viewer), []);
  await viewer.close();
});
