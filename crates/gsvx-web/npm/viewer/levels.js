// In the worker: a stream of which the page asks for some chunks, as its camera moves.
import { Decoding, readHead } from '../core.js';
import { open, ranger } from '../source.js';
import { Stream } from '../wasm/gsvx.js';

/** Requests that are under way at once. */
const AHEAD = 4;

/** The head of a source, and the source with all of its bytes still to come; `part` if not all are wanted. `stop()` lets go of it. */
export async function peek(source, part) {
  const input = await open(source, { part });
  const stream = new Stream();
  try {
    if (input.range) {
      const fetched = ranger(input);
      if (input.first) stream.give(0, input.first);
      for (let needs = stream.headNeeds(); needs; needs = stream.headNeeds()) {
        const bytes = await fetched(...needs);
        if (!bytes.length) break;
        stream.give(needs[0], bytes);
      }
      return { head: stream.head(), input, stop() {} };
    }
    const [rest, read] = [input.pieces(), []];
    for (let at = 0; !stream.head();) {
      const { done, value } = await rest.next();
      if (done) break;
      read.push(value);
      stream.give(at, value);
      at += value.length;
    }
    async function* pieces() {
      try {
        yield* read;
        yield* rest;
      } finally {
        await rest.return();
      }
    }
    return { head: stream.head(), input: { ...input, pieces }, stop: () => rest.return() };
  } finally {
    stream.free();
  }
}

/** Gaussians of a level. */
export const gaussians = (head, lod) => head.chunks.filter((c) => c.exact || c.lod === lod).reduce((sum, c) => sum + c.count, 0);

export class Levels {
  /** `input` gives ranges; `emit` gets messages. */
  constructor(input, options, emit) {
    this.emit = emit;
    this.input = input;
    this.decoding = new Decoding(options, (message, transfer) => emit(message.type === 'head' ? { ...message, detail: true } : message, transfer));
    this.fetched = ranger(input);
    this.queue = [];
    this.requests = new Map();
    /** What the page has, or will have when it reads its messages. */
    this.there = new Set();
  }

  /** Chunks that the page is to have from now on, the first ones first; those `gone` it has no more. */
  want(chunks, gone) {
    gone.forEach((chunk) => this.there.delete(chunk));
    this.queue = chunks.filter((chunk) => !this.there.has(chunk));
    for (const chunk of [...this.requests.keys()]) if (!this.queue.includes(chunk)) this.requests.delete(chunk);
    this.wake?.();
  }

  request(chunk) {
    const { layers } = this.decoding.head.chunks[chunk];
    const wanted = layers.slice(0, 1 + this.decoding.shDegree);
    const [start, end] = [wanted[0][0], wanted.at(-1)[0] + wanted.at(-1)[1]];
    const bytes = this.fetched(start, end).then((data) => ({ start, data, layers: wanted.length }));
    // The code that awaits the promise handles its failure.
    bytes.catch(() => {});
    return bytes;
  }

  /** Loads the coarsest level and says so; then what is wanted, without end. */
  async run(hasBegun) {
    await readHead(this.decoding, this.input);
    const { chunks, lods } = this.decoding.head;
    this.want(chunks.flatMap((c, i) => (c.exact || c.lod === lods - 1 ? [i] : [])), []);
    while (this.queue.length) await this.next();
    hasBegun();
    for (;;) {
      if (this.queue.length) await this.next();
      else await new Promise((resolve) => (this.wake = resolve));
    }
  }

  async next() {
    const ahead = this.queue.slice(0, AHEAD);
    ahead.forEach((chunk) => this.requests.has(chunk) || this.requests.set(chunk, this.request(chunk)));
    const [chunk] = ahead;
    const { start, data, layers } = await this.requests.get(chunk);
    this.requests.delete(chunk);
    if (!this.queue.includes(chunk)) return;
    this.queue = this.queue.filter((other) => other !== chunk);
    this.there.add(chunk);
    this.decoding.give(start, data, this.input.length);
    const entry = { chunk, shown: 0, layers };
    this.decoding.show(entry, layers);
    this.decoding.stream.forget(chunk);
    this.emit({ type: 'loaded', chunk, isGood: entry.shown > 0, skipped: this.decoding.skipped.splice(0) });
    this.decoding.progress();
    // Messages of the page are handled before the next chunk.
    await new Promise((resolve) => setTimeout(resolve));
  }
}
