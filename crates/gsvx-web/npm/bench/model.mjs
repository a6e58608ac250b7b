// A larger model: copies of one side by side, jittered so that no two are equal.
import { readFileSync, writeFileSync } from 'node:fs';

export function replicate(from, to, count) {
  const bytes = readFileSync(from);
  const end = bytes.indexOf('end_header\n') + 'end_header\n'.length;
  const header = bytes.subarray(0, end).toString('latin1');
  const names = [...header.matchAll(/property float (\S+)/g)].map((m) => m[1]);
  const known = Number(/element vertex (\d+)/.exec(header)[1]);
  const width = names.length;
  const rows = new Float32Array(bytes.buffer.slice(bytes.byteOffset + end, bytes.byteOffset + end + 4 * width * known));
  const out = new Float32Array(width * count);
  const axes = ['x', 'y', 'z'].map((name) => names.indexOf(name));
  const column = Float32Array.from({ length: known }, (_, i) => rows[i * width + axes[0]]).sort();
  const step = 1.1 * (column[Math.floor(0.98 * known)] - column[Math.floor(0.02 * known)]);
  let state = 1;
  const random = () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32 - 0.5;
  };
  for (let i = 0; i < count; i += 1) {
    const copy = Math.floor(i / known);
    out.set(rows.subarray((i % known) * width, (i % known + 1) * width), i * width);
    for (const axis of axes) out[i * width + axis] += copy ? 0.002 * random() : 0;
    out[i * width + axes[0]] += copy * step;
  }
  const named = header.replace(/element vertex \d+/, `element vertex ${count}`);
  writeFileSync(to, Buffer.concat([Buffer.from(named, 'latin1'), Buffer.from(out.buffer)]));
}
