// A large scene that PlayCanvas streams from the folder of `gsvx lod`: which bytes it fetches.
import { mkdirSync, readFileSync, readdirSync, statSync, writeFileSync } from 'node:fs';
import { basename, join } from 'node:path';
import { copies, gsvx, launch, serve } from '../test/browser.mjs';

const COUNT = 5_000_000;
/** Gaussians that the engine may draw at a time. */
const BUDGET = 300_000;
/** Seconds without a request after which all is fetched that the view needs. */
const STILL = 8;

/** Views: at the first photo of fox in the first copy, and from where all copies are in the picture. */
const near = {
  id: 0, img_name: 'camera', width: 179, height: 320, fx: 232, fy: 232,
  position: [-2.545, 0.862, -3.342], rotation: [[1, 0.0022, -0.0006], [-0.0022, 1, -0.0057], [0.0006, 0.0057, 1]],
};
const far = { ...near, position: [97.5, 0.9, -63.3] };

/**
 * Opens a page of PlayCanvas on a list of places in the server's folder `data`, with options of test/pages/playcanvas.html,
 * and waits until nothing more is fetched. `requests` are those of that folder.
 */
export async function streamed(browser, server, list, camera, options) {
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

/** Measures the views of copies of the model at `source`. `npm` is the package's folder. */
export async function large(source, npm, folder, pictures) {
  const [stream, tree] = ['large.gsvx', 'large'].map((name) => join(folder, name));
  await copies(source, stream, COUNT);
  gsvx('lod', stream, '-o', tree);
  mkdirSync(pictures, { recursive: true });
  const server = await serve({ gsvx: npm, engines: join(npm, 'node_modules'), pages: join(npm, 'test/pages'), data: tree });
  const browser = await launch();
  const views = [];
  for (const [name, camera] of [['near', near], ['far', far]]) {
    const { page, requests } = await streamed(browser, server, 'lod-meta.json', camera, { budget: BUDGET });
    const files = requests.map(({ path }) => basename(path)).filter((file) => file.endsWith('.gsvx'));
    const bytes = files.reduce((sum, file) => sum + statSync(join(tree, file)).size, 0);
    writeFileSync(join(pictures, `large-${name}.png`), await page.screenshot());
    views.push({ name, bytes, files: files.length, fine: files.filter((file) => file.startsWith('0-')).length });
    await page.close();
  }
  await browser.close();
  await server.close();
  const { lodLevels: levels, filenames, tree: { children } } = JSON.parse(readFileSync(join(tree, 'lod-meta.json')));
  const total = readdirSync(tree).reduce((sum, file) => sum + statSync(join(tree, file)).size, 0);
  return { count: COUNT, budget: BUDGET, views, total, levels, files: filenames.length, places: children.length };
}

/** The section of the page. */
export function section({ count, budget, views, total, levels, files, places }) {
  const number = (n) => n.toLocaleString('en');
  const megabytes = (n) => (n / 1e6).toFixed(2);
  const names = { near: 'at a photo of the first copy', far: 'all copies, from outside' };
  const row = (v) => `| ${names[v.name]} | ${megabytes(v.bytes)} | ${((100 * v.bytes) / total).toFixed(1)} % | ${v.files} | ${v.fine} |`;
  return `## A large scene

fox, replicated to ${number(count)} Gaussians; \`gsvx encode --web\`, then \`gsvx lod\`: ${number(places)} places at ${levels} levels of
detail, in ${files} files of ${megabytes(total)} MB. PlayCanvas streams them within a budget of ${number(budget)} Gaussians.

| view | fetched, MB | of all | files | of these at the finest level |
|---|---:|---:|---:|---:|
${views.map(row).join('\n')}
`;
}
