// Where the bytes of a stream come from: a URL, a Blob, bytes, or a ReadableStream.
import { GsvxError } from './error.js';

/** Bytes of the first request when only a part of a remote stream is wanted. */
const FIRST = 1 << 16;

/** What gives ranges of a stream as far as it has them. */
export function ranger(input) {
  const length = input.length ?? Infinity;
  return async (start, end) => (start < length ? input.range(start, Math.min(end, length)) : new Uint8Array(0));
}

/** The same for any source; one that comes in order is read whole. */
export async function anyRange(input) {
  if (!input.range) {
    const pieces = [];
    for await (const piece of input.pieces()) pieces.push(piece);
    return anyRange(blob(new Blob(pieces)));
  }
  const [fetched, first = new Uint8Array()] = [ranger(input), input.first];
  return async (start, end) => (end <= first.length ? first.subarray(start, end) : fetched(start, end));
}

/**
 * Opens a source. `length` is that of the stream if it is known; `pieces()` gives its bytes in order;
 * `range(start, end)` gives a part, where parts can be had. A source that is open is returned.
 */
export async function open(source, { request, part, signal }) {
  if (source.pieces || source.range) return source;
  if (typeof source === 'string') {
    const local = source.startsWith('file:') && globalThis.process?.versions?.node;
    return local ? blob(await file(source), source) : remote(source, { ...request, signal }, part);
  }
  if (source instanceof Blob) return blob(source);
  if (source instanceof ReadableStream) return { pieces: () => chunks('the stream', source, signal) };
  const bytes = bytesOf('the source', source);
  return { length: bytes.length, range: async (start, end) => bytes.subarray(start, end) };
}

function bytesOf(name, value) {
  if (ArrayBuffer.isView(value)) return new Uint8Array(value.buffer, value.byteOffset, value.byteLength);
  if (value instanceof ArrayBuffer) return new Uint8Array(value);
  throw new GsvxError(`${name}: gives something else than bytes`, { code: 'option' });
}

function blob(source, name = 'the file') {
  const range = (start, end) => whole(name, source.slice(start, end));
  return { length: source.size, range };
}

/** A file, in Node. */
async function file(url) {
  const { openAsBlob } = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:fs');
  try {
    return await openAsBlob(new URL(url));
  } catch (thrown) {
    throw GsvxError.reading(url, thrown);
  }
}

/** The bytes of a stream; those of a response without a body are none. */
async function* chunks(name, stream, signal) {
  if (!stream) return;
  const reader = stream.getReader();
  let ended = false;
  try {
    for (;;) {
      const { done, value } = await reader.read().catch((thrown) => {
        throw signal?.aborted ? thrown : GsvxError.reading(name, thrown);
      });
      if (done) break;
      yield bytesOf(name, value);
    }
    ended = true;
  } finally {
    // The rest of the response is not needed.
    if (!ended) reader.cancel().catch(() => {});
  }
}

/** All bytes of a response or a Blob. */
async function whole(name, body, signal) {
  try {
    return new Uint8Array(await body.arrayBuffer());
  } catch (thrown) {
    throw signal?.aborted ? thrown : GsvxError.reading(name, thrown);
  }
}

async function get(url, init) {
  let response;
  try {
    response = await fetch(url, init);
  } catch (thrown) {
    throw init.signal?.aborted ? thrown : GsvxError.reading(url, thrown);
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
    return { length: coded ? undefined : length, pieces: () => chunks(url, response.body, init.signal) };
  }
  const total = Number(response.headers.get('Content-Range')?.split('/')[1]) || undefined;
  const first = await whole(url, response, init.signal);
  return {
    length: total,
    first,
    async range(start, end) {
      const answer = await get(url, range(start, end));
      const bytes = await whole(url, answer, init.signal);
      return answer.status === 206 ? bytes : bytes.subarray(start, end);
    },
  };
}
