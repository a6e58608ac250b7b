// What `gsvx convert` writes as glTF: Khronos' validator, and three.js beside `gsvx render`.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { CAMERA, gsvx, launch, missing, nearing, serve } from './browser.mjs';

const skip = missing();
if (skip) console.error(skip);

test('a .glb is valid, and three.js shows what gsvx render shows', { skip }, async (t) => {
  const folder = mkdtempSync(join(tmpdir(), 'gsvx-gltf-'));
  t.after(() => rmSync(folder, { recursive: true, force: true }));
  const room = join(process.env.GSVX_ROOT, 'fixtures/room/point_cloud.ply');
  const [glb, cameras, png] = ['room.glb', 'cameras.json', 'reference.png'].map((name) => join(folder, name));
  gsvx('convert', room, glb);
  writeFileSync(cameras, JSON.stringify([CAMERA]));
  gsvx('render', glb, '--cameras', cameras, '-o', png);

  const validator = createRequire(join(process.env.GSVX_NPM, 'package.json'))('gltf-validator');
  const { issues } = await validator.validateBytes(new Uint8Array(readFileSync(glb)), { maxIssues: 0 });
  // 2.0.0-dev.3.10, the newest, does not know the extension, and calls its attributes' names invalid.
  const unknown = ({ code, pointer }) => code === 'MESH_PRIMITIVE_INVALID_ATTRIBUTE' && pointer.includes('/attributes/KHR_gaussian_splatting:');
  const wrong = issues.messages.filter((issue) => issue.severity < 2 && !unknown(issue));
  assert.deepEqual(wrong, []);
  assert.ok(issues.messages.some(unknown), 'the validator knows the extension now: expect no error at all');

  const server = await serve({ engines: join(process.env.GSVX_NPM, 'node_modules'), pages: join(import.meta.dirname, 'pages'), data: folder });
  t.after(() => server.close());
  const browser = await launch();
  t.after(() => browser.close());
  const page = await browser.newPage({ viewport: { width: CAMERA.width, height: CAMERA.height }, deviceScaleFactor: 1 });
  const problems = [];
  page.on('console', (m) => { if (m.type() === 'error') problems.push(m.text()); });
  page.on('pageerror', (e) => problems.push(e.message));
  page.setDefaultTimeout(180000);
  await page.goto(`${server.base}/pages/gltf.html?url=${encodeURIComponent(`${server.base}/data/room.glb`)}&camera=${encodeURIComponent(JSON.stringify(CAMERA))}`);
  await page.waitForFunction(() => window.state?.done || window.state?.error, null, { timeout: 120000 });
  assert.equal(await page.evaluate(() => window.state.error), undefined);

  const pictures = join(process.env.GSVX_ROOT, 'out/web/pictures');
  mkdirSync(pictures, { recursive: true });
  const shot = async () => {
    const picture = await page.screenshot();
    writeFileSync(join(pictures, 'gltf.png'), picture);
    return picture;
  };
  // As for the adapter of three.js: it ends each Gaussian at two standard deviations.
  const got = await nearing(page, shot, readFileSync(png), 29);
  console.log(`three.js, glTF: ${got.toFixed(2)} dB`);
  assert.ok(got >= 29, `${got} dB`);
  assert.deepEqual(problems, []);
});
