// What `gsvx lod --format 3dtiles` writes, in CesiumJS, from near and from afar.
import assert from 'node:assert/strict';
import { readFileSync, readdirSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { CAMERA, browser, folder, gsvx, missing, nearing, pictures, rooms, server, setUp } from './browser.mjs';

const skip = missing();

setUp(skip, async () => {
  await rooms(join(folder, 'rooms.gsvx'));
  gsvx('lod', join(folder, 'rooms.gsvx'), '-o', join(folder, 'tiles'), '--format', '3dtiles', '--at', '2.2945,48.8582,35');
});

/** What the camera sees, beside `gsvx render` of a model: the PSNR, and the tiles that were fetched and their bytes. */
async function look(name, model, camera, least) {
  const [cameras, png] = [join(folder, `${name}.json`), join(folder, `${name}.png`)];
  writeFileSync(cameras, JSON.stringify([camera]));
  gsvx('render', join(folder, model), '--cameras', cameras, '-o', png);
  const page = await browser.newPage({ viewport: { width: camera.width, height: camera.height }, deviceScaleFactor: 1 });
  const problems = [];
  page.on('console', (m) => { if (m.type() === 'error') problems.push(m.text()); });
  page.on('pageerror', (e) => problems.push(e.message));
  page.setDefaultTimeout(180000);
  const from = server.log.length;
  const query = { url: `${server.base}/data/tiles/tileset.json`, camera: JSON.stringify(camera) };
  await page.goto(`${server.base}/pages/cesium.html?${new URLSearchParams(query)}`);
  await page.waitForFunction(() => window.state?.done || window.state?.error, null, { timeout: 120000 });
  const state = await page.evaluate(() => window.state);
  assert.deepEqual([state.failed, state.error, problems], [undefined, undefined, []]);
  const shot = async () => {
    const picture = await page.screenshot();
    writeFileSync(join(pictures, `cesium-${name}.png`), picture);
    return picture;
  };
  const psnr = await nearing(page, shot, readFileSync(png), least);
  const answers = server.log.slice(from).filter(({ path }) => path.startsWith('/data/tiles/') && path.endsWith('.glb'));
  const bytes = answers.reduce((sum, answer) => sum + answer.bytes, 0);
  console.log(`cesium, ${name}: ${psnr.toFixed(2)} dB, ${state.tiles} tiles shown, ${answers.length} fetched, ${bytes} bytes`);
  await page.close();
  return { psnr, bytes, fine: answers.filter(({ path }) => path.includes('/0-')).length };
}

test('cesium shows fine tiles from near and coarse ones from afar', { skip, timeout: 400000 }, async () => {
  const files = readdirSync(join(folder, 'tiles')).filter((name) => name.endsWith('.glb'));
  const all = files.reduce((sum, name) => sum + statSync(join(folder, 'tiles', name)).size, 0);
  console.log(`cesium: ${files.length} tiles of ${all} bytes`);
  const near = await look('near', 'rooms.gsvx', CAMERA, 33);
  gsvx('decode', join(folder, 'rooms.gsvx'), '-o', join(folder, 'coarse.ply'), '--lod', '1');
  // All six rooms in the picture.
  const [right, , ahead] = [0, 1, 2].map((k) => CAMERA.rotation.map((row) => row[k]));
  const position = CAMERA.position.map((v, k) => v - 40 * ahead[k] + 14 * right[k]);
  const far = await look('far', 'coarse.ply', { ...CAMERA, position }, 38);
  assert.ok(near.psnr >= 33 && near.fine > 0, JSON.stringify(near));
  assert.ok(far.psnr >= 38 && far.fine === 0 && far.bytes < 0.1 * all, JSON.stringify(far));
});
