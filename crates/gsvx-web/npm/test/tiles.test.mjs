// What `gsvx lod --format 3dtiles` writes, in CesiumJS, from near and from afar.
import assert from 'node:assert/strict';
import { existsSync, readFileSync, readdirSync, statSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { CAMERA, browser, copies, folder, gsvx, missing, pictures, psnr, rooms, server, setUp } from './browser.mjs';

const skip = missing();
const vessel = join(process.env.GSVX_ROOT, '../shared/models/la_fontaine/meta.json');
const skipLarge = skip || (!existsSync(vessel) && `SKIPPED: ${vessel} is not there; CesiumJS shows no large scene`);

setUp(skip, () => {});
if (skipLarge && !skip) console.error(skipLarge);

/**
 * What CesiumJS shows of the tiles of a stream at cameras, beside `gsvx render`: the PSNR, and the files that are fetched
 * for it. CesiumJS widens Gaussians by a sixteenth of the 0.3 squared pixels of training. So does a render of four times
 * the size, of which a pixel here is the mean of sixteen.
 */
async function looks(name, cameras) {
  const at = (file) => join(folder, file);
  gsvx('lod', at(`${name}.gsvx`), '-o', at(name), '--format', '3dtiles', '--at', '2.2945,48.8582,35');
  const all = readdirSync(at(name)).filter((file) => file.endsWith('.glb')).reduce((sum, file) => sum + statSync(join(at(name), file)).size, 0);
  writeFileSync(at(`${name}.json`), JSON.stringify(Object.entries(cameras).map(([view, camera], id) => ({ ...camera, id, img_name: view }))));
  gsvx('render', at(`${name}.gsvx`), '--cameras', at(`${name}.json`), '--scale', '4', '-o', at(`${name}-views`));
  const found = { all };
  for (const [view, camera] of Object.entries(cameras)) {
    found[view] = await look(name, view, camera, readFileSync(join(at(`${name}-views`), `${view}.png`)));
    const { tiles, gaussians, files, bytes, psnr: db } = found[view];
    console.log(`cesium, ${name}, ${view}: ${db.toFixed(2)} dB, ${gaussians} Gaussians of ${tiles} tiles, ${files} files of ${bytes} of ${all} bytes`);
  }
  return found;
}

async function look(name, view, camera, reference) {
  const page = await browser.newPage({ viewport: { width: camera.width, height: camera.height }, deviceScaleFactor: 1 });
  const problems = [];
  page.on('console', (m) => { if (m.type() === 'error') problems.push(m.text()); });
  page.on('pageerror', (e) => problems.push(e.message));
  page.setDefaultTimeout(180000);
  const from = server.log.length;
  const query = { url: `${server.base}/data/${name}/tileset.json`, camera: JSON.stringify(camera) };
  await page.goto(`${server.base}/pages/cesium.html?${new URLSearchParams(query)}`);
  await page.waitForFunction(() => window.state?.done || window.state?.error);
  const { picture = '', ...state } = await page.evaluate(() => window.state);
  assert.deepEqual([state.failed, state.error, problems], [undefined, undefined, []]);
  const png = Buffer.from(picture.split(',')[1], 'base64');
  writeFileSync(join(pictures, `cesium-${name}-${view}.png`), png);
  const answers = server.log.slice(from).filter(({ path }) => path.startsWith(`/data/${name}/`) && path.endsWith('.glb'));
  const got = await psnr(page, png, reference);
  await page.close();
  return {
    ...state,
    psnr: got,
    files: answers.length,
    bytes: answers.reduce((sum, answer) => sum + answer.bytes, 0),
    fine: answers.filter(({ path }) => path.includes('/0-')).length,
  };
}

test('cesium shows fine tiles from near and coarse ones from afar', { skip, timeout: 400000 }, async () => {
  await rooms(join(folder, 'rooms.gsvx'));
  // All six rooms in the picture.
  const [right, , ahead] = [0, 1, 2].map((k) => CAMERA.rotation.map((row) => row[k]));
  const position = CAMERA.position.map((v, k) => v - 40 * ahead[k] + 14 * right[k]);
  const { all, near, far } = await looks('rooms', { near: CAMERA, far: { ...CAMERA, position } });
  assert.ok(near.psnr >= 39 && near.fine > 0, JSON.stringify(near));
  assert.ok(far.psnr >= 26.5 && far.fine === 0 && far.bytes < 0.1 * all, JSON.stringify(far));
});

test('cesium streams 5.6 million Gaussians: near views fetch a part, far ones almost nothing', { skip: skipLarge, timeout: 600000 }, async () => {
  gsvx('convert', vessel, join(folder, 'vessel.ply'));
  await copies(join(folder, 'vessel.ply'), join(folder, 'vessels.gsvx'), 5 * 1_136_356, 1e-5);
  // The vessels have y down. The camera looks along no axis.
  const rotation = [[0.980067, -0.019834, 0.197677], [0, 0.995004, 0.099833], [-0.198669, -0.097843, 0.97517]];
  const camera = (point, distance, size) => ({ ...CAMERA, ...size, rotation, position: point.map((v, k) => v - distance * rotation[k][2]) });
  const { all, near, far } = await looks('vessels', {
    near: camera([0, -0.04, 0], 0.6, { width: 120, height: 80, fx: 330, fy: 330 }),
    far: camera([0.86, -0.04, 0], 3, { width: 240, height: 160, fx: 195, fy: 195 }),
  });
  assert.ok(near.psnr >= 24 && near.fine > 0 && near.bytes < 0.1 * all, JSON.stringify(near));
  assert.ok(far.psnr >= 29 && far.fine === 0 && far.bytes < 0.002 * all, JSON.stringify(far));
});
