// A decoder in the calling thread that runs out of memory: the next decoding has another.
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { test } from 'node:test';
import { decode } from 'gsvx';

const stream = (name) => readFileSync(join(process.env.GSVX_ROOT, `fixtures/streams/${name}.gsvx`));
const PAGE = 1 << 16;

/** Reads an unsigned LEB128 number; returns it and the place behind it. */
function number(bytes, at) {
  let value = 0;
  for (let shift = 0; ; shift += 7) {
    const byte = bytes[at++];
    value += (byte & 127) * 2 ** shift;
    if (byte < 128) return [value, at];
  }
}

const encoded = (value) => (value < 128 ? [value] : [(value & 127) | 128, ...encoded(value >> 7)]);

/** The decoder with room for so many pages more than it begins with. */
function limited(module, more) {
  for (let at = 8; at < module.length;) {
    const [size, start] = number(module, at + 1);
    if (module[at] === 5) {
      const [least] = number(module, start + 2);
      const section = [1, 1, ...encoded(least), ...encoded(least + more)];
      return Buffer.concat([module.subarray(0, at), Buffer.from([5, section.length, ...section]), module.subarray(start + size)]);
    }
    at = start + size;
  }
  throw new Error('no memory in the module');
}

const wasm = limited(readFileSync(fileURLToPath(import.meta.resolve('gsvx').replace(/[^/]*$/, 'wasm/gsvx_bg.wasm'))), 3);

test('a decoder that runs out of memory is replaced', async () => {
  const [small, large] = [stream('one'), stream('lossless')];
  const good = () => decode(small, { worker: false, wasm });
  const { memory } = await good();
  for (let i = 0; i < 30; i += 1) {
    await assert.rejects(decode(large, { worker: false, wasm }), { name: 'GsvxError', code: 'memory' });
    assert.equal((await good()).memory, memory);
  }
});

test('decodings leave nothing behind', async () => {
  const damaged = Uint8Array.from(stream('one'));
  damaged[damaged.length - 9] ^= 4;
  const { memory } = await decode(stream('one'), { worker: false, wasm });
  for (let i = 0; i < 1000; i += 1) {
    assert.equal((await decode(stream('one'), { worker: false, wasm })).memory, memory);
    await assert.rejects(decode(damaged, { worker: false, wasm }), { code: 'damaged' });
  }
  assert.ok(memory < 64 * PAGE, `${memory}`);
});
