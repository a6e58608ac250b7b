// Streamed SOG in PlayCanvas as it is, beside streams with the parser of the package, on five copies of a model: PSNR to
// `gsvx render` of the model, and bytes fetched. Writes docs/results/levels.md.
// CHROMIUM=chromium GSVX_BIN=gsvx node bench/levels.mjs MODEL [CAMERAS]
// CAMERAS is a cameras.json with the views `near` and `far`; without it they are those of la_fontaine. If PLAYCANVAS_22
// names a node_modules with PlayCanvas 2.22, SOG is also measured there, with levels chosen by error and by distance.
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { basename, join, resolve } from 'node:path';

const npm = resolve(import.meta.dirname, '..');
const root = resolve(npm, '../../..');
process.env.GSVX_NPM = npm;
process.env.GSVX_ROOT = root;
const { gsvx, launch, missing, psnr, serve } = await import('../test/browser.mjs');
const { replicate } = await import('./model.mjs');

const COPIES = 5;
const JITTER = 1e-5;
/** Most Gaussians that the engine draws. */
const BUDGETS = [300_000, 1_000_000];
/** Seconds without a request after which all is fetched that the view needs. */
const STILL = 8;
const near = {
  id: 0, img_name: 'near', width: 480, height: 320, fx: 1320, fy: 1320, position: [-0.1186062, -0.0998998, -0.585102],
  rotation: [[0.980067, -0.019834, 0.197677], [0, 0.995004, 0.099833], [-0.198669, -0.097843, 0.97517]],
};
const far = { ...near, id: 1, img_name: 'far', fx: 390, fy: 390, position: [0.266969, -0.339499, -2.92551] };

/**
 * Opens a page of PlayCanvas on a list of places in the server's folder `data`, with options of test/pages/playcanvas.html,
 * and waits until nothing more is fetched. `requests` are those of that folder.
 */
async function streamed(browser, server, list, camera, options) {
  const page = await browser.newPage({ viewport: { width: camera.width, height: camera.height }, deviceScaleFactor: 1 });
  page.on('console', (m) => { if (m.type() === 'error') console.error(m.text()); });
  const from = server.log.length;
  const query = { url: `${server.base}/data/${list}`, camera: JSON.stringify(camera), options: JSON.stringify(options) };
  await page.goto(`${server.base}/pages/playcanvas.html?${new URLSearchParams(query)}`);
  await page.waitForFunction(() => window.state?.done || window.state?.error, null, { timeout: 300_000 });
  for (let still = 0, seen = 0; still < STILL; still = server.log.length === seen ? still + 1 : 0) {
    seen = server.log.length;
    await page.waitForTimeout(1000);
  }
  return { page, requests: server.log.slice(from).filter(({ path }) => path.startsWith('/data/')) };
}

const why = missing() || (!process.argv[2] && 'SKIPPED: no model is named');
if (why) {
  console.error(why);
  process.exit(0);
}
const source = resolve(process.argv[2]);
const cameras = process.argv[3] ? JSON.parse(readFileSync(process.argv[3])) : [near, far];
const folder = mkdtempSync(join(tmpdir(), 'gsvx-levels-'));
const inside = (name) => join(folder, name);
const count = COPIES * JSON.parse(gsvx('info', source, '--json')).gaussians;

gsvx('convert', source, inside('one.ply'));
replicate(inside('one.ply'), inside('model.ply'), count, JITTER);
writeFileSync(inside('cameras.json'), JSON.stringify(cameras));
gsvx('render', inside('model.ply'), '--cameras', inside('cameras.json'), '-o', inside('reference'));
gsvx('encode', inside('model.ply'), '-o', inside('model.gsvx'), '--web', '--no-estimate');
rmSync(inside('model.ply'));
for (const format of ['playcanvas', 'sog']) gsvx('lod', inside('model.gsvx'), '-o', inside(format), '--format', format);

const browser = await launch();
/** PSNR and bytes of a view. */
async function measured(engines, format, camera, options) {
  const server = await serve({ gsvx: npm, engines, pages: join(npm, 'test/pages'), data: folder });
  const { page, requests } = await streamed(browser, server, `${format}/lod-meta.json`, camera, { ...options, stock: format === 'sog' });
  const reference = readFileSync(inside(`reference/${camera.img_name}.png`));
  let [last, got] = [NaN, NaN];
  // The engine sorts beside the frames.
  for (let same = 0; same < 3; same = Math.abs(got - last) < 0.005 ? same + 1 : 0) {
    await page.waitForTimeout(1000);
    [last, got] = [got, await psnr(page, await page.screenshot(), reference)];
  }
  await page.close();
  await server.close();
  const text = `${got.toFixed(2)} dB, ${(requests.reduce((sum, { bytes }) => sum + bytes, 0) / 1e6).toFixed(2)} MB`;
  console.error(`${format}, ${camera.img_name}, ${JSON.stringify(options)}: ${text}`);
  return text;
}

const number = (n) => n.toLocaleString('en');
const table = (titles, rows) => [titles, titles.map(() => '---'), ...rows].map((cells) => `| ${cells.join(' | ')} |`).join('\n');
const engines = join(npm, 'node_modules');
const rows = [];
for (const camera of cameras) {
  for (const budget of BUDGETS) {
    const cells = [`${camera.img_name}, ${number(budget)}`];
    for (const format of ['playcanvas', 'sog']) cells.push(await measured(engines, format, camera, { budget }));
    rows.push(cells);
  }
}
const older = [];
for (const camera of process.env.PLAYCANVAS_22 ? cameras : []) {
  for (const budget of BUDGETS) {
    const cells = [`${camera.img_name}, ${number(budget)}`];
    for (const mode of ['error', 'distance']) cells.push(await measured(process.env.PLAYCANVAS_22, 'sog', camera, { budget, mode }));
    older.push(cells);
  }
}
await browser.close();
rmSync(folder, { recursive: true });
const { version } = JSON.parse(readFileSync(join(engines, 'playcanvas/package.json')));
writeFileSync(join(root, 'docs/results/levels.md'), `# Levels of detail in PlayCanvas

\`crates/gsvx-web/npm/bench/levels.mjs\`: five copies of ${basename(source)} (${number(count)} Gaussians) of \`gsvx encode --web\` and \`gsvx lod\`,
within a budget of Gaussians. PSNR is to \`gsvx render\` of the model; bytes are all that is fetched. PlayCanvas ${version}:

${table(['view, budget', 'streams', 'SOG'], rows)}
${older.length ? `
PlayCanvas 2.22 can choose levels of SOG by the errors in \`lod-meta.json\`, or as 2.23 by distance. ${older.map(([view, ...two]) => `${view}: ${two.join(' and ')}`).join('; ')}.
` : ''}`);
