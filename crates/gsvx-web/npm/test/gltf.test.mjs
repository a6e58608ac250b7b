// What `gsvx convert` writes as glTF: Khronos' validator, and three.js beside `gsvx render`.
import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { test } from 'node:test';
import { CAMERA, alike, browser, folder, gsvx, missing, nearing, pictures, server, setUp } from './browser.mjs';

const skip = missing();
const COMPRESSION = 'GSVX_gaussian_splatting_compression';
const EXTENSIONS = '/meshes/0/primitives/0/extensions/KHR_gaussian_splatting/extensions';

/** The attributes of the extension, as its text names them. */
const ATTRIBUTES = ['ROTATION', 'SCALE', 'OPACITY', ...[1, 3, 5, 7].flatMap((count, degree) =>
  Array.from({ length: count }, (_, i) => `SH_DEGREE_${degree}_COEF_${i}`))];

const at = (name) => join(folder, name);

setUp(skip, async () => {
  const room = join(process.env.GSVX_ROOT, 'fixtures/room/point_cloud.ply');
  writeFileSync(at('cameras.json'), JSON.stringify([CAMERA]));
  gsvx('convert', room, at('room.glb'));
  gsvx('convert', room, at('compressed.glb'), '--compress');
  for (const name of ['room', 'compressed']) gsvx('render', at(`${name}.glb`), '--cameras', at('cameras.json'), '-o', at(`${name}.png`));
});

/** Opens a file in three.js; returns the page, whose `log` has what the console says. */
async function open(file, { plugin = '', prepare = () => {} } = {}) {
  const page = await browser.newPage({ viewport: { width: CAMERA.width, height: CAMERA.height }, deviceScaleFactor: 1 });
  page.log = [];
  page.on('console', (m) => { if (['error', 'warning'].includes(m.type())) page.log.push(m.text()); });
  page.on('pageerror', (e) => page.log.push(e.message));
  page.setDefaultTimeout(180000);
  await prepare(page);
  const query = { url: `${server.base}/data/${file}`, camera: JSON.stringify(CAMERA), plugin };
  await page.goto(`${server.base}/pages/gltf.html?${new URLSearchParams(query)}`);
  await page.waitForFunction(() => window.state?.done || window.state?.error, null, { timeout: 120000 });
  page.state = await page.evaluate(() => window.state);
  return page;
}

/** What the console says of problems; graphics drivers warn of their speed. */
const problems = (page) => page.log.filter((text) => !text.includes('GPU stall'));

const validated = async (file) => {
  const validator = createRequire(join(process.env.GSVX_NPM, 'package.json'))('gltf-validator');
  const { validatorVersion, issues } = await validator.validateBytes(new Uint8Array(readFileSync(at(file))), { maxIssues: 0 });
  assert.equal(validatorVersion, '2.0.0-dev.3.10');
  return issues.messages.map(({ code, severity, pointer }) => `${severity} ${code} ${pointer}`).sort();
};

test('a .glb is valid', { skip }, async () => {
  // This validator, the newest, does not know the extensions. It says so once each, and calls the name of each
  // attribute invalid, for it has a colon and no underscore in front. The view of a stream is unused to it. These
  // messages are expected, and no other.
  const unknown = ATTRIBUTES.map((name) => `0 MESH_PRIMITIVE_INVALID_ATTRIBUTE /meshes/0/primitives/0/attributes/KHR_gaussian_splatting:${name}`);
  const of = (i) => `2 UNSUPPORTED_EXTENSION /extensionsUsed/${i}`;
  assert.deepEqual(await validated('room.glb'), [...unknown, of(0)].sort());
  assert.deepEqual(await validated('compressed.glb'), [...unknown, of(0), of(1), '2 UNUSED_OBJECT /bufferViews/0'].sort());
});

// As for the adapter of three.js: the addon ends each Gaussian at two standard deviations, and dims small ones.
for (const [name, file, plugin, prepare, least] of [
  ['gltf', 'room', '', () => {}, 29.5], ['gltf-alike', 'room', '', alike, 43], ['gltf-plugin', 'room', 'yes', alike, 43],
  ['gltf-compressed', 'compressed', 'yes', () => {}, 29.5], ['gltf-compressed-alike', 'compressed', 'yes', alike, 43],
]) {
  test(`three.js shows what gsvx render shows: ${name}`, { skip }, async () => {
    const page = await open(`${file}.glb`, { plugin, prepare });
    assert.deepEqual([page.state.failed, page.state.error], [undefined, undefined]);
    const shot = async () => {
      const picture = await page.screenshot();
      writeFileSync(join(pictures, `${name}.png`), picture);
      return picture;
    };
    const got = await nearing(page, shot, readFileSync(at(`${file}.png`)), least);
    console.log(`three.js, ${name}: ${got.toFixed(2)} dB`);
    assert.ok(got >= least, `${got} dB`);
    assert.deepEqual(problems(page), []);
    await page.close();
  });
}

test('three.js without the plugin names the extension that it lacks', { skip }, async () => {
  const page = await open('compressed.glb');
  assert.ok(page.log.some((text) => text.includes(COMPRESSION)), page.log.join('\n'));
  await page.close();
});

/** Writes a .glb with its JSON changed. */
function changed(name, change) {
  const file = readFileSync(at('compressed.glb'));
  const end = 20 + file.readUInt32LE(12);
  const json = JSON.parse(file.toString('utf8', 20, end));
  change(json);
  const text = Buffer.from(JSON.stringify(json));
  const padded = Buffer.concat([text, Buffer.alloc(-text.length & 3, ' ')]);
  const head = Buffer.from(file.subarray(0, 20));
  head.writeUInt32LE(20 + padded.length + file.length - end, 8);
  head.writeUInt32LE(padded.length, 12);
  writeFileSync(at(name), Buffer.concat([head, padded, file.subarray(end)]));
  return name;
}

test('a stream that is damaged, or not what the accessors promise, is an error that says so', { skip }, async () => {
  const length = readFileSync(at('compressed.glb')).length;
  const compression = (json) => EXTENSIONS.slice(1).split('/').reduce((node, key) => node[key], json)[COMPRESSION];
  for (const [file, code, needle] of [
    [`compressed.glb?flip=${length - 60}`, 'damaged', 'CRC-32C'],
    [changed('count.glb', (json) => json.accessors.forEach((a) => { a.count = 7; })), 'damaged', 'promise 7 Gaussians'],
    [changed('view.glb', (json) => { compression(json).bufferView = 9; }), 'damaged', 'bufferView that is not there'],
    [changed('short.glb', (json) => { json.bufferViews[0].byteLength = 5000; }), 'truncated', ''],
  ]) {
    const page = await open(file, { plugin: 'yes' });
    const { failed } = page.state;
    assert.equal(failed?.code, code, JSON.stringify(page.state));
    assert.ok(failed.message.includes(needle), failed.message);
    await page.close();
  }
});
