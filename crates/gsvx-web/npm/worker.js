// One decoding in a thread of its own.
import { GsvxError } from './error.js';
import { ready, run } from './core.js';

const node = typeof self === 'undefined'
  ? await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:worker_threads') : null;
const port = node ? node.parentPort : self;

async function start({ module, source, options }) {
  try {
    await ready(module);
    const result = await run(source, options, (message, transfer) => port.postMessage(message, transfer ?? []));
    port.postMessage({ type: 'done', result });
  } catch (thrown) {
    port.postMessage({ type: 'error', error: GsvxError.from(thrown).plain() });
  }
}

if (node) port.once('message', start);
else port.onmessage = ({ data }) => start(data);
