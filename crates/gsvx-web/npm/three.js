// gsvx streams in three.js: for the GaussianSplat addon, which WebGPURenderer draws.
import { Box3, Loader, Sphere, Vector3 } from 'three';
import { GaussianSplat } from 'three/addons/objects/GaussianSplat.js';
import { createGaussianSplatGeometry } from 'three/addons/utils/GaussianSplatUtils.js';
import { decode } from './index.js';

/** The geometry of decoded Gaussians in the layout `covariances`. */
export function splatGeometry({ centers, covariances, colors, sh1, sh2, sh3 }) {
  const bytes = new Uint8Array(colors.buffer, colors.byteOffset, colors.byteLength);
  return createGaussianSplatGeometry(centers, covariances, bytes, { sh1, sh2, sh3 });
}

/** The object of decoded Gaussians in the layout `covariances`. */
export function splatObject(scene) {
  const splat = new GaussianSplat(splatGeometry(scene));
  // In r187 objects whose materials have the same key share the buffers of the first.
  const { material } = splat;
  const key = `${material.customProgramCacheKey()},${splat.uuid}`;
  material.customProgramCacheKey = () => key;
  return splat;
}

/** Loads streams as GaussianSplat objects. The addon sorts one object at a time, so a scene is one object. */
export class GSVXLoader extends Loader {
  /** Options of `decode`. */
  options = {};

  setOptions(options) {
    this.options = options;
    return this;
  }

  /** Calls `onLoad` with the object; `onProgress` gets events as those of XMLHttpRequest. */
  load(url, onLoad, onProgress, onError) {
    const address = new URL(this.path + url, globalThis.location?.href).href;
    this.manager.itemStart(address);
    this.parse(address, ({ received, length }) => onProgress?.({ lengthComputable: true, loaded: received, total: length }))
      .then(onLoad)
      .catch((error) => {
        if (onError) onError(error);
        else console.error(error);
        this.manager.itemError(address);
      })
      .finally(() => this.manager.itemEnd(address));
  }

  /** The object of any source that `decode` takes. */
  async parse(source, onProgress) {
    const request = { headers: this.requestHeader, credentials: this.withCredentials ? 'include' : 'same-origin' };
    const scene = await decode(source, { request, onProgress, ...this.options, layout: 'covariances' });
    return splatObject(scene);
  }

  /**
   * The coarsest level of detail first: `onSplat` gets an object for it and then one for the whole scene,
   * which takes the place of the first.
   */
  async progressive(source, onSplat, onProgress) {
    const coarse = await this.coarse(source);
    if (coarse) onSplat(coarse, false);
    onSplat(await this.parse(source, onProgress), true);
  }

  async coarse(source) {
    const { options } = this;
    const scene = await decode(source, { ...options, layout: 'covariances', lod: 255 });
    return scene.count ? splatObject(scene) : undefined;
  }
}
