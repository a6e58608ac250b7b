// Gives the frames of a sequence: decodes one group, and writes what moves into arrays that are reused. Runs in a worker, or
// where it is called.
import { GsvxError, hasTrapped } from './error.js';
import { anyRange, open } from './source.js';
import init, { __wbg_reset_state as renew, Clip } from './wasm/sequence.js';

/** Bytes that hold the head of most sequences. */
const FIRST = 1 << 16;
/** Arrays have room for a multiple of this many Gaussians, as textures have rows. */
const ROW = 2048;

/** Copies rows, `width` words long, to where they belong in an array whose rows are `stride` words long. */
function scatter(from, width, rows, to, stride) {
  for (let i = 0, at = 0; i < rows.length; i += 1) {
    const first = rows[i] * stride;
    for (let k = 0; k < width; k += 1, at += 1) to[first + k] = from[at];
  }
}

const words = (array) => new Uint32Array(array.buffer, array.byteOffset, array.length);

class Player {
  constructor(range, first, options) {
    Object.assign(this, { range, first, options, last: Promise.resolve() });
    this.clip = new Clip(first);
    this.head = this.clip.head();
  }

  /** A frame, in the arrays of one that was given before, or in new ones. */
  frame(number, before = {}) {
    return this.next(async () => {
      const group = this.head.groups.findIndex(({ end }) => number < end);
      await this.decode(group);
      return this.call(() => this.write(number, group, before));
    });
  }

  /** Decodes a group whose frames will be asked for. */
  prepare(group) {
    return this.next(() => this.decode(group));
  }

  /** One thing after another. */
  next(work) {
    const result = this.last.then(work);
    this.last = result.catch(() => {});
    return result;
  }

  /** Calls the decoder. If it traps, nothing in its memory can be trusted: there is a new one then. */
  call(work) {
    try {
      return work();
    } catch (thrown) {
      if (hasTrapped(thrown)) {
        this.group = undefined;
        renew();
        this.clip = new Clip(this.first);
      }
      throw GsvxError.from(thrown);
    }
  }

  async decode(group) {
    if (this.group === group) return;
    const { offset, length } = this.head.groups[group];
    const bytes = await this.range(offset, offset + length);
    const end = offset + bytes.length;
    if (bytes.length < length) {
      throw new GsvxError(`the stream ends at byte ${end} of ${this.head.length}: group ${group} is not whole`, { code: 'truncated', offset: end });
    }
    this.group = undefined;
    try {
      this.held = this.call(() => this.clip.decode(group, bytes, this.options.limits.gaussians));
    } catch (thrown) {
      if (thrown.offset !== undefined) thrown.offset += offset;
      throw thrown;
    }
    this.group = group;
    this.moved = {};
  }

  write(number, group, before) {
    const { layout, maxShDegree } = this.options;
    const { count, antialiased, moving } = this.held;
    const shDegree = Math.min(maxShDegree, this.held.shDegree);
    let { data, capacity } = before;
    if (before.group !== group) {
      if (!(capacity >= count && before.shDegree === shDegree)) [data, capacity] = [{}, Math.ceil(count / ROW) * ROW];
      this.clip.still(data, capacity, layout, shDegree);
    }
    if (moving.length) {
      this.clip.moved(number - this.head.groups[group].start, this.moved, layout, shDegree);
      for (const [name, from] of Object.entries(this.moved)) {
        scatter(words(from), from.length / moving.length, moving, words(data[name]), data[name].length / capacity);
      }
    }
    return { number, group, count, capacity, shDegree, antialiased, data };
  }

  end() {
    this.clip.free();
  }
}

/** Opens a sequence. */
export async function openPlayer({ module, source, options }, signal) {
  await init({ module_or_path: module });
  const range = await anyRange(await open(source, { request: options.request, part: true, signal }));
  for (let size = FIRST; ; size *= 4) {
    const first = await range(0, size);
    try {
      return new Player(range, first, options);
    } catch (thrown) {
      if (thrown.code !== 'truncated' || first.length < size) throw GsvxError.from(thrown);
    }
  }
}
