// Runs the WebAssembly build and prints the report: node run.mjs gsvx_determinism.wasm
import { readFile } from "node:fs/promises";
const { instance } = await WebAssembly.instantiate(await readFile(process.argv[2]), {});
const { memory, report_start, report_length } = instance.exports;
const start = report_start();
process.stdout.write(Buffer.from(memory.buffer, start, report_length()));
