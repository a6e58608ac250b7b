// Reads a stream and decodes its chunks as they become whole: coarse level first. Runs in a worker, or
// where it is called.
import { GsvxError, hasTrapped } from './error.js';
import { open, ranger } from './source.js';
import init, { __wbg_reset_state as renew, Stream } from './wasm/gsvx.js';

/** Ranges closer than this are one request, up to a size. */
const GAP = 1 << 13;
const REQUEST = 1 << 20;
/** Requests that are under way at once. */
const AHEAD = 4;
/** Bytes that the decoder is given at a time: what it holds of the stream besides the chunk it decodes. */
const PIECE = 1 << 16;
/** Milliseconds between reports of progress. */
const OFTEN = 50;
/** As in the decoder of whole streams: bytes of decoded Gaussians per byte of a stream, and in any stream. */
const GROWTH = 1024;
const ALWAYS_ACCEPTED = 64 << 20;
/** Bytes of decoder memory for each Gaussian of a chunk, rounded up from what is measured. */
const WORKING = 1200;

/** Bytes for each Gaussian of a layout at an SH degree. */
const SIZES = {
  planar: (d) => 4 * (11 + 3 * (d + 1) ** 2),
  packed: (d) => 32 + [0, 16, 32, 64][d],
  covariances: (d) => 40 + [0, 12, 28, 52][d],
};

/** Rows of this many Gaussians, as textures have them. */
const ROW = { packed: 2048 };

/** Makes the decoder ready, once; returns what it exports. */
export const ready = (module) => init({ module_or_path: module });

/**
 * Gives back what a stream holds. After a trap, or where the stream is not to be had, nothing in the decoder's memory can
 * be trusted: this thread gets a new decoder, and other streams of the old one fail.
 */
function end(stream, thrown) {
  try {
    if (!hasTrapped(thrown)) return stream.free();
  } catch {
    // The first error is the one to report.
  }
  try {
    renew();
  } catch {
    // There is no memory for another decoder; decodings in this thread go on failing.
  }
}

export class Decoding {
  constructor(options, emit) {
    this.options = options;
    this.emit = emit;
    this.stream = new Stream();
    this.received = 0;
    this.gaussians = 0;
    this.skipped = [];
    this.reported = 0;
    /** The arrays of the whole scene, and how many Gaussians are in them. */
    this.scene = {};
    this.count = 0;
    /** For each chunk of the level below: the piece that stands for it. */
    this.standIns = new Map();
  }

  /** What the head says, once it is there; works out what is wanted. */
  plan(length) {
    this.head = this.stream.head();
    const { maxShDegree, progressive, limits } = this.options;
    const { shDegree, lods, chunks } = this.head;
    this.lod = Math.min(this.options.lod, lods - 1);
    this.shDegree = Math.min(shDegree, maxShDegree);
    const wanted = (c) => c.exact || (progressive ? c.lod >= this.lod : c.lod === this.lod);
    this.pending = chunks.map((c, chunk) => ({ chunk, shown: 0, layers: Math.min(c.layers.length, 1 + this.shDegree) }))
      .filter(({ chunk }) => wanted(chunks[chunk]));
    const all = this.pending.reduce((sum, { chunk }) => sum + chunks[chunk].count, 0);
    const accepted = GROWTH * Math.min(length ?? Infinity, this.head.length) + ALWAYS_ACCEPTED;
    const most = limits.gaussians ?? Math.floor(accepted / SIZES.planar(this.shDegree));
    if (all > most) {
      const text = `the stream claims ${all} Gaussians, more than the limit of ${most}; raise limits.gaussians if you trust it`;
      throw new GsvxError(text, { code: 'limit', offset: 0 });
    }
    const largest = this.pending.reduce((m, { chunk }) => Math.max(m, chunks[chunk].count), 0);
    const bytes = all * SIZES[this.options.layout](this.shDegree) + largest * WORKING;
    if (bytes > (limits.bytes ?? Infinity)) {
      const text = `the stream needs about ${bytes} bytes of memory, more than the limit of ${limits.bytes}`;
      throw new GsvxError(text, { code: 'limit', offset: 0 });
    }
    const { share } = this.options;
    if (share) this.pending = this.pending.filter((_, i) => i % share.of === share.part);
    this.total = chunks.filter((c) => (this.lod ? c.exact || c.lod === this.lod : c.lod === 0))
      .reduce((sum, c) => sum + c.count, 0);
    this.told = { ...this.head, lod: this.lod, shDegree: this.shDegree, total: this.total };
    this.emit({ type: 'head', head: this.told });
  }

  give(offset, bytes, length) {
    this.stream.give(offset, bytes);
    this.received += bytes.length;
    if (!this.head && this.stream.head()) this.plan(length);
    const now = Date.now();
    if (this.head && now - this.reported >= OFTEN) {
      this.reported = now;
      this.progress();
    }
  }

  progress() {
    this.emit({ type: 'progress', received: this.received, length: this.head.length, gaussians: this.gaussians, total: this.total });
  }

  /** Decodes the layers of a chunk from those shown on. Returns how many are good. */
  decode(entry, layers) {
    for (let good = entry.shown; good < layers; good += 1) {
      try {
        this.stream.hold(entry.chunk, good + 1);
      } catch (thrown) {
        if (!this.options.salvage || thrown.code === undefined) throw thrown;
        this.skipped.push(`${good ? `SH degree ${good} and above of ` : ''}${thrown.message}`);
        entry.layers = good;
        return good;
      }
    }
    return layers;
  }

  /** Decodes and hands out a chunk at so many layers. */
  show(entry, layers) {
    const good = this.decode(entry, layers);
    if (good > entry.shown) {
      if (entry.shown === 0 && this.isFinest(entry.chunk)) this.gaussians += this.head.chunks[entry.chunk].count;
      entry.shown = good;
      this.hand(entry.chunk, good);
    }
    if (entry.shown >= entry.layers) this.stream.forget(entry.chunk);
  }

  isFinest(chunk) {
    return this.head.chunks[chunk].exact || this.head.chunks[chunk].lod === this.lod;
  }

  /** Hands out the chunk that is held: whole, or in the parts that finer chunks replace. */
  hand(chunk, layers) {
    const { count, exact, finer } = this.head.chunks[chunk];
    const replaces = this.standIns.has(chunk) ? [this.standIns.get(chunk)] : [];
    this.standIns.delete(chunk);
    if (this.isFinest(chunk)) {
      this.piece(chunk, `${chunk}`, 0, count, exact ? this.shDegree : layers - 1, replaces);
      return;
    }
    const starts = this.stream.parts(chunk);
    finer.forEach((behind, i) => {
      // What lies before the first cell of the first finer chunk is part of it.
      const first = i === 0 ? 0 : starts[i];
      const size = (i + 1 < finer.length ? starts[i + 1] : count) - first;
      if (size === 0) return;
      const id = `${chunk}/${behind}`;
      this.standIns.set(behind, id);
      this.piece(chunk, id, first, size, layers - 1, replaces.splice(0));
    });
  }

  piece(chunk, id, first, count, shDegree, replaces) {
    const { layout } = this.options;
    if (this.options.whole) {
      this.stream.take(first, count, this.scene, this.count, this.total, layout, this.shDegree);
      this.count += count;
      return;
    }
    const row = ROW[layout] ?? 1;
    const capacity = Math.ceil(count / row) * row;
    const data = {};
    this.stream.take(first, count, data, 0, capacity, layout, shDegree);
    const { lod, bounds } = this.head.chunks[chunk];
    this.emit({ type: 'chunk', id, chunk, lod, shDegree, count, bounds, replaces, data },
      Object.values(data).map((array) => array.buffer));
  }

  /** Shows all chunks that are whole. */
  async advance() {
    if (!this.head) return;
    while (this.pending.length) {
      const entry = this.pending[0];
      if (this.stream.wholeLayers(entry.chunk) < entry.layers) break;
      this.show(entry, entry.layers);
      this.pending.shift();
      if (this.options.yields) await new Promise((resolve) => setTimeout(resolve));
    }
  }

  /** Shows what there is of the next chunk. */
  partly() {
    const entry = this.head && this.pending[0];
    const whole = entry ? Math.min(this.stream.wholeLayers(entry.chunk), entry.layers) : 0;
    if (whole > (entry?.shown ?? 0)) this.show(entry, whole);
  }

  /** Hands out the whole scene, without the room for chunks that were left out. */
  whole() {
    // Without a chunk the arrays are not there yet.
    if (this.count === 0) this.stream.take(0, 0, this.scene, 0, 0, this.options.layout, this.shDegree);
    const { scene, count, total, shDegree } = this;
    for (const [name, array] of Object.entries(scene)) {
      if (count < total) scene[name] = array.slice(0, (array.length / total) * count);
    }
    const { antialiased } = this.head;
    this.emit({ type: 'scene', scene: { ...scene, count, shDegree, antialiased } }, Object.values(scene).map((array) => array.buffer));
  }

  /** All bytes that there are have arrived. */
  finish(length) {
    if (!this.head) {
      throw new GsvxError(`the stream ends in its head, after ${length} bytes`, { code: 'truncated', offset: length });
    }
    for (const entry of this.pending) {
      const whole = Math.min(this.stream.wholeLayers(entry.chunk), entry.layers);
      if (whole > entry.shown) this.show(entry, whole);
      if (entry.shown >= entry.layers) continue;
      const text = `the stream ends at byte ${length} of ${this.head.length}: chunk ${entry.chunk} ` +
        (entry.shown ? `has ${entry.shown} of ${entry.layers} layers` : 'is missing');
      if (!this.options.salvage) throw new GsvxError(text, { code: 'truncated', offset: length, chunk: entry.chunk });
      this.skipped.push(text);
    }
    this.progress();
  }
}

/** Whether something happens soon. */
async function soon(promise) {
  const idle = Symbol('idle');
  return (await Promise.race([promise, new Promise((resolve) => setTimeout(resolve, 4, idle))])) !== idle;
}

/** Bytes in the order in which they come. */
async function inOrder(decoding, input) {
  const pieces = input.pieces();
  const ask = () => {
    const piece = pieces.next();
    // The code that awaits the promise handles its failure.
    piece.catch(() => {});
    return piece;
  };
  let offset = 0;
  try {
    for (let next = ask(); ;) {
      if (decoding.options.progressive && !(await soon(next))) decoding.partly();
      const { done, value } = await next;
      if (done) break;
      next = ask();
      decoding.give(offset, value, input.length);
      offset += value.length;
      await decoding.advance();
      if (decoding.head && !decoding.pending.length) break;
    }
  } finally {
    await pieces.return();
  }
  decoding.finish(offset);
}

/** The ranges of what is wanted, those side by side as one. */
function ranges(decoding) {
  const list = [];
  for (const { chunk, layers } of decoding.pending) {
    const wanted = decoding.head.chunks[chunk].layers.slice(0, layers);
    const [start, end] = [wanted[0][0], wanted.at(-1)[0] + wanted.at(-1)[1]];
    const last = list.at(-1);
    if (last && start - last[1] < GAP && end - last[0] < REQUEST) last[1] = end;
    else list.push([start, end]);
  }
  return list;
}

/** Reads the head; returns how many bytes of the stream have been given for it. */
export async function readHead(decoding, input) {
  const fetched = ranger(input);
  let reached = 0;
  if (input.first) {
    decoding.give(0, input.first, input.length);
    reached = input.first.length;
  }
  for (let needs = decoding.stream.headNeeds(); needs; needs = decoding.stream.headNeeds()) {
    const bytes = await fetched(...needs);
    decoding.give(needs[0], bytes, input.length);
    reached = needs[0] + bytes.length;
    if (bytes.length === 0) decoding.finish(reached);
  }
  return reached;
}

/** Only the bytes that are wanted. */
async function byRanges(decoding, input) {
  const length = input.length ?? Infinity;
  const fetched = ranger(input);
  const reached = await readHead(decoding, input);
  const wanted = ranges(decoding).filter(([, end]) => end > reached).map(([start, end]) => [Math.max(start, reached), end]);
  const requests = [];
  const ask = (i) => {
    if (i >= wanted.length) return;
    requests[i] = fetched(...wanted[i]);
    // The code that awaits the promise handles its failure.
    requests[i].catch(() => {});
  };
  for (let i = 0; i < AHEAD; i += 1) ask(i);
  await decoding.advance();
  for (let i = 0; i < wanted.length; i += 1) {
    const bytes = await requests[i];
    requests[i] = undefined;
    ask(i + AHEAD);
    const [start] = wanted[i];
    for (let at = 0; at < bytes.length; at += PIECE) {
      decoding.give(start + at, bytes.subarray(at, at + PIECE), input.length);
      await decoding.advance();
    }
  }
  decoding.finish(Math.min(length, decoding.head.length));
}

/** Decodes `source` and hands out messages: head, chunks, progress. */
export async function run(source, options, emit, signal) {
  const { memory } = await ready();
  const decoding = new Decoding(options, emit);
  let failure;
  try {
    const part = options.lod > 0 || options.maxShDegree < 3;
    const input = await open(source, { request: options.request, part, signal });
    await (input.range ? byRanges(decoding, input) : inOrder(decoding, input));
    if (options.whole) decoding.whole();
    return { head: decoding.told, skipped: decoding.skipped, received: decoding.received, memory: memory.buffer.byteLength };
  } catch (thrown) {
    failure = thrown;
    if (signal?.aborted) throw signal.reason;
    throw GsvxError.from(thrown);
  } finally {
    end(decoding.stream, failure);
  }
}
