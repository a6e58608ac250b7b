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
    if (code === undefined || typeof code === 'number') {
      // WebAssembly that runs out of memory traps.
      const trapped = typeof WebAssembly !== 'undefined' && thrown instanceof WebAssembly.RuntimeError;
      return new GsvxError(message, { code: trapped ? 'memory' : 'failed' });
    }
    const fields = { code, offset, chunk, layer, status };
    for (const name of Object.keys(fields)) if (fields[name] === undefined) delete fields[name];
    return new GsvxError(message, fields);
  }

  /** As a plain object, which can go to another thread. */
  plain() {
    const { message, code, offset, chunk, layer, status } = this;
    return { message, code, offset, chunk, layer, status };
  }
}
