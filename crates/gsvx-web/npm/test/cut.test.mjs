// Which chunks the viewer page draws within its budget, and what it lets go of: without a browser.
import assert from 'node:assert/strict';
import { join } from 'node:path';
import { test } from 'node:test';
import { pathToFileURL } from 'node:url';

const { Tree } = await import(pathToFileURL(join(process.env.GSVX_NPM, 'viewer/cut.js')));

/** A row of `width` finest chunks of 900 Gaussians, each chunk one long; three levels, three chunks under each coarser one. */
function row(width) {
  const chunks = [];
  const starts = [2, 1, 0].map((lod) => {
    const start = chunks.length;
    const long = 3 ** lod;
    for (let i = 0; i < width / long; i += 1) chunks.push({ exact: false, lod, count: 900, bounds: [i * long, 0, 0, (i + 1) * long, 1, 1], finer: [] });
    return start;
  });
  chunks.forEach((chunk, i) => {
    if (chunk.lod === 0) return;
    const [from, below] = [2 - chunk.lod, 3 - chunk.lod].map((level) => starts[level]);
    chunk.finer = [0, 1, 2].map((k) => below + 3 * (i - from) + k);
  });
  chunks.push({ exact: true, lod: 0, count: 5, bounds: [0, 0, 0, 1, 1, 1], finer: [] });
  return { chunks, lods: 3, lod: 0 };
}

/** A camera on the row, so wide that all is seen. */
const at = (eye, scale = 1e4) => ([x, , , end, height]) => ({ length: (scale * Math.max(end - x, height)) / Math.max(x - eye, eye - end, 0.1), seen: true });
const drawn = (tree, chosen) => chosen.reduce((sum, c) => sum + tree.extra(c), 0);

test('the budget holds wherever the camera is, and parents come before what they stand for', () => {
  const head = row(81);
  const tree = new Tree(head);
  assert.equal(tree.roots.length, 10);
  for (const budget of [9005, 12000, 20000, 40000, 80000]) {
    for (const eye of [-50, 0, 3.5, 40, 80]) {
      const chosen = tree.choose(at(eye), budget);
      assert.ok(drawn(tree, chosen) <= Math.max(budget, 8105), `${drawn(tree, chosen)} of ${budget}`);
      chosen.forEach((c, i) => assert.ok(!tree.parents.has(c) || chosen.indexOf(tree.parents.get(c)) < i));
      assert.equal(new Set(chosen).size, chosen.length);
    }
  }
  assert.deepEqual(tree.choose(at(0), 10), tree.roots);
  assert.equal(tree.choose(at(40, 1e9), Infinity).length, head.chunks.length);
});

test('what is near is fine, what is far or behind is coarse', () => {
  const head = row(81);
  const tree = new Tree(head);
  const fine = (pixels, budget) => tree.choose(pixels, budget).filter((c) => head.chunks[c].lod === 0 && !head.chunks[c].exact)
    .map((c) => head.chunks[c].bounds[0]);
  const near = fine(at(40.5), 15000);
  assert.ok(near.length > 3 && near.every((x) => Math.abs(x - 40) < 12), near.join());
  // Gaussians that are less than a pixel apart need no finer ones, whatever the budget is.
  assert.deepEqual(fine(at(-5000, 1e4), Infinity), []);
  const ahead = (bounds) => ({ ...at(40.5)(bounds), seen: bounds[3] > 40 });
  const seen = fine(ahead, 15000);
  assert.ok(seen.filter((x) => x >= 40).length > seen.filter((x) => x < 40).length, seen.join());
});

test('a level that is asked for is the finest', () => {
  const tree = new Tree({ ...row(27), lod: 1 });
  const all = tree.choose(at(3, 1e9), Infinity);
  assert.equal(all.length, 3 + 9 + 1);
});
