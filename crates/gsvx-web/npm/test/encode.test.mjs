// The page of `gsvx view --encode` in Chromium.
import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { cpSync, readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { afterEach, test } from 'node:test';
import { browser, closePages, folder, gsvx, missing, open, pictures, quiet, setUp } from './browser.mjs';

const skip = missing();
const room = join(process.env.GSVX_ROOT, 'fixtures/room');
const PHONE = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 1, colorScheme: 'light' };
const DESK = { viewport: { width: 1440, height: 900 }, colorScheme: 'dark' };

setUp(skip, () => cpSync(room, join(folder, 'room'), { recursive: true }));
afterEach(closePages);

const text = (page, id) => page.locator(`#${id}`).innerText();
const judged = (page) => page.waitForFunction(() => /^estimated loss/.test(document.querySelector('#loss:not(.old)')?.textContent), null, { timeout: 120000 });
const shot = async (page, name) => writeFileSync(join(pictures, `encode-${name}.png`), await page.screenshot());
const place = (page) => page.evaluate(() => window.gsvx.camera.camera.position.toArray());

/** Lets the slider go at a quality. */
async function letGo(page, quality) {
  await page.locator('#quality').fill(`${quality}`);
  await page.waitForFunction((q) => window.gsvx.slots[1]?.name === `quality ${q}` && window.gsvx.slots[1].complete, quality);
  await judged(page);
}

test('a quality is chosen by eye and saved', { skip, timeout: 400000 }, async () => {
  const model = join(folder, 'room/point_cloud.ply');
  const child = spawn(process.env.GSVX_BIN, ['view', '--no-open', '--encode', model, '--cameras', join(folder, 'room')], { stdio: ['ignore', 'pipe', 'inherit'] });
  let said = '';
  try {
    await new Promise((resolve) => child.stdout.on('data', (d) => resolve((said += d))));
    const [line] = said.split('\n');
    const viewer = await open(browser, line, DESK);
    await judged(viewer);
    assert.match(await text(viewer, 'made'), /^\d+(\.\d)? kB, \d+\.\d times smaller$/);
    await letGo(viewer, 30);
    const [small, home] = [await text(viewer, 'made'), await place(viewer)];
    await viewer.waitForTimeout(2000);
    await shot(viewer, 'desk');
    await viewer.locator('#worst').click();
    assert.notDeepEqual(await place(viewer), home);
    await viewer.waitForTimeout(2000);
    await shot(viewer, 'desk-worst');
    await viewer.locator('#cameras').uncheck();
    await judged(viewer);
    assert.notEqual(await text(viewer, 'made'), small);
    await viewer.locator('#save').click();
    await viewer.locator('#command').waitFor();
    const command = await text(viewer, 'command');
    const saved = join(folder, 'room/point_cloud-q30.gsvx');
    assert.equal(command, `gsvx encode ${model} -o ${saved} -q 30`);
    assert.ok(said.includes(command), said);
    gsvx('encode', model, '-o', join(folder, 'again.gsvx'), '-q', '30', '--no-estimate');
    assert.deepEqual(readFileSync(saved), readFileSync(join(folder, 'again.gsvx')));
    await shot(viewer, 'desk-saved');
    await viewer.locator('#save').click();
    await viewer.locator('#message').waitFor();
    assert.match(await text(viewer, 'message'), /already exists; pass --force/);
    assert.deepEqual(quiet(viewer).filter((p) => !/409/.test(p)), []);
    await viewer.close();
    const phone = await open(browser, line, PHONE);
    await judged(phone);
    await letGo(phone, 45);
    await phone.waitForTimeout(3000);
    await shot(phone, 'phone');
    assert.ok(await phone.locator('#save').isVisible());
    assert.deepEqual(quiet(phone), []);
    assert.deepEqual(phone.outside, []);
    child.kill('SIGINT');
    await new Promise((resolve) => child.on('exit', resolve));
    await phone.locator('#quality').fill('50');
    await phone.waitForFunction(() => /has ended/.test(document.getElementById('message').textContent));
  } finally {
    child.kill('SIGINT');
  }
});
