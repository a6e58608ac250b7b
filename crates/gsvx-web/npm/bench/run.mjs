// Measures the package beside its peers and writes docs/results/web.md: node bench/run.mjs [MODEL]
// One scene, one run, one thread each. The model is the scene fox, replicated to 500 000 Gaussians.
import { spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, statSync, writeFileSync } from 'node:fs';
import { cpus, loadavg, tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { gzipSync } from 'node:zlib';

const npm = resolve(import.meta.dirname, '..');
const root = resolve(npm, '../../..');
process.env.GSVX_NPM = npm;
const { gsvx, launch, missing, serve } = await import('../test/browser.mjs');
const { replicate } = await import('./model.mjs');

const COUNT = 500_000;
/** Bytes a second: 10 Mbit/s. */
const RATE = 1_250_000;
const source = resolve(process.argv[2] ?? join(root, '../shared/scenes/fox/point_cloud.ply'));
if (missing() || !existsSync(source)) {
  console.error(missing() || `SKIPPED: ${source} is not there; nothing is measured`);
  process.exit(0);
}
const folder = mkdtempSync(join(tmpdir(), 'gsvx-bench-'));
const megabytes = (n) => (n / 1e6).toFixed(2);
const size = (name) => statSync(join(folder, name)).size;

/** Compressed sizes of what a page has to load. */
function packages() {
  const sum = (base, files) => files.reduce((n, f) => n + gzipSync(readFileSync(join(base, f)), { level: 9 }).length, 0);
  const ours = sum(npm, ['index.js', 'core.js', 'worker.js', 'source.js', 'load.js', 'error.js', 'options.js', 'sequence.js', 'thread.js', 'wasm/gsvx.js', 'wasm/gsvx_bg.wasm']);
  return { ours, spz: sum(join(npm, 'node_modules/@adobe/spz/dist'), ['spz.js']) };
}

/** Runs a decoder in a process of its own; what it prints. */
function alone(...args) {
  const { stdout, stderr, status } = spawnSync('node', ['--expose-gc', join(import.meta.dirname, 'decoder.mjs'), ...args], { encoding: 'utf8', maxBuffer: 1 << 24 });
  if (status !== 0) throw new Error(stderr);
  return JSON.parse(stdout.trim().split('\n').at(-1));
}

/** The best of three, by the processor's time. */
function best(...args) {
  const runs = [1, 2, 3].map(() => alone(...args));
  return runs.reduce((a, b) => (a.cpu < b.cpu ? a : b));
}

async function inPage(browser, base, query) {
  const page = await browser.newPage();
  page.on('console', (m) => { if (m.type() === 'error') console.error(m.text()); });
  await page.goto(`${base}/bench/page.html?${new URLSearchParams(query)}`);
  await page.waitForFunction(() => window.result, null, { timeout: 400_000 });
  const result = await page.evaluate(() => window.result);
  await page.close();
  if (result.error) throw new Error(result.error);
  return result;
}

/** Bytes of a process that are its own: not the pages of files that it maps, such as Chromium itself. */
function uses(process) {
  const status = readFileSync(`/proc/${process}/status`, 'utf8');
  const of = (name) => 1024 * Number(new RegExp(`${name}:\\s+(\\d+)`).exec(status)[1]);
  return of('RssAnon') + of('RssShmem');
}

/** What decodings of a scene take in a page's process, the first and a later one: the greatest use, every 2 ms. */
async function peaks(base, layout) {
  const browser = await launch();
  const page = await browser.newPage();
  await page.goto(`${base}/bench/page.html?${new URLSearchParams({ what: 'scene', layout, url: `${base}/data/model.gsvx` })}`);
  await page.waitForFunction(() => Boolean(window.again));
  const { processInfo } = await (await browser.newBrowserCDPSession()).send('SystemInfo.getProcessInfo');
  const pages = processInfo.filter(({ type }) => type === 'renderer').map(({ id }) => id);
  const collector = await page.context().newCDPSession(page);
  const found = [];
  for (const which of ['first', 'later']) {
    await collector.send('HeapProfiler.collectGarbage');
    await page.waitForTimeout(500);
    const before = pages.map(uses);
    const most = [...before];
    const look = () => pages.map(uses).forEach((now, i) => { most[i] = Math.max(most[i], now); });
    const timer = setInterval(look, 2);
    const { seconds, output, count } = await page.evaluate(() => window.again());
    clearInterval(timer);
    look();
    found.push({ which, seconds, count, output, own: Math.max(...most.map((m, i) => m - before[i])) });
  }
  await browser.close();
  return found;
}

try {
  replicate(source, join(folder, 'model.ply'), COUNT);
  gsvx('encode', join(folder, 'model.ply'), '-o', join(folder, 'model.gsvx'), '--web');
  gsvx('convert', join(folder, 'model.ply'), join(folder, 'model4.spz'));
  alone('spz3', join(folder, 'model4.spz'), join(folder, 'model.spz'));
  const decode = {};
  for (const layout of ['planar', 'packed', 'covariances']) decode[layout] = best('gsvx', join(folder, 'model.gsvx'), layout);
  decode.spz = best('spz', join(folder, 'model.spz'));
  decode.spz4 = best('spz', join(folder, 'model4.spz'));

  const server = await serve({ gsvx: npm, engines: join(npm, 'node_modules'), bench: import.meta.dirname, data: folder });
  const browser = await launch();
  const longest = {};
  for (const layout of ['planar', 'packed']) ({ longest: longest[layout] } = await inPage(browser, server.base, { what: 'watching', layout, url: `${server.base}/data/model.gsvx` }));
  const shared = {};
  for (const layout of ['planar', 'packed']) shared[layout] = await inPage(browser, server.base, { what: 'shared', layout, url: `${server.base}/data/model.gsvx` });
  const link = {};
  for (const name of ['model.gsvx', 'model.spz', 'model.ply']) {
    link[name] = await inPage(browser, server.base, { what: 'link', url: `${server.base}/data/${name}?rate=${RATE}` });
  }
  const memory = {};
  for (const layout of ['planar', 'packed', 'covariances']) memory[layout] = await peaks(server.base, layout);
  const version = browser.version();
  await browser.close();
  await server.close();

  const rate = ({ count, seconds }) => (count / seconds / 1e6).toFixed(2);
  const { ours, spz } = packages();
  const speed = (r) => (r.count / r.cpu / 1e6).toFixed(2);
  const ratio = (bytes, { output }) => `${megabytes(bytes)} (${(bytes / output).toFixed(2)})`;
  const row = (name, r) => `| ${name} | ${r.seconds.toFixed(2)} | ${r.cpu.toFixed(2)} | ${speed(r)} | ${megabytes(r.output)} | ${ratio(r.peak, r)} |`;
  const used = Object.entries(memory).map(([layout, [first, later]]) => `| ${layout} | ${first.seconds.toFixed(2)} | ${later.seconds.toFixed(2)} | ${rate(later)} | ${ratio(first.own, first)} | ${ratio(later.own, later)} |`).join('\n');
  const text = `# In the browser

\`cargo xtask web --bench\`: fox, replicated to ${COUNT.toLocaleString('en')} Gaussians with SH degree 3, one run. Streams are those of
\`gsvx encode --web\` (${megabytes(size('model.gsvx'))} MB), SPZ is version 3 (${megabytes(size('model.spz'))} MB) and version 4
(${megabytes(size('model4.spz'))} MB) of 8 bits per SH coefficient, PLY is ${megabytes(size('model.ply'))} MB. ${cpus()[0].model},
${cpus().length} cores; Node ${process.version}, Chromium ${version}.

A page loads ${ours.toLocaleString('en')} bytes (gzip) of gsvx, ${spz.toLocaleString('en')} of @adobe/spz 0.2.3.

## Beside another decoder

In Node, one worker, a process for each row, the best of three; load average ${loadavg()[0].toFixed(0)}. gsvx includes the compiling of WebAssembly, @adobe/spz does not. Peak is the growth of the resident memory, with the output, also as a multiple of that.

| decoder and output | seconds | processor, s | M Gaussians / processor s | output, MB | peak, MB |
|---|---:|---:|---:|---:|---:|
${row('gsvx, planar (floats)', decode.planar)}
${row('gsvx, packed (Spark, PlayCanvas)', decode.packed)}
${row('gsvx, covariances (three.js)', decode.covariances)}
${row('@adobe/spz, version 3 (floats)', decode.spz)}
${row('@adobe/spz, version 4 (floats)', decode.spz4)}

## In a page

Whole scenes in Chromium, one worker; growth of the page's memory. The first decoding compiles the decoder.

| layout | first, s | later, s | later, M Gaussians/s | growth at first, MB | later |
|---|---:|---:|---:|---:|---:|
${used}

## Workers, and the page's own thread

Two workers decode ${Object.entries(shared).map(([layout, { one, two }]) => `${(two / one).toFixed(2)} (${layout})`).join(' and ')} times as fast as one, the best of four.
The page's main thread is busy for at most ${longest.planar.toFixed(1)} ms (planar) and ${longest.packed.toFixed(1)} ms
(packed) at a time.

The aims are 0.8 M Gaussians per second in one worker, 16 ms of the main thread, and a peak of 1.3 times the output.

## Over a link of 10 Mbit/s

Seconds in Spark 2.2.0, without drawing, until a first whole picture (of .gsvx: the coarse level) and until all is there. The stream has quality 50 ([quality.md](quality.md)).

| file | first picture | all |
|---|---:|---:|
${Object.entries(link).map(([name, { first, last }]) => `| ${name} | ${first.toFixed(2)} | ${last.toFixed(2)} |`).join('\n')}

A large scene: [levels.md](levels.md).
`;
  writeFileSync(join(root, 'docs/results/web.md'), text);
  console.log(text);
} finally {
  rmSync(folder, { recursive: true, force: true });
}
