// One loading in a thread of its own: a stream, or a model in another format, which is read whole.
import { GsvxError } from '../error.js';
import { ready, run } from '../core.js';
import { openPlayer } from '../player.js';
import { open } from '../source.js';
import { Levels, gaussians, peek } from './levels.js';
import { Model, outlook } from '../wasm/gsvx.js';

/** Gaussians of a model that are handed out at a time. */
const PIECE = 1 << 16;

/** Says where the scene is best looked at from, as far as it is known. */
const view = (last) => postMessage({ type: 'view', view: outlook(), last });

/** Loads a stream. Its view is that of the coarsest level; of a stream without levels, that of the first chunk, then of all. */
async function stream(source, options) {
  const shown = new Set();
  let [waits, told] = [Infinity, false];
  const result = await run(source, options, (message, transfer) => {
    postMessage(message, transfer ?? []);
    const { type, head, id, count } = message;
    if (type === 'head') {
      const coarsest = head.chunks.filter((c) => head.lods === 1 || (!c.exact && c.lod === head.lods - 1));
      waits = coarsest.reduce((sum, c) => sum + c.count, 0);
    }
    if (type !== 'chunk' || told || shown.has(id)) return;
    waits -= count;
    told = waits <= 0;
    if (told || (shown.size === 0 && message.lod === 0)) view(told);
    shown.add(id);
  });
  if (!told) view(true);
  return result;
}

/** Loads the first frame of a sequence; `thrown` is why the source is no stream. The page plays the rest. */
async function sequence(source, thrown) {
  const player = await openPlayer({ source, options: { layout: 'packed', maxShDegree: 3, limits: {} } }).catch((error) => {
    throw error.code === 'damaged' ? thrown : error;
  });
  const { count, shDegree, antialiased, data } = await player.frame(0);
  const { length } = player.head;
  postMessage({ type: 'head', head: { count, total: count, shDegree, antialiased, lods: 1, lod: 0, length, chunks: [] } });
  view(true);
  postMessage({ type: 'chunk', id: 'frame', replaces: [], lod: 0, shDegree, count, data }, Object.values(data).map((array) => array.buffer));
  postMessage({ type: 'sequence' });
  return { skipped: [], received: length };
}

let levels;

/** Loads a stream: all of it, or with levels of detail and more Gaussians than the budget what the page asks for. */
async function scene(source, { budget, ...options }) {
  let peeked;
  try {
    peeked = await peek(source, options.lod > 0);
  } catch (thrown) {
    return sequence(source, thrown);
  }
  const { head, input, stop } = peeked;
  const lod = head && Math.min(options.lod, head.lods - 1);
  if (!head || gaussians(head, lod) <= budget) return stream(input, options);
  const inParts = lod < head.lods - 1 && (input.range ? input : await open(source, { part: true }));
  if (!inParts?.range) {
    const why = inParts ? 'the host gives no parts of files' : 'the stream has no levels of detail (gsvx encode --lod)';
    postMessage({ type: 'note', text: `all ${gaussians(head, lod)} Gaussians are drawn, more than the budget of ${budget}: ${why}` });
    return stream(input, options);
  }
  await stop();
  levels = new Levels(inParts, options, (message, transfer) => postMessage(message, transfer ?? []));
  return levels.run(() => view(true));
}

async function bytesOf(input) {
  if (input.range) return input.range(0, input.length);
  const pieces = [];
  let received = 0;
  for await (const piece of input.pieces()) {
    pieces.push(piece);
    received += piece.length;
    postMessage({ type: 'progress', received, length: input.length, gaussians: 0 });
  }
  const all = new Uint8Array(received);
  let at = 0;
  for (const piece of pieces) {
    all.set(piece, at);
    at += piece.length;
  }
  return all;
}

async function model(source, name) {
  const bytes = await bytesOf(await open(source, {}));
  const model = new Model(name, bytes);
  const { count, shDegree, antialiased } = model;
  postMessage({ type: 'head', head: { count, total: count, shDegree, antialiased, lods: 1, lod: 0, length: bytes.length, chunks: [] } });
  view(true);
  for (let first = 0; first < count; first += PIECE) {
    const size = Math.min(PIECE, count - first);
    const data = model.take(first, size, Math.ceil(size / 2048) * 2048, 'packed', shDegree);
    const message = { type: 'chunk', id: `${first}`, replaces: [], lod: 0, shDegree, count: size, data };
    postMessage(message, Object.values(data).map((array) => array.buffer));
  }
  model.free();
  return { skipped: [], received: bytes.length };
}

onmessage = async ({ data: { want, gone, module, source, name, options } }) => {
  if (want) {
    levels.want(want, gone);
    return;
  }
  try {
    await ready(module);
    const other = /\.(ply|spz|splat|glb)$/i.test(name);
    const result = other ? await model(source, name) : await scene(source, options);
    postMessage({ type: 'done', result });
  } catch (thrown) {
    postMessage({ type: 'error', error: GsvxError.from(thrown).plain() });
  }
};
