// Where the bytes of a stream come from: a URL, a Blob, bytes, or a ReadableStream.
import { GsvxError } from './error.js';

/** Bytes of the first request when only a part of a remote stream is wanted. */
const FIRST = 1 << 16;

/**
 * Opens a source. `length` is that of the stream if it is known; `pieces()` gives its bytes in order;
 * `range(start, end)` gives a part, where parts can be had. A source that is open is returned.
 */
export async function open(source, { request, part, signal }) {
  if (source.pieces || source.range) return source;
  if (typeof source === 'string') {
    const local = source.startsWith('file:') && globalThis.process?.versions?.node;
    return local ? blob(await file(source)) : remote(source, { ...request, signal }, part);
  }
  if (source instanceof Blob) return blob(source);
  if (source instanceof ReadableStream) return { pieces: () => chunks(source) };
  const bytes = source instanceof ArrayBuffer ? new Uint8Array(source)
    : new Uint8Array(source.buffer, source.byteOffset, source.byteLength);
  return { length: bytes.length, range: async (start, end) => bytes.subarray(start, end) };
}

function blob(source) {
  const range = async (start, end) => new Uint8Array(await source.slice(start, end).arrayBuffer());
  return { length: source.size, range };
}

/** A file, in Node. */
async function file(url) {
  const { openAsBlob } = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:fs');
  return openAsBlob(new URL(url));
}

async function* chunks(stream) {
  const reader = stream.getReader();
  let ended = false;
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      yield value;
    }
    ended = true;
  } finally {
    // What is not wanted any more need not arrive.
    if (!ended) reader.cancel().catch(() => {});
  }
}

async function get(url, init) {
  let response;
  try {
    response = await fetch(url, init);
  } catch (error) {
    if (init.signal?.aborted) throw error;
    throw new GsvxError(`${url}: ${error.cause?.message ?? error.message}`, { code: 'network' });
  }
  if (!response.ok) {
    const text = `${url}: HTTP ${response.status} ${response.statusText}`.trim();
    throw new GsvxError(text, { code: 'http', status: response.status });
  }
  return response;
}

async function remote(url, init, part) {
  const range = (start, end) => ({ ...init, headers: { ...init.headers, Range: `bytes=${start}-${end - 1}` } });
  const response = await get(url, part ? range(0, FIRST) : init);
  const length = Number(response.headers.get('Content-Length')) || undefined;
  // A server without ranges sends all; with a coding, the length is not that of the stream.
  if (response.status !== 206) {
    const coded = response.headers.get('Content-Encoding');
    return { length: coded ? undefined : length, pieces: () => chunks(response.body) };
  }
  const total = Number(response.headers.get('Content-Range')?.split('/')[1]) || undefined;
  const first = new Uint8Array(await response.arrayBuffer());
  return {
    length: total,
    first,
    async range(start, end) {
      const answer = await get(url, range(start, end));
      const bytes = new Uint8Array(await answer.arrayBuffer());
      return answer.status === 206 ? bytes : bytes.subarray(start, end);
    },
  };
}
