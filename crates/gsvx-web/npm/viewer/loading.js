// Loads a scene in a worker of its own. Worker and decoder are in the page: build.mjs puts them there.
import { GsvxError } from '../error.js';
import { loadSequence } from '../sequence.js';

/* global WORKER, PLAYER, WASM */
const bytes = Uint8Array.from(atob(WASM), (c) => c.charCodeAt(0));
const module = WebAssembly.compile(bytes);
const url = (text) => URL.createObjectURL(new Blob([text], { type: 'text/javascript' }));
const [script, player] = [url(WORKER), url(PLAYER)];

/** Opens a sequence, in the layout that the page draws. The next group is decoded while one is played. */
export async function clip(source, signal) {
  return loadSequence(source, { layout: 'packed', signal, workers: 2, worker: () => new Worker(player), wasm: await module });
}

/**
 * Loads `source`, a URL or a file. `handle` gets its messages, and a function that asks for chunks if the scene is larger
 * than the budget; the promise settles at the end.
 */
export function load(source, name, { lod, budget }, handle, signal) {
  const options = { layout: 'packed', maxShDegree: 3, lod, budget, salvage: true, limits: {}, progressive: true };
  const worker = new Worker(script);
  return new Promise((resolve, reject) => {
    signal.addEventListener('abort', () => reject(signal.reason));
    worker.onerror = (event) => reject(new Error(event.message));
    worker.onmessage = ({ data }) => {
      if (data.type === 'done') resolve(data.result);
      else if (data.type === 'error') reject(GsvxError.from(data.error));
      else handle(data, (want, gone) => worker.postMessage({ want, gone }));
    };
    module.then((compiled) => worker.postMessage({ module: compiled, source, name, options }), reject);
  }).finally(() => worker.terminate());
}
