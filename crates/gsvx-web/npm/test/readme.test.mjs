// The examples of the READMEs, as they stand there, run in Chromium.
import assert from 'node:assert/strict';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { browser, folder, gsvx, missing, pictures, server, setUp } from './browser.mjs';

const skip = missing();
const root = process.env.GSVX_ROOT;

/** What each example has in common with its page: what it finds there, and what is looked at afterwards. */
const draws = 'renderer.setSize(480, 320); document.body.append(renderer.domElement);';
const playcanvas = `import { started } from '/pages/app.js';
const canvas = document.createElement('canvas');
document.body.append(canvas);
const app = await started(pc, canvas, 480, 320);
const eye = new pc.Entity();
eye.addComponent('camera', { clearColor: new pc.Color(0, 0, 0), fov: 50, nearClip: 0.01, farClip: 100 });
eye.setEulerAngles(180, 0, 0); // the room is above
app.root.addChild(eye);`;
const EXAMPLES = [
  { of: 'README.md', with: 'console.log(scene.count', after: 'window.count = scene.count;' },
  {
    of: 'README.md', with: 'onChunk: ({ id, replaces, count, data })',
    before: `import { decode } from 'gsvx';
const shown = new Map();
function show(id, replaces, count, data) {
  for (const gone of replaces) shown.delete(gone);
  shown.set(id, data.a.length >= 4 * count && !data.sh2 ? count : NaN);
}`,
    after: 'window.count = [...shown.values()].reduce((sum, n) => sum + n);',
  },
  { of: 'README.md', with: 'loadSequence(', after: 'window.count = frame.count;', file: 'clip.gsvx' },
  { of: 'README.md', with: "from 'gsvx/spark'", after: `${draws} await splats.done;`, draws: true },
  { of: 'README.md', with: "from 'gsvx/three'", after: draws, draws: true, webgpu: true },
  {
    of: 'README.md', with: "from 'gsvx/gltf'", before: `import * as THREE from 'three/webgpu';
const renderer = new THREE.WebGPURenderer();
renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
const [scene, camera] = [new THREE.Scene(), new THREE.PerspectiveCamera(50, 1.5, 0.01, 100)];`,
    after: `camera.rotation.x = Math.PI; renderer.setAnimationLoop(() => renderer.render(scene, camera)); ${draws}`, draws: true, webgpu: true,
  },
  {
    of: 'README.md', with: "from 'gsvx/playcanvas'", before: playcanvas,
    after: 'await new Promise((resolve) => asset.ready(resolve));', draws: true,
  },
  {
    of: 'README.md', with: "'web/lod-meta.json'",
    before: `import * as pc from 'playcanvas';
import { GSVXParser } from 'gsvx/playcanvas';
${playcanvas}
app.loader.getHandler('gsplat').addParser(new GSVXParser(app));
const entity = new pc.Entity();
app.root.addChild(entity);`,
    after: 'await new Promise((resolve) => city.ready(resolve));', draws: true,
  },
];

setUp(skip, async () => {
  gsvx('encode', join(root, 'fixtures/room/point_cloud.ply'), '-o', join(folder, 'scene.gsvx'), '--web', '--no-estimate');
  gsvx('convert', join(folder, 'scene.gsvx'), join(folder, 'scene.glb'), '--compress');
  gsvx('lod', join(folder, 'scene.gsvx'), '-o', join(folder, 'web'));
  gsvx('encode', ...Array(18).fill(join(root, 'fixtures/room/point_cloud.ply')), '--fps', '30', '-o', join(folder, 'clip.gsvx'), '--no-estimate');
});

const blocks = (file) => [...readFileSync(join(process.env.GSVX_NPM, file), 'utf8').matchAll(/```js\n(.*?)```/gs)].map((m) => m[1]);

test('no example of the READMEs is left out', () => {
  for (const file of ['README.md', '../../../README.md']) {
    for (const code of blocks(file)) assert.ok(EXAMPLES.some((e) => e.of === file && code.includes(e.with)), code);
  }
});

function html({ before = '', after, webgpu }, code) {
  const three = `/engines/three/build/three.${webgpu ? 'webgpu' : 'module'}.js`;
  const imports = {
    three, 'three/webgpu': three, 'three/tsl': '/engines/three/build/three.tsl.js', 'three/addons/': '/engines/three/examples/jsm/',
    '@sparkjsdev/spark': '/engines/@sparkjsdev/spark/dist/spark.module.js', playcanvas: '/engines/playcanvas/build/playcanvas.mjs',
    gsvx: '/gsvx/index.js', 'gsvx/spark': '/gsvx/spark.js', 'gsvx/three': '/gsvx/three.js', 'gsvx/gltf': '/gsvx/gltf.js', 'gsvx/playcanvas': '/gsvx/playcanvas.js',
  };
  return `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,"><style>body { margin: 0; background: #000 }</style>
<script type="importmap">${JSON.stringify({ imports })}</script>
<script type="module">\n${before}\n${code}\n${after}\nwindow.done = true;\n</script>`;
}

/** How many pixels of a picture are not black. */
const lit = (page, png) => page.evaluate(async (base64) => {
  const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${base64}`)).blob());
  const canvas = new OffscreenCanvas(image.width, image.height).getContext('2d');
  canvas.drawImage(image, 0, 0);
  const { data } = canvas.getImageData(0, 0, image.width, image.height);
  let n = 0;
  for (let i = 0; i < data.length; i += 4) n += data[i] + data[i + 1] + data[i + 2] > 60;
  return n / (image.width * image.height);
}, png.toString('base64'));

EXAMPLES.forEach((example, i) => {
  test(`the example of ${example.of} with ${example.with}`, { skip, timeout: 400000 }, async () => {
    const code = blocks(example.of).find((block) => block.includes(example.with));
    assert.ok(code, 'the page has no such example');
    writeFileSync(join(folder, `example${i}.html`), html(example, code));
    const page = await browser.newPage({ viewport: { width: 480, height: 320 }, deviceScaleFactor: 1 });
    const problems = [];
    page.on('console', (m) => { if (m.type() === 'error') problems.push(m.text()); });
    page.on('pageerror', (e) => problems.push(e.message));
    await page.goto(`${server.base}/data/example${i}.html`);
    await Promise.race([
      page.waitForFunction(() => window.done, null, { timeout: 120000 }),
      page.waitForEvent('pageerror', { timeout: 120000 }),
    ]);
    assert.deepEqual(problems, []);
    if (example.draws) {
      let share = 0;
      for (let tries = 0; tries < 30 && share < 0.5; tries += 1) {
        await page.waitForTimeout(1000);
        const png = await page.screenshot();
        writeFileSync(join(pictures, `readme-${i}.png`), png);
        share = await lit(page, png);
      }
      assert.ok(share >= 0.5, `${share} of the picture is drawn`);
    } else {
      const info = JSON.parse(gsvx('info', join(folder, example.file ?? 'scene.gsvx'), '--json'));
      assert.equal(await page.evaluate(() => window.count), info.gaussians ?? info.groups[0].gaussians);
    }
    assert.deepEqual(problems, []);
    await page.close();
  });
});
