// A thread that gives the frames of a sequence, in the order in which they are asked for.
import { GsvxError } from './error.js';
import { openPlayer } from './player.js';

let player;

async function answer(port, { what, values }) {
  try {
    if (what === 'open') player = await openPlayer(...values);
    const result = what === 'open' ? player.head : await player[what](...values);
    port.postMessage({ result }, Object.values(result?.data ?? {}).map((array) => array.buffer));
  } catch (thrown) {
    port.postMessage({ error: GsvxError.from(thrown).plain() });
  }
}

if (typeof self === 'undefined') {
  // In Node. Messages wait for whoever listens.
  import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:worker_threads')
    .then(({ parentPort: port }) => port.on('message', (message) => answer(port, message)));
} else {
  self.onmessage = ({ data }) => answer(self, data);
}
