// Tests the packed package, installed into an empty folder: node test/run.mjs TARBALL
import { spawnSync } from 'node:child_process';
import { cpSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';

const npm = resolve(import.meta.dirname, '..');
const tarball = resolve(process.argv[2]);
const folder = mkdtempSync(join(tmpdir(), 'gsvx-package-'));
const env = { ...process.env, GSVX_ROOT: resolve(npm, '../../..'), GSVX_NPM: npm };

function run(command, args, cwd) {
  const { status, error } = spawnSync(command, args, { cwd, env, stdio: 'inherit' });
  if (error) throw error;
  if (status !== 0) throw new Error(`${command} ${args.join(' ')}: ended with ${status}`);
}

try {
  writeFileSync(join(folder, 'package.json'), '{"private":true,"type":"module"}');
  run('npm', ['install', '--offline', '--no-audit', '--no-fund', '--silent', tarball], folder);
  cpSync(join(npm, 'test'), join(folder, 'test'), { recursive: true });
  const only = process.argv.slice(3);
  const all = readdirSync(join(folder, 'test')).filter((name) => name.endsWith('.test.mjs'));
  // Two files at a time: the tests of leaks mostly wait for the engine's garbage collection.
  run('node', ['--test', '--test-concurrency=2', ...(only.length ? only : all).map((name) => `test/${name}`)], folder);
} catch (error) {
  console.error(`error: ${error.message}`);
  process.exitCode = 1;
} finally {
  rmSync(folder, { recursive: true, force: true });
}
