// Threads of their own, in browsers and in Node.

/** Starts a worker; returns how to send to it, hear from it and end it. `own` has a URL in Node, and makes it elsewhere. */
export async function spawn(make, own) {
  if (typeof make === 'function' || typeof Worker !== 'undefined') {
    const worker = typeof make === 'function' ? make() : own.make();
    return {
      send: (message, transfer) => worker.postMessage(message, transfer),
      hear(onMessage, onError) {
        worker.onmessage = ({ data }) => onMessage(data);
        worker.onerror = (event) => onError(new Error(event.message ?? 'the worker cannot be started'));
      },
      end: () => worker.terminate(),
    };
  }
  const threads = await import(/* @vite-ignore */ /* webpackIgnore: true */ 'node:worker_threads');
  const worker = new threads.Worker(own.url());
  return {
    send: (message, transfer) => worker.postMessage(message, transfer),
    hear(onMessage, onError) {
      worker.on('message', onMessage);
      worker.on('error', onError);
    },
    end: () => worker.terminate(),
  };
}
