// The packed package in Node: decoding, streaming, cancelling, damage, limits.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { createServer } from 'node:http';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { pathToFileURL } from 'node:url';
import { after, before, test } from 'node:test';
import { decode, GsvxError } from 'gsvx';

const streams = join(process.env.GSVX_ROOT, 'fixtures/streams');
const stream = (name) => readFileSync(join(streams, `${name}.gsvx`));
const golden = readFileSync(join(streams, 'hashes.txt'), 'utf8').split('\n')
  .filter((line) => line && !line.startsWith('#')).map((line) => line.split('  '));

function hash({ means, rotations, logScales, opacityLogits, sh }) {
  const sha = createHash('sha256');
  for (const a of [means, rotations, logScales, opacityLogits, sh]) {
    if (a) sha.update(new Uint8Array(a.buffer, a.byteOffset, a.byteLength));
  }
  return sha.digest('hex');
}

let server;
let requests = [];
let base;
before(async () => {
  server = createServer((request, response) => {
    requests.push(request.headers.range ?? 'all');
    const { pathname, searchParams } = new URL(request.url, 'http://x');
    if (pathname === '/endless') {
      response.writeHead(200);
      response.write(stream('lod').subarray(0, 20000));
      return;
    }
    if (!pathname.endsWith('.gsvx')) {
      response.writeHead(404).end();
      return;
    }
    const bytes = stream(pathname.slice(1, -5));
    const range = /bytes=(\d+)-(\d+)/.exec(request.headers.range ?? '');
    if (range && searchParams.get('ranges') !== 'no') {
      const [start, end] = [Number(range[1]), Math.min(Number(range[2]) + 1, bytes.length)];
      response.writeHead(206, { 'Content-Range': `bytes ${start}-${end - 1}/${bytes.length}`, 'Content-Length': end - start });
      response.end(bytes.subarray(start, end));
    } else {
      response.writeHead(200, { 'Content-Length': bytes.length });
      response.end(bytes);
    }
  });
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  base = `http://127.0.0.1:${server.address().port}`;
});
after(() => {
  server.closeAllConnections();
  server.close();
});

for (const [want, name] of golden) {
  test(`golden ${name} from bytes and over HTTP`, async () => {
    const bytes = readFileSync(join(streams, name));
    assert.equal(hash(await decode(bytes)), want);
    assert.equal(hash(await decode(`${base}/${name}`)), want);
  });
}

test('all kinds of sources, in a worker and without', async () => {
  const bytes = stream('chunks');
  const [want] = golden.find(([, name]) => name === 'chunks.gsvx');
  const pieces = () => new ReadableStream({
    start(controller) {
      for (let at = 0; at < bytes.length; at += 777) controller.enqueue(new Uint8Array(bytes.subarray(at, at + 777)));
      controller.close();
    },
  });
  const sources = [
    () => pathToFileURL(join(streams, 'chunks.gsvx')),
    () => new Blob([bytes]),
    () => new Uint8Array(bytes).buffer,
    () => new DataView(new Uint8Array(bytes).buffer),
    pieces,
    () => fetch(`${base}/chunks.gsvx`),
  ];
  for (const worker of [true, false]) {
    for (const source of sources) assert.equal(hash(await decode(source(), { worker })), want, `${source} ${worker}`);
  }
});

test('chunks of a slow link were put into a scene twice', async () => {
  const bytes = stream('default');
  const slow = new ReadableStream({
    async pull(controller) {
      this.at ??= 0;
      await new Promise((resolve) => setTimeout(resolve, 20));
      controller.enqueue(new Uint8Array(bytes.subarray(this.at, this.at += 1000)));
      if (this.at >= bytes.length) controller.close();
    },
  });
  const [want] = golden.find(([, name]) => name === 'default.gsvx');
  assert.equal(hash(await decode(slow)), want);
});

test('the coarse level comes first, and every piece of it is replaced', async () => {
  const shown = new Map();
  let largest = 0;
  let head;
  let first;
  const result = await decode(stream('lod'), {
    onHead: (h) => { head = h; },
    onChunk(chunk) {
      first ??= chunk;
      for (const id of chunk.replaces) assert.ok(shown.delete(id), id);
      shown.set(chunk.id, chunk);
      largest = Math.max(largest, [...shown.values()].reduce((n, c) => n + c.count, 0));
    },
  });
  assert.ok(head.lods > 1);
  assert.equal(first.lod, head.lods - 1);
  assert.ok([...shown.values()].every((c) => c.lod === 0));
  assert.equal([...shown.values()].reduce((n, c) => n + c.count, 0), head.count);
  // Finer pieces come with those that they replace going away: never much more than the finest level.
  assert.ok(largest <= head.count * 1.05, `${largest} ${head.count}`);
  assert.deepEqual(result.skipped, []);
});

test('several workers hand out what one does', async () => {
  for (const name of ['chunks', 'lod']) {
    const bytes = stream(name);
    const chunks = async (workers) => {
      const found = new Map();
      let heads = 0;
      let progress;
      const result = await decode(bytes, {
        workers, progressive: false,
        onHead() { heads += 1; },
        onProgress(told) { progress = told; },
        onChunk({ id, count, data }) {
          assert.ok(!found.has(id), id);
          found.set(id, `${count} ${hash(data)}`);
        },
      });
      assert.equal(heads, 1);
      assert.equal(progress.gaussians, progress.total);
      assert.deepEqual(result.skipped, []);
      return [...found].sort();
    };
    const one = await chunks(1);
    assert.ok(one.length > 2);
    for (const workers of [2, 3, 20]) assert.deepEqual(await chunks(workers), one, `${name} ${workers}`);
  }
});

test('several workers: damage, cancelling and what they cannot do', async () => {
  const bytes = new Uint8Array(stream('chunks'));
  const onChunk = () => {};
  await assert.rejects(decode(`${base}/chunks.gsvx`, { workers: 2, onChunk }), { code: 'option' });
  await assert.rejects(decode(bytes, { workers: 2 }), { code: 'option' });
  await assert.rejects(decode(bytes, { workers: 0, onChunk }), { code: 'option' });
  const stop = new AbortController();
  const cancelled = decode(bytes, { workers: 2, onChunk: () => stop.abort(new Error('enough')), signal: stop.signal });
  await assert.rejects(cancelled, { message: 'enough' });
  const damaged = bytes.slice();
  damaged[damaged.length - 40] ^= 4;
  await assert.rejects(decode(damaged, { workers: 2, onChunk }), { code: 'damaged' });
  const { skipped } = await decode(damaged, { workers: 2, onChunk, salvage: true });
  assert.equal(skipped.length, 1);
});

test('the parts of a coarse chunk are all of it', async () => {
  let head;
  const counts = {};
  await decode(stream('lod'), {
    onHead: (h) => { head = h; },
    onChunk: ({ chunk, count }) => { counts[chunk] = (counts[chunk] ?? 0) + count; },
  });
  head.chunks.forEach((c, i) => assert.equal(counts[i], c.count, `chunk ${i}`));
});

test('a level of detail, and a lower SH degree, cost fewer bytes', async () => {
  requests = [];
  const result = await decode(`${base}/default.gsvx`, { maxShDegree: 0, onChunk: ({ shDegree }) => assert.equal(shDegree, 0) });
  assert.ok(requests.every((r) => r !== 'all'), requests.join());
  assert.equal(result.head.shDegree, 0);
  for (const ranges of ['yes', 'no']) {
    const coarse = await decode(`${base}/lod.gsvx?ranges=${ranges}`, { lod: 9 });
    const head = (await decode(stream('lod'), { onChunk() {} })).head;
    const expected = head.chunks.filter((c) => c.lod === head.lods - 1).reduce((n, c) => n + c.count, 0);
    assert.equal(coarse.count, expected);
    assert.equal(coarse.shDegree, 0);
  }
});

test('layouts have what they promise', async () => {
  const bytes = stream('default');
  const planar = await decode(bytes);
  const packed = await decode(bytes, { layout: 'packed' });
  const { centers, covariances, colors, sh3 } = await decode(bytes, { layout: 'covariances' });
  assert.deepEqual(centers, planar.means);
  assert.equal(covariances.length, 6 * planar.count);
  assert.equal(colors.length, planar.count);
  assert.equal(sh3.length, 6 * planar.count);
  const floats = new Float32Array(packed.a.buffer);
  for (let i = 0; i < planar.count; i += 1) {
    for (let k = 0; k < 3; k += 1) assert.equal(floats[4 * i + k], planar.means[3 * i + k]);
  }
  assert.equal(packed.sh3b.length, 4 * planar.count);
  const trace = covariances[0] + covariances[3] + covariances[5];
  const want = [0, 1, 2].reduce((s, k) => s + Math.exp(2 * planar.logScales[k]), 0);
  assert.ok(Math.abs(trace / want - 1) < 1e-5);
});

test('a truncated stream fails with its offset, or gives what is there', async () => {
  const bytes = stream('lod').subarray(0, 30000);
  const seen = [];
  await assert.rejects(decode(bytes, { onChunk: (c) => seen.push(c) }), (error) => {
    assert.ok(error instanceof GsvxError);
    assert.equal(error.code, 'truncated');
    assert.equal(error.offset, 30000);
    assert.match(error.message, /chunk \d+/);
    return true;
  });
  assert.ok(seen.length > 0 && seen[0].lod > 0);
  const result = await decode(bytes, { salvage: true, onChunk() {} });
  assert.match(result.skipped[0], /ends at byte 30000/);
  const part = await decode(bytes, { salvage: true });
  assert.equal(part.means.length, 3 * part.count);
});

test('a damaged chunk is named, and costs no other', async () => {
  const bytes = Uint8Array.from(stream('chunks'));
  const { head } = await decode(bytes, { onChunk() {} });
  const [offset, length] = head.chunks[2].layers[0];
  bytes[offset + (length >> 1)] ^= 4;
  await assert.rejects(decode(bytes), { name: 'GsvxError', code: 'damaged', chunk: 2, layer: 0, offset });
  const part = await decode(bytes, { salvage: true });
  assert.equal(part.count, head.count - head.chunks[2].count);
  assert.match(part.skipped[0], /chunk 2, layer 0/);
  // A damaged SH layer leaves the base layer.
  const other = Uint8Array.from(stream('chunks'));
  other[head.chunks[1].layers[1][0] + 3] ^= 1;
  const degrees = {};
  await decode(other, { salvage: true, onChunk: ({ chunk, shDegree }) => { degrees[chunk] = shDegree; } });
  assert.equal(degrees[1], 0);
  assert.equal(degrees[0], 1);
});

test('wrong types and sources are refused', async () => {
  await assert.rejects(decode(new TextEncoder().encode('ply\nformat binary_little_endian 1.0\n')), { code: 'not-gsvx' });
  await assert.rejects(decode(`${base}/nothing.bin`), { code: 'http', status: 404 });
  await assert.rejects(decode('http://127.0.0.1:9/x.gsvx'), { code: 'network' });
  await assert.rejects(decode(42), { code: 'option' });
  await assert.rejects(decode(stream('one'), { layout: 'sideways' }), { code: 'option' });
  await assert.rejects(decode(stream('one'), { maxShDegree: 7 }), { code: 'option' });
  await assert.rejects(decode(new Uint8Array(5)), { code: 'truncated' });
});

test('claims beyond the limits are refused before anything is decoded', async () => {
  const seen = [];
  const options = { onChunk: (c) => seen.push(c) };
  await assert.rejects(decode(stream('lod'), { ...options, limits: { gaussians: 1000 } }), { code: 'limit' });
  await assert.rejects(decode(stream('lod'), { ...options, limits: { bytes: 1000 } }), { code: 'limit' });
  assert.deepEqual(seen, []);
});

test('cancelling ends the worker', async () => {
  const stop = new AbortController();
  let chunks = 0;
  const ports = () => process.getActiveResourcesInfo().filter((r) => r === 'MessagePort').length;
  const settled = () => new Promise((resolve) => setTimeout(resolve, 200));
  await settled();
  const before = ports();
  const work = decode(`${base}/endless`, { signal: stop.signal, onChunk() { if (++chunks === 1) stop.abort(); } });
  await assert.rejects(work, { name: 'AbortError' });
  assert.ok(chunks >= 1);
  await settled();
  assert.equal(ports(), before);
  await assert.rejects(decode(stream('one'), { signal: AbortSignal.abort() }), { name: 'AbortError' });
});

test('many at once', async () => {
  const [want] = golden.find(([, name]) => name === 'default.gsvx');
  const all = await Promise.all(Array.from({ length: 6 }, () => decode(stream('default'))));
  assert.deepEqual(all.map(hash), Array(6).fill(want));
});

test('what a callback throws ends the decoding', async () => {
  await assert.rejects(decode(stream('chunks'), { onChunk() { throw new TypeError('mine'); } }), { name: 'TypeError', message: 'mine' });
});
