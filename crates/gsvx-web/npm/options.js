// Checks what callers give.
import { GsvxError } from './error.js';

const LAYOUTS = ['planar', 'packed', 'covariances'];

/** One of the layouts. */
export function known(layout) {
  if (!LAYOUTS.includes(layout)) {
    throw new GsvxError(`layout is ${layout}, must be ${LAYOUTS.join(', ')}`, { code: 'option' });
  }
  return layout;
}

export function number(name, value, least, most) {
  if (!(Number.isInteger(value) && value >= least && value <= most)) {
    throw new GsvxError(`${name} is ${value}, must be a whole number from ${least} to ${most}`, { code: 'option' });
  }
  return value;
}

/** Limits, of which there may be none. */
export function bounds(limits) {
  if (limits === null || typeof limits !== 'object') {
    throw new GsvxError(`limits is ${limits}, must be an object with gaussians and bytes`, { code: 'option' });
  }
  const { gaussians, bytes } = limits;
  limit('limits.gaussians', gaussians);
  limit('limits.bytes', bytes);
  return { gaussians, bytes };
}

function limit(name, value) {
  if (value !== undefined && !(typeof value === 'number' && value >= 0)) {
    throw new GsvxError(`${name} is ${value}, must be a number that is not negative`, { code: 'option' });
  }
}

/** A source that can go to a worker. */
export function sendable(source) {
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
