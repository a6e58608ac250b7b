import type { SplatMesh } from '@sparkjsdev/spark';
import type { Group } from 'three';
import type { Chunk, Options, Result, Source } from './index.js';

/** A mesh of decoded Gaussians in the layout `packed`. */
export function splatMesh(chunk: Pick<Chunk<'packed'>, 'count' | 'data'>): SplatMesh;

/** A group that shows a stream as it arrives, a mesh for each chunk. */
export class GSVXSplats extends Group {
  constructor(source: Source, options?: Omit<Options<'packed'>, 'layout'>);
  /** Settles when all is shown, or with the error. */
  readonly done: Promise<Result>;
  /** Meshes by the ids of their chunks. */
  readonly pieces: Map<string, SplatMesh>;
  /** Ends the loading and frees what is shown. */
  dispose(): void;
}
