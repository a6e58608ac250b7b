// The WebAssembly module, compiled once for all workers.
let compiled;

async function compile(source) {
  if (source instanceof WebAssembly.Module) return source;
  if (ArrayBuffer.isView(source) || source instanceof ArrayBuffer) return WebAssembly.compile(source);
  const url = source ?? new URL('./wasm/gsvx_bg.wasm', import.meta.url);
  if (String(url).startsWith('file:')) {
    const { readFile } = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:fs/promises');
    return WebAssembly.compile(await readFile(new URL(url)));
  }
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url}: HTTP ${response.status}`);
  // Not by compileStreaming: servers that do not know .wasm send a type that it refuses.
  return WebAssembly.compile(await response.arrayBuffer());
}

/** The compiled decoder, from the package's own file or from `source`: a URL, bytes or a module. */
export function load(source) {
  if (source) return compile(source);
  compiled ??= compile().catch((error) => {
    compiled = undefined;
    throw error;
  });
  return compiled;
}
