// Chromium and a file server for the tests that need a browser.
import { createServer } from 'node:http';
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, statSync } from 'node:fs';
import { spawnSync } from 'node:child_process';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { extname, join, normalize } from 'node:path';
import { after, before } from 'node:test';
import { pathToFileURL } from 'node:url';

const npm = process.env.GSVX_NPM;

/** Where pictures go that people look at. */
export const pictures = join(process.env.GSVX_ROOT, 'out/web/pictures');
/** What the tests of a file have after `setUp`: a folder, a server of it and of the package, and a browser. */
export let folder;
export let server;
export let browser;

/**
 * Before the tests of a file: `prepare` fills the folder, which is served as `data` and removed at the end, and may
 * return more folders by name; `ready` runs when the browser is there. `skip` is false, or why the tests cannot run.
 */
export function setUp(skip, prepare, ready = () => {}) {
  if (skip) console.error(skip);
  before(async () => {
    if (skip) return;
    mkdirSync(pictures, { recursive: true });
    folder = mkdtempSync(join(tmpdir(), 'gsvx-web-'));
    const more = await prepare();
    server = await serve({
      gsvx: join(import.meta.dirname, '../node_modules/gsvx'),
      engines: join(npm, 'node_modules'),
      pages: join(import.meta.dirname, 'pages'),
      data: folder,
      ...more,
    });
    browser = await launch();
    await ready();
  });
  after(async () => {
    await browser?.close();
    await server?.close();
    if (folder) rmSync(folder, { recursive: true, force: true });
  });
}

/** Closes the pages that a test which failed leaves open. */
export const closePages = () => Promise.all((browser?.contexts() ?? []).flatMap((c) => c.pages()).map((p) => p.close()));

/** Why the tests here cannot run; false if they can. */
export function missing() {
  if (!process.env.CHROMIUM) return 'SKIPPED: CHROMIUM does not name the browser';
  if (!existsSync(join(npm, 'node_modules/playwright-core'))) return 'SKIPPED: npm ci was not run';
  if (!process.env.GSVX_BIN) return 'SKIPPED: GSVX_BIN does not name the gsvx command';
  return false;
}

export async function launch(more = []) {
  const { chromium: engine } = createRequire(join(npm, 'package.json'))('playwright-core');
  return engine.launch({
    executablePath: process.env.CHROMIUM,
    headless: true,
    args: ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update',
      '--disable-sync', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--enable-precise-memory-info', ...more],
  });
}

/** Opens a page that keeps what it writes to the console in `problems`, and what it asks other hosts for in `outside`. */
export async function open(browser, address, options) {
  const page = await browser.newPage(options);
  page.setDefaultTimeout(180000);
  page.problems = [];
  page.outside = [];
  page.on('console', (m) => { if (m.type() === 'error' || m.type() === 'warning') page.problems.push(m.text()); });
  page.on('pageerror', (e) => page.problems.push(e.message));
  page.on('request', (r) => { if (!/^(http:\/\/127\.0\.0\.1|blob:|data:|file:)/.test(r.url())) page.outside.push(r.url()); });
  await page.goto(address);
  return page;
}

/** Problems of a page without what drivers in software warn of. */
export const quiet = (page) => page.problems.filter((p) => !/GPU stall|GL Driver Message|Automatic fallback to software/.test(p));

const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.mjs': 'text/javascript', '.wasm': 'application/wasm', '.png': 'image/png', '.json': 'application/json' };

/**
 * Serves folders by the first part of the path. Query: `ranges=no` answers without ranges, `rate=N` sends N
 * bytes a second, `cut=N` ends the file after N bytes, `flip=N` damages byte N, `hang=N` sends N bytes and
 * then nothing.
 */
export async function serve(folders) {
  const log = [];
  const server = createServer((request, response) => {
    const url = new URL(request.url, 'http://x');
    const [, first, ...rest] = url.pathname.split('/').map(decodeURIComponent);
    const path = folders[first] && normalize(join(folders[first], ...rest));
    if (!path || !path.startsWith(normalize(folders[first])) || !existsSync(path) || !statSync(path).isFile()) {
      response.writeHead(404, { 'Content-Type': 'text/plain' }).end('not here');
      return;
    }
    const query = Object.fromEntries(url.searchParams);
    let all = readFileSync(path);
    if (query.cut) all = all.subarray(0, Number(query.cut));
    if (query.flip) all[Number(query.flip)] ^= 4;
    const headers = { 'Content-Type': TYPES[extname(path)] ?? 'application/octet-stream', 'Cache-Control': 'no-store', 'Cross-Origin-Opener-Policy': 'same-origin', 'Cross-Origin-Embedder-Policy': 'require-corp' };
    const range = query.ranges !== 'no' && /bytes=(\d+)-(\d*)/.exec(request.headers.range ?? '');
    let status = 200;
    if (range) {
      const [start, end] = [Number(range[1]), Math.min(range[2] ? Number(range[2]) + 1 : all.length, all.length)];
      headers['Content-Range'] = `bytes ${start}-${end - 1}/${all.length}`;
      all = all.subarray(start, end);
      status = 206;
    }
    log.push({ path: url.pathname, status, bytes: all.length });
    response.writeHead(status, { ...headers, 'Content-Length': all.length });
    if (query.hang) response.write(all.subarray(0, Number(query.hang)));
    else if (query.rate) slowly(response, all, Number(query.rate));
    else response.end(all);
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  const base = `http://127.0.0.1:${server.address().port}`;
  const close = () => {
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return { base, log, close };
}

/** Sends bytes at a rate, a fiftieth of a second's at a time. */
function slowly(response, bytes, rate) {
  const start = performance.now();
  let sent = 0;
  const timer = setInterval(() => {
    const due = Math.min(bytes.length, Math.floor((rate * (performance.now() - start)) / 1000));
    if (due > sent) response.write(bytes.subarray(sent, due));
    sent = due;
    if (sent === bytes.length || response.destroyed) {
      clearInterval(timer);
      response.end();
    }
  }, 20);
}

/** Runs the gsvx command. */
export function gsvx(...args) {
  const { status, stderr, stdout, error } = spawnSync(process.env.GSVX_BIN, args, { encoding: 'utf8' });
  if (error || status !== 0) throw error ?? new Error(`gsvx ${args.join(' ')}: ${stderr}`);
  return stdout;
}

/** PSNR of two PNGs, by the page's own decoder. The other may be larger by a whole factor: the means of its pixels count. */
export function psnr(page, one, other) {
  return page.evaluate(async ([a, b]) => {
    const pixels = async (base64) => {
      const blob = await (await fetch(`data:image/png;base64,${base64}`)).blob();
      const image = await createImageBitmap(blob, { colorSpaceConversion: 'none' });
      const canvas = new OffscreenCanvas(image.width, image.height).getContext('2d');
      canvas.drawImage(image, 0, 0);
      return canvas.getImageData(0, 0, image.width, image.height);
    };
    const [x, y] = await Promise.all([pixels(a), pixels(b)]);
    const by = y.width / x.width;
    if (by % 1 !== 0 || by * x.height !== y.height) throw new Error(`${x.width}x${x.height}, ${y.width}x${y.height}`);
    const means = new Float32Array(x.data.length);
    for (let i = 0; i < y.data.length; i += 1) {
      const [column, row] = [(i >> 2) % y.width, Math.floor((i >> 2) / y.width)];
      means[4 * (Math.floor(row / by) * x.width + Math.floor(column / by)) + (i & 3)] += y.data[i] / by ** 2;
    }
    let sum = 0;
    for (let i = 0; i < means.length; i += 1) if (i % 4 !== 3) sum += (x.data[i] - means[i]) ** 2;
    return 10 * Math.log10((255 * 255 * 0.75 * means.length) / sum);
  }, [one.toString('base64'), other.toString('base64')]);
}

/**
 * Takes pictures until one is so near to the reference, for half a minute: engines sort and compile beside the
 * frames. Returns the last picture's PSNR.
 */
export async function nearing(page, picture, reference, least) {
  for (let tries = 0; ; tries += 1) {
    const got = await psnr(page, await picture(), reference);
    if (got >= least || tries === 30) return got;
    await page.waitForTimeout(1000);
  }
}

/** Columns of a camera's rotation (right, down, ahead) as rows of its matrix; z is up. */
function turned(yaw, pitch) {
  const ahead = [Math.sin(yaw) * Math.cos(pitch), Math.cos(yaw) * Math.cos(pitch), Math.sin(pitch)];
  const right = [Math.cos(yaw), -Math.sin(yaw), 0];
  const down = [0, 1, 2].map((k) => ahead[(k + 1) % 3] * right[(k + 2) % 3] - ahead[(k + 2) % 3] * right[(k + 1) % 3]);
  return [0, 1, 2].map((k) => [right[k], down[k], ahead[k]]);
}

/**
 * A camera of the fixture room as Inria's cameras.json has it, at the size of the tests' pictures. It looks along
 * no axis: means on a wall in front of it would all have the same depth, and each engine has its own order of
 * Gaussians of one depth. Spark's is the opposite of that of gsvx render, which costs 20 dB.
 */
export const CAMERA = {
  id: 0, img_name: 'camera', width: 480, height: 320, fx: 390, fy: 390,
  position: [0.35, -2.2, 0.8], rotation: turned(-0.2, -0.07),
};

/** Lets the addon GaussianSplat of three.js draw what gsvx render draws: no end at two standard deviations, no dimming. */
export const alike = (page) => page.route('**/objects/GaussianSplat.js', async (route) => {
  const response = await route.fetch();
  let body = await response.text();
  for (const [from, to] of [
    ['r2.greaterThan( 4 )', 'r2.greaterThan( 9 )'], ['color.a.mul( alphaScale )', 'color.a'],
    [/2, (-? ?)2, 0/g, '3, $13, 0'],
  ]) {
    const changed = body.replace(from, to);
    if (changed === body) throw new Error(`the addon has no ${from}`);
    body = changed;
  }
  await route.fulfill({ response, body });
});

/** Writes the stream of a larger model: copies of a PLY along x, each moved by up to half of `jitter`. */
export async function copies(source, file, count, jitter) {
  const { replicate } = await import(pathToFileURL(join(npm, 'bench/model.mjs')));
  const model = `${file}.ply`;
  replicate(source, model, count, jitter);
  gsvx('encode', model, '-o', file, '--web', '--no-estimate');
  rmSync(model);
}

/** Writes the stream of a model that is larger than the first request of a part: copies of the fixture room. */
export const rooms = (file, count = 60_000) => copies(join(process.env.GSVX_ROOT, 'fixtures/room/point_cloud.ply'), file, count);
