import type { AppBase, Asset, GraphicsDevice, GSplatResourceBase } from 'playcanvas';
import type { Options, Scene } from './index.js';

/** A resource of decoded Gaussians in the layout `packed`. */
export class GSVXResource extends GSplatResourceBase {
  constructor(device: GraphicsDevice, scene: Scene<'packed'>, options?: { prepareCenters?: boolean });
}

/** A parser for .gsvx assets of type gsplat. An asset's `data.gsvx` has options for that asset alone. */
export class GSVXParser {
  constructor(app: AppBase, options?: Omit<Options<'packed'>, 'layout' | 'onChunk'>);
  canParse(context: { ext: string }): boolean;
  load(url: string | { load: string; original: string }, callback: (error: unknown, resource?: GSVXResource) => void, asset?: Asset): void;
  open(url: string, data: GSVXResource): GSVXResource;
}
