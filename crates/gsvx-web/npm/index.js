// Decodes gsvx streams: https://github.com/gsvx/gsvx
import { GsvxError } from './error.js';
import { load } from './load.js';

export { GsvxError };

const LAYOUTS = ['planar', 'packed', 'covariances'];

function number(name, value, least, most) {
  if (!(Number.isInteger(value) && value >= least && value <= most)) {
    throw new GsvxError(`${name} is ${value}, must be a whole number from ${least} to ${most}`, { code: 'option' });
  }
  return value;
}

function limit(name, value) {
  if (value !== undefined && !(typeof value === 'number' && value >= 0)) {
    throw new GsvxError(`${name} is ${value}, must be a number that is not negative`, { code: 'option' });
  }
}

/** What a worker needs of the options, checked. */
function checked({ layout = 'planar', maxShDegree = 3, lod = 0, salvage = false, limits = {}, request, onChunk, progressive = Boolean(onChunk), worker = true, workers = 1 }) {
  if (!LAYOUTS.includes(layout)) {
    throw new GsvxError(`layout is ${layout}, must be ${LAYOUTS.join(', ')}`, { code: 'option' });
  }
  number('maxShDegree', maxShDegree, 0, 3);
  number('lod', lod, 0, 255);
  number('workers', workers, 1, 64);
  if (workers > 1 && !(onChunk && worker)) {
    throw new GsvxError('workers hand out chunks: give onChunk, and leave worker as it is', { code: 'option' });
  }
  if (limits === null || typeof limits !== 'object') {
    throw new GsvxError(`limits is ${limits}, must be an object with gaussians and bytes`, { code: 'option' });
  }
  const { gaussians, bytes } = limits;
  limit('limits.gaussians', gaussians);
  limit('limits.bytes', bytes);
  const whole = !onChunk;
  return { layout, maxShDegree, lod, salvage: Boolean(salvage), limits: { gaussians, bytes }, request, whole, progressive: progressive && !whole };
}

/** A source that can go to a worker. */
function sendable(source) {
  if (typeof source === 'string' || source instanceof URL) {
    try {
      return new URL(source, globalThis.location?.href).href;
    } catch {
      throw new GsvxError(`${source} is not a URL`, { code: 'option' });
    }
  }
  if (typeof Response !== 'undefined' && source instanceof Response) {
    if (!source.ok) throw new GsvxError(`${source.url}: HTTP ${source.status}`, { code: 'http', status: source.status });
    if (source.bodyUsed) throw new GsvxError(`${source.url}: the response has been read already`, { code: 'option' });
    // An answer without a body is an empty stream.
    return source.body ?? new Uint8Array();
  }
  if (source instanceof ReadableStream && source.locked) {
    throw new GsvxError('the stream is being read already', { code: 'option' });
  }
  const known = source instanceof Blob || source instanceof ReadableStream || source instanceof ArrayBuffer ||
    ArrayBuffer.isView(source);
  if (!known) {
    throw new GsvxError('a source is a URL, a Response, a Blob, a ReadableStream or bytes', { code: 'option' });
  }
  return source;
}

/** Whether each worker can read its own parts of a source. */
const atHand = (source) => source instanceof Blob || source instanceof ArrayBuffer || ArrayBuffer.isView(source);

/** Starts a worker; returns how to send to it, hear from it and end it. */
async function spawn(make) {
  if (typeof make === 'function' || typeof Worker !== 'undefined') {
    const worker = typeof make === 'function' ? make()
      : new Worker(new URL('./worker.js', import.meta.url), { type: 'module' });
    return {
      send: (message, transfer) => worker.postMessage(message, transfer),
      hear(onMessage, onError) {
        worker.onmessage = ({ data }) => onMessage(data);
        worker.onerror = (event) => onError(new Error(event.message ?? 'the worker cannot be started'));
      },
      end: () => worker.terminate(),
    };
  }
  const threads = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:worker_threads');
  const worker = new threads.Worker(new URL('./worker.js', import.meta.url));
  return {
    send: (message, transfer) => worker.postMessage(message, transfer),
    hear(onMessage, onError) {
      worker.on('message', onMessage);
      worker.on('error', onError);
    },
    end: () => worker.terminate(),
  };
}

async function inWorker(make, message, transfer, handle, signal) {
  const worker = await spawn(make);
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
  const module = await load(wasm);
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
