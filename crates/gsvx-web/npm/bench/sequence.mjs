// How fast one worker gives the frames of a sequence, its group decoded once: node bench/sequence.mjs CLIP
import { readFileSync } from 'node:fs';
import { loadSequence } from '../index.js';

const bytes = readFileSync(process.argv[2]);
const passed = async (work) => {
  const start = performance.now();
  await work();
  return (performance.now() - start) / 1000;
};
for (const layout of ['packed', 'covariances', 'planar']) {
  const clip = await loadSequence(bytes, { layout });
  let frame;
  const first = await passed(async () => { frame = await clip.frame(0); });
  const { start, end } = clip.groups[0];
  const rest = await passed(async () => {
    for (let t = start + 1; t < end; t += 1) frame = await clip.frame(t, frame);
  });
  const each = (rest * 1000) / (end - start - 1);
  console.log(`${layout}: ${frame.count} Gaussians; decoding ${first.toFixed(2)} s, then ${each.toFixed(1)} ms per frame; ${((end - start) / (first + rest)).toFixed(0)} frames/s with the decoding`);
  clip.close();
}
