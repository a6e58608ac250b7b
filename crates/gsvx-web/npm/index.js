// Decodes gsvx streams: https://github.com/gsvx/gsvx
import { GsvxError } from './error.js';
import { load } from './load.js';
import { bounds, known, number, sendable } from './options.js';
import { loadSequence } from './sequence.js';
import { spawn } from './thread.js';

export { GsvxError, loadSequence };

const own = {
  make: () => new Worker(new URL('./worker.js', import.meta.url), { type: 'module' }),
  url: () => new URL('./worker.js', import.meta.url),
};

/** What a worker needs of the options, checked. */
function checked({ layout = 'planar', maxShDegree = 3, lod = 0, salvage = false, limits = {}, request, onChunk, progressive = Boolean(onChunk), worker = true, workers = 1 }) {
  known(layout);
  number('maxShDegree', maxShDegree, 0, 3);
  number('lod', lod, 0, 255);
  number('workers', workers, 1, 64);
  if (workers > 1 && !(onChunk && worker)) {
    throw new GsvxError('workers hand out chunks: give onChunk, and leave worker as it is', { code: 'option' });
  }
  const whole = !onChunk;
  return { layout, maxShDegree, lod, salvage: Boolean(salvage), limits: bounds(limits), request, whole, progressive: progressive && !whole };
}

/** Whether each worker can read its own parts of a source. */
const atHand = (source) => source instanceof Blob || source instanceof ArrayBuffer || ArrayBuffer.isView(source);

async function inWorker(make, message, transfer, handle, signal) {
  const worker = await spawn(make, own);
  let abort;
  try {
    return await new Promise((resolve, reject) => {
      abort = () => reject(signal.reason);
      signal?.throwIfAborted();
      signal?.addEventListener('abort', abort);
      worker.hear((received) => {
        if (received.type === 'done') resolve(received.result);
        else if (received.type === 'error') reject(GsvxError.from(received.error));
        else {
          try {
            handle(received);
          } catch (thrown) {
            reject(thrown);
          }
        }
      }, (error) => reject(GsvxError.from(error)));
      worker.send(message, transfer);
    });
  } finally {
    signal?.removeEventListener('abort', abort);
    worker.end();
  }
}

/** Each of some workers decodes a share of the chunks. The first failure ends all. */
async function shared(count, make, { options, ...message }, handle, signal) {
  const stop = new AbortController();
  const abort = () => stop.abort(signal.reason);
  signal?.addEventListener('abort', abort);
  const latest = [];
  let headTold = false;
  const worker = (part) => {
    const one = { ...message, options: { ...options, progressive: false, share: { part, of: count } } };
    return inWorker(make, one, [], (received) => {
      if (received.type === 'head') {
        if (headTold) return;
        headTold = true;
      }
      if (received.type !== 'progress') return handle(received);
      latest[part] = received;
      const sum = (name) => latest.reduce((n, progress) => n + progress[name], 0);
      handle({ ...received, received: sum('received'), gaussians: sum('gaussians') });
    }, stop.signal);
  };
  try {
    const results = await Promise.all(Array.from({ length: count }, (_, part) => worker(part)));
    const sum = (name) => results.reduce((n, result) => n + result[name], 0);
    return { ...results[0], skipped: results.flatMap((r) => r.skipped), received: sum('received'), memory: sum('memory') };
  } finally {
    stop.abort();
    signal?.removeEventListener('abort', abort);
  }
}

/**
 * Decodes a stream. With `onChunk`, chunks are handed out as they become whole, the coarse level first;
 * without, the scene is returned when it is whole. See index.d.ts.
 */
export async function decode(source, options = {}) {
  const { onHead, onChunk, onProgress, signal, worker = true, workers = 1, wasm } = options;
  const settings = checked(options);
  signal?.throwIfAborted();
  const input = sendable(await source);
  if (workers > 1 && !atHand(input)) {
    throw new GsvxError('several workers need bytes or a Blob: what arrives is decoded by one', { code: 'option' });
  }
  const module = await load(wasm, () => new URL('./wasm/gsvx_bg.wasm', import.meta.url));
  signal?.throwIfAborted();
  let scene;
  const handle = ({ type, ...message }) => {
    if (type === 'head') onHead?.(message.head);
    else if (type === 'chunk') onChunk(message);
    else if (type === 'scene') ({ scene } = message);
    else onProgress?.(message);
  };
  let result;
  if (workers > 1) {
    result = await shared(workers, worker, { module, source: input, options: settings }, handle, signal);
  } else if (worker) {
    const transfer = input instanceof ReadableStream ? [input] : [];
    result = await inWorker(worker, { module, source: input, options: settings }, transfer, handle, signal);
  } else {
    const { ready, run } = await import('./core.js');
    await ready(module);
    let own;
    const checkedHandle = (message) => {
      signal?.throwIfAborted();
      try {
        handle(message);
      } catch (thrown) {
        own = { thrown };
        throw thrown;
      }
    };
    result = await run(input, { ...settings, yields: true }, checkedHandle, signal).catch((error) => {
      throw own ? own.thrown : error;
    });
  }
  return scene ? { ...scene, skipped: result.skipped, memory: result.memory } : result;
}
