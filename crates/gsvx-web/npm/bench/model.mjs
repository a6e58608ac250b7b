// A larger model: copies of one side by side, jittered so that no two are equal.
import { appendFileSync, readFileSync, writeFileSync } from 'node:fs';

/** Writes `count` Gaussians: those of the PLY `from` and copies of them along x, moved by up to half of `jitter`. */
export function replicate(from, to, count, jitter = 0.002) {
  const bytes = readFileSync(from);
  const end = bytes.indexOf('end_header\n') + 'end_header\n'.length;
  const header = bytes.subarray(0, end).toString('latin1');
  const names = [...header.matchAll(/property float (\S+)/g)].map((m) => m[1]);
  const known = Number(/element vertex (\d+)/.exec(header)[1]);
  const width = names.length;
  const rows = new Float32Array(bytes.buffer.slice(bytes.byteOffset + end, bytes.byteOffset + end + 4 * width * known));
  const axes = ['x', 'y', 'z'].map((name) => names.indexOf(name));
  const column = Float32Array.from({ length: known }, (_, i) => rows[i * width + axes[0]]).sort();
  const step = 1.1 * (column[Math.floor(0.98 * known)] - column[Math.floor(0.02 * known)]);
  let state = 1;
  const random = () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32 - 0.5;
  };
  writeFileSync(to, header.replace(/element vertex \d+/, `element vertex ${count}`), 'latin1');
  for (let first = 0; first < count; first += known) {
    const copy = rows.slice(0, Math.min(known, count - first) * width);
    for (let row = 0; first && row < copy.length; row += width) {
      for (const axis of axes) copy[row + axis] += jitter * random();
      copy[row + axes[0]] += (first / known) * step;
    }
    appendFileSync(to, copy);
  }
}
