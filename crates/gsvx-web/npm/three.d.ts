import type { BufferGeometry, Loader } from 'three';
import type { GaussianSplat } from 'three/addons/objects/GaussianSplat.js';
import type { Covariances, Options, Progress, Source } from './index.js';

/** The geometry of decoded Gaussians in the layout `covariances`. */
export function splatGeometry(scene: Covariances): BufferGeometry;

/** The object of decoded Gaussians in the layout `covariances`. */
export function splatObject(scene: Covariances): GaussianSplat;

/** Loads streams as GaussianSplat objects, which WebGPURenderer draws. */
export class GSVXLoader extends Loader {
  options: Omit<Options<'covariances'>, 'layout' | 'onChunk'>;
  setOptions(options: Omit<Options<'covariances'>, 'layout' | 'onChunk'>): this;
  load(url: string, onLoad: (splat: GaussianSplat) => void, onProgress?: (event: ProgressEvent) => void, onError?: (error: unknown) => void): void;
  parse(source: Source, onProgress?: (progress: Progress) => void): Promise<GaussianSplat>;
  /** The coarsest level of detail first; the second object takes the place of the first. */
  progressive(source: Source, onSplat: (splat: GaussianSplat, last: boolean) => void, onProgress?: (progress: Progress) => void): Promise<void>;
}
