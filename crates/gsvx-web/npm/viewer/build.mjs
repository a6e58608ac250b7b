// Makes the viewer page: one file with the engine, the decoder and their workers in it, for `gsvx view`.
import { build } from 'esbuild';
import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { gzipSync } from 'node:zlib';

const here = import.meta.dirname;
const page = join(here, '../../../gsvx-cli/view/index.html.gz');

// The decoder in core.js is the page's own.
const decoder = {
  name: 'decoder',
  setup({ onResolve }) {
    onResolve({ filter: /\/wasm\/gsvx\.js$/ }, () => ({ path: join(here, 'wasm/gsvx.js') }));
  },
};

async function bundle(entry, define, format) {
  const { outputFiles } = await build({
    entryPoints: [join(here, entry)], bundle: true, minify: true, write: false, format, define,
    target: 'es2022', legalComments: 'none', logLevel: 'warning', plugins: [decoder],
    external: ['node:*'], charset: 'ascii',
  });
  return outputFiles[0].text;
}

const worker = await bundle('worker.js', { 'import.meta.url': '""' }, 'iife');
const wasm = readFileSync(join(here, 'wasm/gsvx_bg.wasm')).toString('base64');
const script = await bundle('main.js', { WORKER: JSON.stringify(worker), WASM: JSON.stringify(wasm) }, 'esm');
const style = readFileSync(join(here, 'style.css'), 'utf8');
const html = readFileSync(join(here, 'index.html'), 'utf8')
  .replace('<link rel="stylesheet" href="style.css">', () => `<style>\n${style}</style>`)
  .replace('<script type="module" src="main.js"></script>',
    () => `<script type="module">${script.replaceAll('</script', '<\\/script')}</script>`);
const packed = gzipSync(html, { level: 9 });
writeFileSync(page, packed);
console.log(`${page}: ${html.length} bytes, ${packed.length} compressed`);
