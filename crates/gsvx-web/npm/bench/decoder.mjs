// One decoder in a process of its own: seconds, those of the processor, and the growth of the process's memory.
import { readFileSync, writeFileSync } from 'node:fs';

const [what, file, more] = process.argv.slice(2);

/** Bytes of memory that the process has had at most. */
const peak = () => 1024 * Number(/VmHWM:\s+(\d+)/.exec(readFileSync('/proc/self/status', 'utf8'))[1]);
/** Starts the count of the greatest use again. */
const forget = () => writeFileSync('/proc/self/clear_refs', '5');
const resident = () => 1024 * Number(/VmRSS:\s+(\d+)/.exec(readFileSync('/proc/self/status', 'utf8'))[1]);

const bytes = new Uint8Array(readFileSync(file));
const floats = (cloud) => ['positions', 'scales', 'rotations', 'alphas', 'colors', 'sh'].map((name) => cloud[name]);

async function measured(decode) {
  global.gc();
  forget();
  const before = resident();
  const used = process.cpuUsage();
  const start = performance.now();
  const { count, arrays, memory } = await decode();
  const seconds = (performance.now() - start) / 1000;
  const { user, system } = process.cpuUsage(used);
  const output = arrays.reduce((n, a) => n + a.byteLength, 0);
  console.log(JSON.stringify({ seconds, cpu: (user + system) / 1e6, count, output, memory, peak: peak() - before }));
}

if (what === 'gsvx') {
  const { decode } = await import('../index.js');
  await measured(async () => {
    const scene = await decode(bytes, { layout: more });
    return { count: scene.count, memory: scene.memory, arrays: Object.values(scene).filter(ArrayBuffer.isView) };
  });
} else {
  const { default: createSpz } = await import('@adobe/spz');
  const spz = await createSpz();
  const to = spz.CoordinateSystem.UNSPECIFIED;
  if (what === 'spz3') {
    const cloud = spz.loadSpzFromBuffer(bytes, { to });
    writeFileSync(more, spz.saveSpzToBuffer(cloud, { version: 3, from: to, sh1Bits: 8, shRestBits: 8 }));
    console.log('{}');
  } else {
    await measured(async () => {
      const cloud = spz.loadSpzFromBuffer(bytes, { to });
      return { count: cloud.numPoints, arrays: floats(cloud) };
    });
  }
}
