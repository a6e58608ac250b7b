import type { Object3D } from 'three';
import type { GLTFParser } from 'three/addons/loaders/GLTFLoader.js';
import type { Options } from './index.js';

/**
 * A plugin of GLTFLoader: `loader.register((parser) => new GSVXGLTFExtension(parser))`. It makes GaussianSplat objects
 * of primitives that are compressed by GSVX_gaussian_splatting_compression, and of others as three.js' own plugin for
 * KHR_gaussian_splatting, which it takes the place of.
 */
export class GSVXGLTFExtension {
  readonly name: string;
  constructor(parser: GLTFParser, options?: Omit<Options<'covariances'>, 'layout' | 'onChunk' | 'onHead'>);
  beforeRoot(): void;
  loadMesh(index: number): Promise<Object3D> | null;
}
