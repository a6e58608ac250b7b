// gsvx streams in Spark: SplatMeshes of a group, one for each chunk. Spark sorts all meshes together.
import { ExtSplats, SplatMesh } from '@sparkjsdev/spark';
import { Group } from 'three';
import { decode } from './index.js';

/** A mesh of decoded Gaussians in the layout `packed`. */
export function splatMesh({ count, data }) {
  const { a, b, ...extra } = data;
  return new SplatMesh({ splats: new ExtSplats({ extArrays: [a, b], numSplats: count, extra }), editable: false });
}

/**
 * A group that shows a stream as it arrives: `done` is the promise of {@link decode}. Options are those of
 * `decode`. The blur is that of the SparkRenderer: an antialiased model (`head.antialiased`) needs
 * `preBlurAmount: 0, blurAmount: 0.3`, any other `preBlurAmount: 0.3, blurAmount: 0`.
 */
export class GSVXSplats extends Group {
  constructor(source, { onChunk, ...options } = {}) {
    super();
    this.type = 'GSVXSplats';
    this.pieces = new Map();
    this.stop = new AbortController();
    const signal = options.signal ? AbortSignal.any([options.signal, this.stop.signal]) : this.stop.signal;
    const show = (chunk) => {
      this.put(chunk);
      onChunk?.(chunk);
    };
    this.done = decode(source, { ...options, signal, layout: 'packed', onChunk: show });
  }

  /** Shows a chunk in the place of what it replaces. */
  put(chunk) {
    const mesh = splatMesh(chunk);
    for (const id of [chunk.id, ...chunk.replaces]) this.drop(id);
    this.pieces.set(chunk.id, mesh);
    this.add(mesh);
  }

  drop(id) {
    const mesh = this.pieces.get(id);
    if (!mesh) return;
    this.pieces.delete(id);
    this.remove(mesh);
    mesh.dispose();
  }

  /** Ends the loading and frees what is shown. */
  dispose() {
    this.stop.abort();
    for (const id of [...this.pieces.keys()]) this.drop(id);
  }
}
