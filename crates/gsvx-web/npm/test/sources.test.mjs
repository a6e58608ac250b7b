// Sources that fail in Node, in a worker and in the calling thread: each failure is one rejection with a code.
import assert from 'node:assert/strict';
import { createServer } from 'node:http';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { decode } from 'gsvx';

const bytes = readFileSync(join(process.env.GSVX_ROOT, 'fixtures/streams/lod.gsvx'));
const page = '<!doctype html><title>Not found</title><p>There is nothing here, says a server that answers 200.</p>';
const workers = [true, false];

let server;
let base;
before(async () => {
  const send = (response, status, body, type = 'application/octet-stream') => {
    response.writeHead(status, { 'Content-Type': type });
    response.end(body);
  };
  const answers = {
    '/dropped': (response) => {
      response.writeHead(200, { 'Content-Length': bytes.length });
      response.write(bytes.subarray(0, 30000), () => setTimeout(() => response.destroy(), 50));
    },
    '/empty': (response) => send(response, 200, ''),
    '/none': (response) => response.writeHead(204).end(),
    '/page': (response) => send(response, 200, page, 'text/html'),
  };
  server = createServer((request, response) => answers[request.url](response));
  await new Promise((resolve) => server.listen(0, '127.0.0.1', resolve));
  base = `http://127.0.0.1:${server.address().port}`;
});
after(() => {
  server.closeAllConnections();
  server.close();
});

test('a connection that drops is one rejection', async () => {
  for (const worker of workers) {
    for (const more of [{}, { onChunk() {} }, { maxShDegree: 0, onChunk() {} }]) {
      await assert.rejects(decode(`${base}/dropped`, { worker, ...more }), { name: 'GsvxError', code: 'network' });
      await assert.rejects(decode(fetch(`${base}/dropped`), { worker, ...more }), { name: 'GsvxError', code: 'network' });
    }
  }
});

test('a stream that fails at any time is one rejection', async () => {
  for (const worker of workers) {
    for (const end of [0, 5, 5000, 30000, bytes.length - 1]) {
      const failing = new ReadableStream({
        start(controller) {
          if (end) controller.enqueue(new Uint8Array(bytes.subarray(0, end)));
        },
        async pull(controller) {
          await new Promise((resolve) => setTimeout(resolve, end % 7));
          controller.error(new Error('unplugged'));
        },
      });
      await assert.rejects(decode(failing, { worker, onChunk() {} }), { code: 'network', message: /unplugged/ });
    }
    const words = new ReadableStream({ start: (controller) => controller.enqueue('words') });
    await assert.rejects(decode(words, { worker }), { code: 'option' });
  }
});

test('answers without a stream have the code of what they are', async () => {
  for (const worker of workers) {
    for (const path of ['/empty', '/none']) {
      await assert.rejects(decode(`${base}${path}`, { worker }), { code: 'truncated' }, path);
      await assert.rejects(decode(fetch(`${base}${path}`), { worker }), { code: 'truncated' }, path);
      await assert.rejects(decode(`${base}${path}`, { worker, lod: 1 }), { code: 'truncated' }, path);
    }
    await assert.rejects(decode(`${base}/page`, { worker }), { code: 'not-gsvx' });
    await assert.rejects(decode(new Uint8Array(0), { worker }), { code: 'truncated' });
    await assert.rejects(decode(new Blob([]), { worker }), { code: 'truncated' });
    await assert.rejects(decode('http://127.0.0.1:9/x.gsvx', { worker }), { code: 'network' });
    await assert.rejects(decode('file:///no/such/folder/x.gsvx', { worker }), { code: 'network', message: /x\.gsvx/ });
  }
  const read = await fetch(`${base}/page`);
  await read.text();
  await assert.rejects(decode(read), { code: 'option' });
});

test('limits that are no numbers are refused', async () => {
  for (const limits of [{ gaussians: NaN }, { bytes: NaN }, { gaussians: '5000' }, { bytes: -1 }, { bytes: null }, null, 7]) {
    await assert.rejects(decode(bytes, { limits }), { code: 'option' }, JSON.stringify(limits));
  }
  assert.ok((await decode(bytes, { limits: { gaussians: Infinity, bytes: 1e9 } })).count > 0);
});

test('what is left of a stream without a whole chunk is an empty scene', async () => {
  const { head } = await decode(bytes, { onChunk() {} });
  for (const worker of workers) {
    for (const layout of ['planar', 'packed', 'covariances']) {
      const { count, shDegree, antialiased, skipped, memory, ...arrays } = await decode(bytes.subarray(0, head.headLength), { worker, layout, salvage: true });
      assert.equal(count, 0);
      assert.equal(antialiased, head.antialiased);
      assert.ok(skipped.length > 0 && memory > 0 && shDegree >= 0);
      assert.ok(Object.keys(arrays).length >= 2, layout);
      for (const [name, array] of Object.entries(arrays)) assert.equal(array.length, 0, `${layout} ${name}`);
    }
  }
});

test('what a callback throws comes back as it is', async () => {
  const mine = new RangeError('mine');
  await assert.rejects(decode(bytes, { worker: false, onChunk() { throw mine; } }), (error) => error === mine);
});
