// Runs the WebAssembly build: node run.mjs gsvx_forged.wasm FIRST COUNT. A trap ends its instance, not the run. The golden
// streams follow.
import { readFile } from 'node:fs/promises';
const [, , file, first, count] = process.argv;
const module = await WebAssembly.compile(await readFile(file));
const fresh = async () => (await WebAssembly.instantiate(module, {})).exports;
let [exports, digest, accepted, peak] = [await fresh(), 0, 0, 0];
const failed = [];
const golden = exports.first_golden() >>> 0;
const numbers = (from, to) => Array.from({ length: to - from }, (_, i) => from + i);
for (const number of [...numbers(Number(first), Number(first) + Number(count)), ...numbers(golden, 2 ** 32)]) {
  try {
    const outcome = exports.outcome_of(number) >>> 0;
    digest = ((digest << 5) | (digest >>> 27)) ^ outcome;
    accepted += number < golden ? outcome & 1 : 0;
  } catch (thrown) {
    console.error(`${number}: ${thrown.stack}`);
    failed.push(number);
    exports = await fresh();
  }
  peak = Math.max(peak, exports.memory.buffer.byteLength);
}
console.log(JSON.stringify({ failed, accepted, digest: digest >>> 0, peak }));
