// Sequences in the packed package, in Node: every frame in every layout, reuse, seeks, damage.
import assert from 'node:assert/strict';
import { createHash } from 'node:crypto';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { GsvxError, loadSequence } from 'gsvx';

const folder = join(process.env.GSVX_ROOT, 'fixtures/sequences');
const clip = (name) => readFileSync(join(folder, `${name}.gsvx`));
const golden = readFileSync(join(folder, 'hashes.txt'), 'utf8').split('\n')
  .filter((line) => line && !line.startsWith('#')).map((line) => line.split('  '));
const NAMES = ['means', 'rotations', 'logScales', 'opacityLogits', 'sh'];
const same = (a, b) => {
  assert.deepEqual(Object.keys(a), Object.keys(b));
  for (const name of Object.keys(a)) assert.deepEqual(Buffer.from(a[name].buffer), Buffer.from(b[name].buffer), name);
};

/** Opens a clip, and closes it when the work is done. */
async function using(source, options, work) {
  const sequence = await loadSequence(source, options);
  try {
    return await work(sequence);
  } finally {
    sequence.close();
  }
}

for (const [want, name] of golden) {
  test(`golden ${name}, its arrays reused`, async () => {
    const values = await using(readFileSync(join(folder, name)), {}, async (sequence) => {
      const all = Object.fromEntries(NAMES.map((n) => [n, []]));
      let frame;
      for (let t = 0; t < sequence.frames; t += 1) {
        frame = await sequence.frame(t, frame);
        const { count, capacity, data } = frame;
        const there = Array.from({ length: count }, (_, i) => i).filter((i) => data.opacityLogits[i] !== -Infinity);
        for (const n of NAMES) {
          const width = data[n].length / capacity;
          for (const i of there) all[n].push(data[n].slice(i * width, (i + 1) * width));
        }
      }
      return all;
    });
    const sha = createHash('sha256');
    for (const n of NAMES) for (const row of values[n]) sha.update(new Uint8Array(row.buffer));
    assert.equal(sha.digest('hex'), want);
  });
}

test('in each layout, arrays that were reused in any order are those of a frame alone', async () => {
  for (const name of ['tracked', 'births']) {
    for (const layout of ['planar', 'packed', 'covariances']) {
      for (const options of [{ layout }, { layout, worker: false, maxShDegree: 0 }, { layout, workers: 2 }]) {
        const alone = (t) => using(clip(name), options, (sequence) => sequence.frame(t));
        await using(clip(name), options, async (sequence) => {
          let [shown, spare] = [];
          for (const t of [0, 1, 7, 2, 9, 8, 0, 5, 9]) {
            [shown, spare] = [await sequence.frame(t, spare), shown];
            const { data, ...facts } = await alone(t);
            const { data: found, ...told } = shown;
            assert.deepEqual(told, facts);
            same(found, data);
          }
        });
      }
    }
  }
});

test('frames of the sequence are told, and frames that do not exist are refused', async () => {
  await using(new Blob([clip('tracked')]), {}, async (sequence) => {
    const { fps, frames, length, groups } = sequence;
    assert.deepEqual({ fps, frames, length, groups },
      { fps: 30, frames: 12, length: clip('tracked').length, groups: [{ start: 0, end: 8 }, { start: 8, end: 12 }] });
    for (const t of [-1, 12, 0.5, '1']) await assert.rejects(sequence.frame(t), { code: 'option' });
    const frame = await sequence.frame(3);
    await sequence.frame(4, frame);
    await assert.rejects(sequence.frame(5, frame), { code: 'option' });
    await assert.rejects(sequence.frame(5, { ...frame }), { code: 'option' });
    sequence.close();
    await assert.rejects(sequence.frame(5), GsvxError);
  });
  await assert.rejects(loadSequence(clip('tracked'), { layout: 'sideways' }), { code: 'option' });
  await assert.rejects(loadSequence(readFileSync(join(folder, '../streams/lod.gsvx'))), { code: 'damaged' });
  await assert.rejects(using(clip('tracked'), { limits: { gaussians: 10 } }, (s) => s.frame(0)), { code: 'limit' });
  const stop = new AbortController();
  const sequence = await loadSequence(clip('tracked'), { signal: stop.signal });
  stop.abort();
  await assert.rejects(sequence.frame(0), { name: 'AbortError' });
});

test('from all kinds of sources; a stream in order is read whole', async () => {
  const bytes = clip('births');
  const pieces = () => new ReadableStream({
    start(controller) {
      for (let at = 0; at < bytes.length; at += 777) controller.enqueue(new Uint8Array(bytes.subarray(at, at + 777)));
      controller.close();
    },
  });
  for (const source of [pieces(), new Response(pieces()), new URL(`file://${join(folder, 'births.gsvx')}`), new Blob([bytes])]) {
    const frame = await using(source, {}, (sequence) => sequence.frame(4));
    same(frame.data, (await using(bytes, {}, (sequence) => sequence.frame(4))).data);
  }
});

test('a damaged group is an error, and the others are whole', async () => {
  for (const options of [{}, { worker: false }, { workers: 2 }]) {
    const bytes = clip('tracked');
    bytes[bytes.length - 9] ^= 1;
    await using(bytes, options, async (sequence) => {
      await assert.rejects(sequence.frame(9), { code: 'damaged', message: /group 1 of the sequence/ });
      assert.equal((await sequence.frame(7)).number, 7);
      await assert.rejects(sequence.frame(8), { code: 'damaged' });
    });
    await using(clip('tracked').subarray(0, -1), options, async (sequence) => {
      assert.equal((await sequence.frame(0)).number, 0);
      await assert.rejects(sequence.frame(11), { code: 'truncated', offset: bytes.length - 1 });
    });
  }
  for (let end = 0; end < 40; end += 1) {
    await assert.rejects(loadSequence(clip('tracked').subarray(0, end), { worker: false }), GsvxError);
  }
});
