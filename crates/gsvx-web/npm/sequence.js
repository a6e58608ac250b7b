// Opens sequences: threads that decode them, and frames that go to and fro.
import { GsvxError } from './error.js';
import { load } from './load.js';
import { bounds, known, number, sendable } from './options.js';
import { spawn } from './thread.js';

const own = {
  make: () => new Worker(new URL('./sequence-worker.js', import.meta.url), { type: 'module' }),
  url: () => new URL('./sequence-worker.js', import.meta.url),
};

/** The player of a thread of its own. */
class Thread {
  constructor(thread) {
    this.thread = thread;
    this.waiting = [];
    thread.hear(({ result, error }) => {
      // What was under way when the thread was ended has no one who waits for it.
      const { resolve, reject } = this.waiting.shift() ?? {};
      if (!resolve) return;
      if (error) reject(GsvxError.from(error));
      else resolve(result);
    }, (error) => this.end(GsvxError.from(error)));
  }

  ask(what, values, transfer = []) {
    if (this.ended) return Promise.reject(this.ended);
    return new Promise((resolve, reject) => {
      this.waiting.push({ resolve, reject });
      this.thread.send({ what, values }, transfer);
    });
  }

  frame(frame, before) {
    return this.ask('frame', [frame, before], Object.values(before?.data ?? {}).map((array) => array.buffer));
  }

  prepare(group) {
    return this.ask('prepare', [group]);
  }

  end(why) {
    this.ended ??= why;
    this.thread.end();
    for (const { reject } of this.waiting.splice(0)) reject(this.ended);
  }
}

/** See index.d.ts. */
class Sequence {
  #players;
  #current;
  /** The frames whose arrays can be reused. */
  #given = new WeakSet();
  #ended;

  constructor(players, { fps, frames, length, groups }) {
    this.#players = players;
    Object.assign(this, { fps, frames, length, groups: groups.map(({ start, end }) => ({ start, end })) });
  }

  async frame(frame, reuse) {
    if (this.#ended) throw this.#ended;
    number('frame', frame, 0, this.frames - 1);
    if (reuse && !this.#given.delete(reuse)) {
      throw new GsvxError('the frame to reuse is none of this sequence, or was reused before', { code: 'option' });
    }
    const group = this.groups.findIndex(({ end }) => frame < end);
    this.#current = this.#player(group);
    const given = this.#current.player.frame(frame, reuse);
    this.#prepare((group + 1) % this.groups.length);
    const result = await given;
    this.#given.add(result);
    return result;
  }

  /** The player that has a group or is to decode it: not the one whose group is shown, if there are more. */
  #player(group) {
    const { length } = this.#players;
    const found = this.#players.find((p) => p.group === group) ?? this.#players.find((p) => length === 1 || p !== this.#current);
    found.group = group;
    return found;
  }

  /** Has another player decode a group. */
  #prepare(group) {
    if (this.#players.length < 2 || this.#players.some((p) => p.group === group)) return;
    // The failure is that of the frames, when they are asked for.
    this.#player(group).player.prepare(group).catch(() => {});
  }

  close(why = new GsvxError('the sequence is closed', { code: 'option' })) {
    this.#ended ??= why;
    for (const { player } of this.#players.splice(0)) player.end(why);
  }
}

/** Opens a sequence. See index.d.ts. */
export async function loadSequence(source, options = {}) {
  const { layout = 'planar', maxShDegree = 3, limits = {}, request, signal, worker = true, workers = 1, wasm } = options;
  number('maxShDegree', maxShDegree, 0, 3);
  number('workers', workers, 1, 2);
  const settings = { layout: known(layout), maxShDegree, limits: bounds(limits), request };
  signal?.throwIfAborted();
  const input = sendable(await source);
  if (workers > 1 && (input instanceof ReadableStream || !worker)) {
    throw new GsvxError('two workers need a URL, bytes or a Blob, and worker as it is', { code: 'option' });
  }
  const module = await load(wasm, () => new URL('./wasm/sequence_bg.wasm', import.meta.url));
  signal?.throwIfAborted();
  const ask = { module, source: input, options: settings };
  if (!worker) {
    const { openPlayer } = await import('./player.js');
    const player = await openPlayer(ask, signal);
    return new Sequence([{ player }], player.head);
  }
  const threads = [];
  const abort = () => threads.forEach((thread) => thread.end(signal.reason));
  signal?.addEventListener('abort', abort);
  try {
    for (let i = 0; i < workers; i += 1) threads.push(new Thread(await spawn(worker, own)));
    signal?.throwIfAborted();
    const transfer = input instanceof ReadableStream ? [input] : [];
    const [head] = await Promise.all(threads.map((thread) => thread.ask('open', [ask], transfer)));
    return new Sequence(threads.map((player) => ({ player })), head);
  } catch (thrown) {
    threads.forEach((thread) => thread.end(thrown));
    throw thrown;
  }
}
