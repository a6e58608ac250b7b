// The examples of the README's sections, as TypeScript against the package's types.
import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdirSync, symlinkSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { test } from 'node:test';

const npm = process.env.GSVX_NPM;
const tsc = join(npm, 'node_modules/.bin/tsc');
const skip = existsSync(tsc) ? false : 'SKIPPED: npm ci was not run';
if (skip) console.error(skip);

test('the types of the decoder and the PlayCanvas adapter hold', { skip, timeout: 180000 }, () => {
  const folder = join(import.meta.dirname, '../types');
  mkdirSync(folder, { recursive: true });
  if (!existsSync(join(folder, 'node_modules'))) {
    mkdirSync(join(folder, 'node_modules'));
    for (const name of ['playcanvas', '@types', '@webgpu']) symlinkSync(join(npm, 'node_modules', name), join(folder, 'node_modules', name));
    symlinkSync(join(import.meta.dirname, '../node_modules/gsvx'), join(folder, 'node_modules/gsvx'));
  }
  writeFileSync(join(folder, 'use.ts'), `
import { decode, GsvxError, loadSequence, type Frame, type Head, type Packed } from 'gsvx';
import { GSVXParser } from 'gsvx/playcanvas';
import type { AppBase } from 'playcanvas';

const scene = await decode('scene.gsvx');
const means: Float32Array = scene.means;
const packed = await decode(new Blob(), { layout: 'packed', limits: { gaussians: 10 } });
const words: Uint32Array = packed.a;
const result = await decode(fetch('x'), { layout: 'packed', onChunk: ({ data }) => { const d: Packed = data; void d; } });
const head: Head = result.head;
const skipped: string[] = result.skipped;
const clip = await loadSequence('clip.gsvx', { layout: 'packed', workers: 2 });
const frame: Frame<'packed'> = await clip.frame(0);
const reused: Uint32Array = (await clip.frame(clip.groups[0].end - 1, frame)).data.a;
// @ts-expect-error there is no such layout
await decode('x', { layout: 'sideways' });
export const parser = (app: AppBase) => new GSVXParser(app, { maxShDegree: 1 });
export const code = (e: unknown) => e instanceof GsvxError ? e.code : '';
export { means, reused, words, head, skipped };
`);
  const args = ['--noEmit', '--strict', '--skipLibCheck', '--preserveSymlinks', '--module', 'nodenext', '--target', 'es2022', '--lib', 'es2022,dom,esnext.disposable', 'use.ts'];
  const { status, stdout } = spawnSync(tsc, args, { cwd: folder, encoding: 'utf8' });
  assert.equal(status, 0, stdout);
});
