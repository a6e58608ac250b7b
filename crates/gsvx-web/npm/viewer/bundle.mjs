// Makes one file of a page here, with the engine, the decoder and their workers in it.
import { build } from 'esbuild';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';

const here = import.meta.dirname;

// The decoders in core.js and player.js are the page's own.
const decoder = {
  name: 'decoder',
  setup({ onResolve }) {
    onResolve({ filter: /\/wasm\/(gsvx|sequence)\.js$/ }, () => ({ path: join(here, 'wasm/gsvx.js') }));
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

/** The text of a page. `define` gives its script constants, as JSON. */
export async function page(name, define = {}) {
  const [worker, player] = await Promise.all(['worker.js', '../sequence-worker.js'].map((entry) => bundle(entry, { 'import.meta.url': '""' }, 'iife')));
  const wasm = readFileSync(join(here, 'wasm/gsvx_bg.wasm')).toString('base64');
  const html = readFileSync(join(here, name), 'utf8');
  const [tag, main] = /<script type="module" src="(.*)"><\/script>/.exec(html);
  const script = await bundle(main, { WORKER: JSON.stringify(worker), PLAYER: JSON.stringify(player), WASM: JSON.stringify(wasm), ...define }, 'esm');
  return html
    .replace(/<link rel="stylesheet" href="(.*)">/g, (_, style) => `<style>\n${readFileSync(join(here, style), 'utf8')}</style>`)
    .replace(tag, () => `<script type="module">${script.replaceAll('</script', '<\\/script')}</script>`);
}
