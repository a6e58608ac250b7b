// What is left in Chromium of decodings that were cancelled or failed: no worker, no memory.
import assert from 'node:assert/strict';
import { cpSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';
import { browser, folder, missing, server, setUp } from './browser.mjs';

const skip = missing();
let page;

setUp(skip, async () => {
  cpSync(join(process.env.GSVX_ROOT, 'fixtures/streams'), folder, { recursive: true });
  writeFileSync(join(folder, 'text.gsvx'), 'this is no stream, but text');
}, async () => {
  page = await browser.newPage();
  await page.goto(`${server.base}/pages/decode.html`);
  await page.waitForFunction(() => window.ready);
});

/** Does something a few times; the growth of memory from after the first. */
async function growth(work) {
  await work();
  const before = await page.evaluate(() => window.memory());
  for (let i = 0; i < 12; i += 1) await work();
  // Chromium tells of the end of a worker a little later.
  for (let i = 0; i < 50 && page.workers().length; i += 1) await page.waitForTimeout(100);
  assert.equal(page.workers().length, 0);
  return (await page.evaluate(() => window.memory())) - before;
}

test('a decoding that is cancelled in the middle', { skip, timeout: 180000 }, async () => {
  const url = `${server.base}/data/lod.gsvx?hang=30000`;
  const grown = await growth(async () => assert.equal(await page.evaluate((u) => window.cancelled(u), url), 'AbortError'));
  console.log(`12 cancelled decodings: memory grew by ${grown} bytes`);
  // One instance of the decoder takes more than this.
  assert.ok(grown < 1_000_000, `${grown}`);
});

test('decodings that fail', { skip, timeout: 180000 }, async () => {
  const cases = [
    ['lod.gsvx?cut=30000', {}, 'truncated'], ['chunks.gsvx?flip=9000', {}, 'damaged'], ['nothing.gsvx', {}, 'http'],
    ['text.gsvx', {}, 'not-gsvx'], ['lod.gsvx', { limits: { gaussians: 10 } }, 'limit'],
  ];
  const grown = await growth(async () => {
    for (const [file, options, code] of cases) {
      const found = await page.evaluate(([u, o]) => window.failing(u, o), [`${server.base}/data/${file}`, options]);
      assert.deepEqual(found, { code, known: true }, file);
    }
  });
  console.log(`${12 * cases.length} failed decodings: memory grew by ${grown} bytes`);
  assert.ok(grown < 1_000_000, `${grown}`);
});
