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
/** Switches of Node for the compiler of WebAssembly. */
const SWITCHES = ['--liftoff-only', '--no-liftoff', '--wasm-num-compilation-tasks=1'];
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
  const ours = sum(npm, ['index.js', 'core.js', 'worker.js', 'source.js', 'load.js', 'error.js', 'wasm/gsvx.js', 'wasm/gsvx_bg.wasm']);
  return { ours, spz: sum(join(npm, 'node_modules/@adobe/spz/dist'), ['spz.js']) };
}

/** Runs a decoder in a process of its own; what it prints. */
const alone = (...args) => switched([], ...args);

/** The same, with switches of Node. */
function switched(switches, ...args) {
  const { stdout, stderr, status } = spawnSync('node', ['--expose-gc', ...switches, join(import.meta.dirname, 'decoder.mjs'), ...args], { encoding: 'utf8', maxBuffer: 1 << 24 });
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

try {
  replicate(source, join(folder, 'model.ply'), COUNT);
  gsvx('encode', join(folder, 'model.ply'), '-o', join(folder, 'model.gsvx'), '--web');
  gsvx('convert', join(folder, 'model.ply'), join(folder, 'model4.spz'));
  alone('spz3', join(folder, 'model4.spz'), join(folder, 'model.spz'));
  const decode = {};
  for (const layout of ['planar', 'packed', 'covariances']) decode[layout] = best('gsvx', join(folder, 'model.gsvx'), layout);
  const small = join(root, 'fixtures/streams/default.gsvx');
  for (const layout of ['planar', 'packed', 'covariances']) decode[layout].later = alone('gsvx', join(folder, 'model.gsvx'), layout, small).peak;
  replicate(source, join(folder, 'twice.ply'), 2 * COUNT);
  gsvx('encode', join(folder, 'twice.ply'), '-o', join(folder, 'twice.gsvx'), '--web', '--no-estimate');
  const twice = { ...best('gsvx', join(folder, 'twice.gsvx'), 'planar'), later: alone('gsvx', join(folder, 'twice.gsvx'), 'planar', small).peak };
  rmSync(join(folder, 'twice.ply'));
  const saved = SWITCHES.map((name) => decode.planar.peak - switched([name], 'gsvx', join(folder, 'model.gsvx'), 'planar').peak);
  decode.spz = best('spz', join(folder, 'model.spz'));
  decode.spz4 = best('spz', join(folder, 'model4.spz'));

  const server = await serve({ gsvx: npm, engines: join(npm, 'node_modules'), bench: import.meta.dirname, data: folder });
  const browser = await launch();
  const page = {};
  for (const layout of ['planar', 'packed']) page[layout] = await inPage(browser, server.base, { what: 'decoding', layout, url: `${server.base}/data/model.gsvx` });
  const together = await inPage(browser, server.base, { what: 'together', layout: 'packed', url: `${server.base}/data/model.gsvx` });
  const link = {};
  for (const name of ['model.gsvx', 'model.spz', 'model.ply']) {
    link[name] = await inPage(browser, server.base, { what: 'link', url: `${server.base}/data/${name}?rate=${RATE}` });
  }
  const version = browser.version();
  await browser.close();
  await server.close();

  /** Growth of the peak for each byte of planar output, and what there is without output. */
  const slope = (one, two) => (two - one) / (twice.output - decode.planar.output);
  const fixed = (one, two) => one - slope(one, two) * decode.planar.output;
  const { ours, spz } = packages();
  const speed = (r) => (r.count / r.cpu / 1e6).toFixed(2);
  const row = (name, r) => `| ${name} | ${r.seconds.toFixed(2)} | ${r.cpu.toFixed(2)} | ${speed(r)} | ${megabytes(r.output)} | ${megabytes(r.peak)} | ${(r.peak / r.output).toFixed(2)} | ${r.later ? (r.later / r.output).toFixed(2) : ''} |`;
  const text = `# In the browser

\`cargo xtask web --bench\`: fox, replicated to ${COUNT.toLocaleString('en')} Gaussians with SH degree 3, one run. Streams are those of
\`gsvx encode --web\` (${megabytes(size('model.gsvx'))} MB), SPZ is version 3 (${megabytes(size('model.spz'))} MB) and version 4
(${megabytes(size('model4.spz'))} MB) of all 8 bits per SH coefficient, PLY is ${megabytes(size('model.ply'))} MB. ${cpus()[0].model},
${cpus().length} cores; Node ${process.version}, Chromium ${version}.

## What a page loads

| package | bytes, gzip |
|---|---:|
| gsvx: decoder, loader and worker | ${ours.toLocaleString('en')} |
| @adobe/spz 0.2.3 | ${spz.toLocaleString('en')} |

## Decoding in one worker

A process of its own for each row, the best of three. Other programs ran beside them (the load average was
${loadavg()[0].toFixed(0)}), so the processor's time tells more than the seconds that passed; it has all threads in it, those
that compile WebAssembly too. Peak is the growth of the process's memory from before the decoding; it holds the
output. The first decoding of a page compiles the decoder, which the count of @adobe/spz does not have: it is made
ready before. "Later" is the peak of a decoding after one of a small stream.

| decoder and output | seconds | processor, s | M Gaussians per processor second | output, MB | peak, MB | peak / output | later |
|---|---:|---:|---:|---:|---:|---:|---:|
${row('gsvx, planar (floats)', decode.planar)}
${row('gsvx, planar, of twice the model', twice)}
${row('gsvx, packed (Spark, PlayCanvas)', decode.packed)}
${row('gsvx, covariances (three.js)', decode.covariances)}
${row('@adobe/spz, version 3 (floats)', decode.spz)}
${row('@adobe/spz, version 4 (floats)', decode.spz4)}

In Chromium: planar ${(page.planar.count / page.planar.seconds / 1e6).toFixed(2)} M Gaussians/s, packed
${(page.packed.count / page.packed.seconds / 1e6).toFixed(2)}. While chunks came in, the longest time that the main thread was not
free was ${page.planar.longest.toFixed(1)} ms (planar) and ${page.packed.longest.toFixed(1)} ms (packed).

| aim | here |
|---|---:|
| 0.8 M Gaussians per second, all SH | ${speed(decode.planar)} |
| the main thread is kept for 16 ms at most | ${Math.max(page.planar.longest, page.packed.longest).toFixed(1)} ms |
| peak of at most 1.3 times the output | first decoding ${(decode.planar.peak / decode.planar.output).toFixed(2)}, later ones ${(decode.planar.later / decode.planar.output).toFixed(2)} |

For each byte of output the peak of planar grows by ${slope(decode.planar.peak, twice.peak).toFixed(2)} bytes. The rest, ${megabytes(fixed(decode.planar.peak, twice.peak))} MB at the first
decoding and ${megabytes(fixed(decode.planar.later, twice.later))} MB at later ones, is there for any scene: the worker, WebAssembly's memory, and what the engine needs to
compile the decoder, in the background and while it runs. Switches of Node change that part, which a library cannot
set: ${SWITCHES.map((name, i) => `\`${name}\` takes ${megabytes(saved[i])} MB off it`).join(', ')}. The bound
of 1.3 holds for first decodings from an output of ${megabytes(fixed(decode.planar.peak, twice.peak) / (1.3 - slope(decode.planar.peak, twice.peak)))} MB on. A layout of fewer bytes has a greater ratio.

Two whole decodings at once, each in a worker, reach ${(together.two / 1e6).toFixed(2)} M Gaussians/s together in Chromium (packed), one alone ${(together.one / 1e6).toFixed(2)}. Chunks
decode alone, so several workers could share a stream, but on these ${cpus().length} cores that is the most they would reach.

## Over a link of 10 Mbit/s

Seconds in Spark 2.2.0 until a first whole picture can be drawn (of .gsvx: the coarse level) and until all is there. The
drawing itself is not in it: this machine draws in software. The files differ in quality too: SPZ keeps nearly all of the
model, a stream of quality 50 is 35 to 38 dB from it.

| file | first picture | all |
|---|---:|---:|
${Object.entries(link).map(([name, { first, last }]) => `| ${name} | ${first.toFixed(2)} | ${last.toFixed(2)} |`).join('\n')}
`;
  writeFileSync(join(root, 'docs/results/web.md'), text);
  console.log(text);
} finally {
  rmSync(folder, { recursive: true, force: true });
}
