/** See index.d.ts. */
const CODES = ['not-gsvx', 'version', 'truncated', 'damaged', 'limit', 'http', 'network', 'memory', 'option', 'failed'];

/** What went wrong, and where: `code`, `offset` in the stream, and `chunk` and `layer` where they are known. */
export class GsvxError extends Error {
  constructor(message, fields = {}) {
    super(message);
    this.name = 'GsvxError';
    Object.assign(this, fields);
  }

  /** From what another thread or WebAssembly threw. */
  static from(thrown) {
    if (thrown instanceof GsvxError) return thrown;
    const { message = String(thrown), code, offset, chunk, layer, status } = thrown ?? {};
    if (!CODES.includes(code)) {
      // WebAssembly that runs out of memory traps; an array that is too large is a RangeError.
      if (hasTrapped(thrown)) return new GsvxError(`the decoder ran out of memory: ${message}`, { code: 'memory' });
      return new GsvxError(message, { code: thrown instanceof RangeError ? 'memory' : 'failed' });
    }
    const fields = { code, offset, chunk, layer, status };
    for (const name of Object.keys(fields)) if (fields[name] === undefined) delete fields[name];
    return new GsvxError(message, fields);
  }

  /** From the failure of what bytes come from: a network, a file, a stream. */
  static reading(name, thrown) {
    if (thrown instanceof GsvxError) return thrown;
    const why = thrown?.cause?.message || thrown?.message || String(thrown);
    return new GsvxError(`${name}: ${why}`, { code: 'network' });
  }

  /** As a plain object, which can go to another thread. */
  plain() {
    const { message, code, offset, chunk, layer, status } = this;
    return { message, code, offset, chunk, layer, status };
  }
}

/** Whether WebAssembly has ended for good. */
export function hasTrapped(thrown) {
  return typeof WebAssembly !== 'undefined' && thrown instanceof WebAssembly.RuntimeError;
}
