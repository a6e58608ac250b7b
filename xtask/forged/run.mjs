// Runs the WebAssembly build: node run.mjs gsvx_forged.wasm FIRST COUNT. A trap ends its instance, not the run.
import { readFile } from 'node:fs/promises';
const [, , file, first, count] = process.argv;
const module = await WebAssembly.compile(await readFile(file));
const fresh = async () => (await WebAssembly.instantiate(module, {})).exports;
let [exports, digest, accepted, peak] = [await fresh(), 0, 0, 0];
const failed = [];
for (let number = Number(first); number < Number(first) + Number(count); number += 1) {
  try {
    const outcome = exports.outcome_of(number) >>> 0;
    digest = ((digest << 5) | (digest >>> 27)) ^ outcome;
    accepted += outcome & 1;
  } catch (thrown) {
    console.error(`${number}: ${thrown.stack}`);
    failed.push(number);
    exports = await fresh();
  }
  peak = Math.max(peak, exports.memory.buffer.byteLength);
}
console.log(JSON.stringify({ failed, accepted, digest: digest >>> 0, peak }));
