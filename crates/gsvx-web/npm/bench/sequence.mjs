// How fast one worker gives the frames of a sequence: node bench/sequence.mjs CLIP
// Times are the processor's, of all threads.
import { readFileSync } from 'node:fs';
import { loadSequence } from '../index.js';

/** Times that the first group is played. */
const ROUNDS = 5;
const bytes = readFileSync(process.argv[2]);

async function used(work) {
  const before = process.cpuUsage();
  await work();
  const { user, system } = process.cpuUsage(before);
  return (user + system) / 1e6;
}

for (const layout of ['packed', 'covariances', 'planar']) {
  const clip = await loadSequence(bytes, { layout });
  let frame;
  const first = await used(async () => { frame = await clip.frame(0); });
  const { end } = clip.groups[0];
  const rest = await used(async () => {
    for (let t = 0; t < ROUNDS * end; t += 1) frame = await clip.frame(t % end, frame);
  });
  const each = rest / ROUNDS / end;
  console.log(`${layout}: ${frame.count} Gaussians; the group ${first.toFixed(2)} s, a frame ${(1000 * each).toFixed(1)} ms: ${(1 / each).toFixed(0)} frames/s`);
  clip.close();
}
