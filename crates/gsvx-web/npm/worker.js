// One decoding in a thread of its own.
import { GsvxError } from './error.js';
import { ready, run } from './core.js';

async function start(port, { module, source, options }) {
  try {
    await ready(module);
    const result = await run(source, options, (message, transfer) => port.postMessage(message, transfer ?? []));
    port.postMessage({ type: 'done', result });
  } catch (thrown) {
    port.postMessage({ type: 'error', error: GsvxError.from(thrown).plain() });
  }
}

if (typeof self === 'undefined') {
  // In Node. Messages wait for whoever listens.
  import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:worker_threads')
    .then(({ parentPort: port }) => port.once('message', (message) => start(port, message)));
} else {
  self.onmessage = ({ data }) => start(self, data);
}
