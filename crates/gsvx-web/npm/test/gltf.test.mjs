// What `gsvx convert` writes as glTF: Khronos' validator, and three.js beside `gsvx render`.
import assert from 'node:assert/strict';
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join } from 'node:path';
import { test } from 'node:test';
import { CAMERA, alike, gsvx, launch, missing, nearing, serve } from './browser.mjs';

const skip = missing();
if (skip) console.error(skip);

/** The attributes of the extension, as its text names them. */
const ATTRIBUTES = ['ROTATION', 'SCALE', 'OPACITY', ...[1, 3, 5, 7].flatMap((count, degree) =>
  Array.from({ length: count }, (_, i) => `SH_DEGREE_${degree}_COEF_${i}`))];

test('a .glb is valid, and three.js shows what gsvx render shows', { skip }, async (t) => {
  const folder = mkdtempSync(join(tmpdir(), 'gsvx-gltf-'));
  t.after(() => rmSync(folder, { recursive: true, force: true }));
  const room = join(process.env.GSVX_ROOT, 'fixtures/room/point_cloud.ply');
  const [glb, cameras, png] = ['room.glb', 'cameras.json', 'reference.png'].map((name) => join(folder, name));
  gsvx('convert', room, glb);
  writeFileSync(cameras, JSON.stringify([CAMERA]));
  gsvx('render', glb, '--cameras', cameras, '-o', png);

  const validator = createRequire(join(process.env.GSVX_NPM, 'package.json'))('gltf-validator');
  const { validatorVersion, issues } = await validator.validateBytes(new Uint8Array(readFileSync(glb)), { maxIssues: 0 });
  // This validator, the newest, does not know the extension. It says so once, and calls the name of each of its
  // attributes invalid, for it has a colon and no underscore in front. These messages are expected, and no other.
  assert.equal(validatorVersion, '2.0.0-dev.3.10');
  const said = issues.messages.map(({ code, severity, pointer }) => `${severity} ${code} ${pointer}`);
  const unknown = ATTRIBUTES.map((name) => `0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:${name}`);
  assert.deepEqual(said.sort(), [...unknown, '2 UNSUPPORTED_EXTENSION /extensionsUsed/0'].sort());

  const server = await serve({ engines: join(process.env.GSVX_NPM, 'node_modules'), pages: join(import.meta.dirname, 'pages'), data: folder });
  t.after(() => server.close());
  const browser = await launch();
  t.after(() => browser.close());
  const pictures = join(process.env.GSVX_ROOT, 'out/web/pictures');
  mkdirSync(pictures, { recursive: true });
  // As for the adapter of three.js: the addon ends each Gaussian at two standard deviations, and dims small ones.
  for (const [name, before, least] of [['gltf', () => {}, 29.5], ['gltf-alike', alike, 43]]) {
    const page = await browser.newPage({ viewport: { width: CAMERA.width, height: CAMERA.height }, deviceScaleFactor: 1 });
    const problems = [];
    page.on('console', (m) => { if (m.type() === 'error') problems.push(m.text()); });
    page.on('pageerror', (e) => problems.push(e.message));
    page.setDefaultTimeout(180000);
    await before(page);
    const query = { url: `${server.base}/data/room.glb`, camera: JSON.stringify(CAMERA) };
    await page.goto(`${server.base}/pages/gltf.html?${new URLSearchParams(query)}`);
    await page.waitForFunction(() => window.state?.done || window.state?.error, null, { timeout: 120000 });
    assert.equal(await page.evaluate(() => window.state.error), undefined);
    const shot = async () => {
      const picture = await page.screenshot();
      writeFileSync(join(pictures, `${name}.png`), picture);
      return picture;
    };
    const got = await nearing(page, shot, readFileSync(png), least);
    console.log(`three.js, ${name}: ${got.toFixed(2)} dB`);
    assert.ok(got >= least, `${got} dB`);
    assert.deepEqual(problems, []);
    await page.close();
  }
});
