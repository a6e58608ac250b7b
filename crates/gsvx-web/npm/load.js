// WebAssembly modules, each compiled once for all workers.
const compiled = new Map();

async function compile(source) {
  if (source instanceof WebAssembly.Module) return source;
  if (ArrayBuffer.isView(source) || source instanceof ArrayBuffer) return WebAssembly.compile(source);
  if (String(source).startsWith('file:')) {
    const { readFile } = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:fs/promises');
    return WebAssembly.compile(await readFile(new URL(source)));
  }
  const response = await fetch(source);
  if (!response.ok) throw new Error(`${source}: HTTP ${response.status}`);
  // Not by compileStreaming: servers that do not know .wasm send a type that it refuses.
  return WebAssembly.compile(await response.arrayBuffer());
}

/** A compiled decoder, from the package's `own` file or from `source`: a URL, bytes or a module. */
export function load(source, own) {
  if (source) return compile(source);
  const { href } = own();
  if (!compiled.has(href)) {
    compiled.set(href, compile(href).catch((error) => {
      compiled.delete(href);
      throw error;
    }));
  }
  return compiled.get(href);
}
