/** What a scene is decoded to. */
export type Layout = 'planar' | 'packed' | 'covariances';

/** A URL (of http, https, blob or, in Node, file), a response, a file, bytes, or a stream of bytes. */
export type Source = string | URL | Response | Promise<Response> | Blob | ArrayBuffer | ArrayBufferView | ReadableStream<Uint8Array>;

/** Floats as trained. */
export interface Planar {
  /** x, y, z. */
  means: Float32Array;
  /** w, x, y, z. */
  rotations: Float32Array;
  /** Natural logarithms of the standard deviations. */
  logScales: Float32Array;
  /** Logits of the opacities. */
  opacityLogits: Float32Array;
  /** Coefficient after coefficient, degree 0 first, each red, green, blue. */
  sh: Float32Array;
}

/**
 * 32 bytes for each Gaussian, and a word for each SH coefficient: the arrays of Spark's `ExtSplats`. In chunks there is
 * room for a multiple of 2048 Gaussians.
 */
export interface Packed {
  a: Uint32Array;
  b: Uint32Array;
  sh1?: Uint32Array;
  sh2?: Uint32Array;
  sh3a?: Uint32Array;
  sh3b?: Uint32Array;
}

/** What the GaussianSplat addon of three.js takes; `colors` are words of red, green, blue and alpha. */
export interface Covariances {
  centers: Float32Array;
  covariances: Float32Array;
  colors: Uint32Array;
  sh1?: Uint32Array;
  sh2?: Uint32Array;
  sh3?: Uint32Array;
}

export interface Layouts {
  planar: Planar;
  packed: Packed;
  covariances: Covariances;
}

/** A chunk in the index of a stream. */
export interface ChunkEntry {
  /** Gaussians that are coded bit for bit; they belong to every level of detail. */
  exact: boolean;
  /** Level of detail; 0 is the finest. */
  lod: number;
  count: number;
  /** Least, then greatest x, y, z of the means. */
  bounds: number[];
  /** Offset and length of each layer: base, then one for each SH degree. */
  layers: [number, number][];
  /** Numbers of the chunks of the next finer level that together replace it. */
  finer: number[];
}

/** The head of a stream, and what of it will be decoded. */
export interface Head {
  /** Gaussians at the finest level. */
  count: number;
  headLength: number;
  /** Bytes of the whole stream. */
  length: number;
  /** Levels of detail in the stream. */
  lods: number;
  chunks: ChunkEntry[];
  /** Level of detail that will be decoded. */
  lod: number;
  /** SH degree that will be decoded. */
  shDegree: number;
  /** True for a model trained to be drawn with opacity compensated for the blur of 0.3 pixels (Mip-Splatting). */
  antialiased: boolean;
  /** Gaussians of that level. */
  total: number;
}

/** Gaussians of a chunk, or of the part of a coarse chunk that one finer chunk replaces. */
export interface Chunk<L extends Layout = 'planar'> {
  /** What comes later with the same id takes its place: the same Gaussians with further SH degrees. */
  id: string;
  /** Ids of pieces that this one takes the place of: coarser ones. */
  replaces: string[];
  /** Number of the chunk in the index. */
  chunk: number;
  /** Level of detail. */
  lod: number;
  shDegree: number;
  count: number;
  /** Least, then greatest x, y, z of the means in the chunk. */
  bounds: number[];
  data: Layouts[L];
}

export interface Progress {
  /** Bytes that have arrived. */
  received: number;
  /** Bytes of the whole stream. */
  length: number;
  /** Gaussians of the wanted level that have been handed out. */
  gaussians: number;
  /** Gaussians of the wanted level. */
  total: number;
}

export interface Options<L extends Layout = 'planar'> {
  /** What the Gaussians are decoded to; `planar` without it. */
  layout?: L;
  /** Highest SH degree; 3 without it. A remote stream's further layers are not fetched, but for gaps of less than 8 kB. */
  maxShDegree?: number;
  /** Level of detail; 0, the finest, without it. A number above the coarsest stands for the coarsest. */
  lod?: number;
  /** Hand out coarser levels first; true if there is `onChunk`. */
  progressive?: boolean;
  /** Leave out what is missing or damaged instead of failing, and list it in `skipped`. */
  salvage?: boolean;
  /** What is refused as soon as the head is known. */
  limits?: {
    /** Greatest number of Gaussians; without it as many as take 1024 bytes as floats for each byte of the stream, and 64 MiB more. */
    gaussians?: number;
    /** Greatest number of bytes for output and decoder, estimated from the head. */
    bytes?: number;
  };
  onHead?(head: Head): void;
  /** Called for each chunk as soon as it is whole, the coarse level first. */
  onChunk?(chunk: Chunk<L>): void;
  onProgress?(progress: Progress): void;
  /** Ends the decoding; its worker is gone then. */
  signal?: AbortSignal;
  /** Passed to `fetch`: headers, credentials. */
  request?: RequestInit;
  /** Decode in a worker of its own (true), in the calling thread (false), or in the one that is made here. */
  worker?: boolean | (() => Worker);
  /**
   * Workers that share the chunks; 1 without it. For a source that is at hand, bytes or a Blob, and with `onChunk`:
   * chunks come in any order, and no coarser levels before them. Each worker has a decoder's memory.
   */
  workers?: number;
  /** The decoder, where it is not beside the package: URL, bytes or compiled module. */
  wasm?: string | URL | BufferSource | WebAssembly.Module;
}

/** What was decoded, if chunks were handed out. */
export interface Result {
  head: Head;
  /** What was left out, and why; one line each. */
  skipped: string[];
  /** Bytes that have arrived. */
  received: number;
  /** Bytes of the decoder's memory at the end. */
  memory: number;
}

/** A decoded scene. */
export type Scene<L extends Layout = 'planar'> = Layouts[L] & {
  count: number;
  shDegree: number;
  antialiased: boolean;
  skipped: string[];
  memory: number;
};

/** Decodes a stream and hands out its chunks as they become whole. */
export function decode<L extends Layout = 'planar'>(source: Source, options: Options<L> & Required<Pick<Options<L>, 'onChunk'>>): Promise<Result>;
/** Decodes a stream; the promise gives the whole scene. */
export function decode<L extends Layout = 'planar'>(source: Source, options?: Options<L>): Promise<Scene<L>>;

export interface SequenceOptions<L extends Layout = 'planar'> extends Pick<Options<L>, 'layout' | 'maxShDegree' | 'request' | 'signal' | 'worker' | 'wasm'> {
  limits?: {
    /** Greatest number of Gaussians of a group; without it, in proportion to its bytes. */
    gaussians?: number;
  };
  /** With 2, for a URL, bytes or a Blob, the next group is decoded while one is shown; 1 without it. */
  workers?: 1 | 2;
}

/** A frame of a sequence. */
export interface Frame<L extends Layout = 'planar'> {
  /** Its number, from 0 on. */
  number: number;
  /** The number of its group. */
  group: number;
  /** Gaussians of the group. Those that are not in this frame are transparent: the logit of their opacity is -Infinity. */
  count: number;
  /** Gaussians that the arrays have room for, a multiple of 2048. */
  capacity: number;
  shDegree: number;
  antialiased: boolean;
  data: Layouts[L];
}

/** A sequence that is open. */
export interface Sequence<L extends Layout = 'planar'> {
  /** Frames per second. */
  readonly fps: number;
  /** Number of frames. */
  readonly frames: number;
  /** Bytes of the sequence. */
  readonly length: number;
  /** For each group, its first frame and the one behind its last. Groups are decoded whole, one at a time. */
  readonly groups: { start: number; end: number }[];
  /**
   * A frame. The arrays of `reuse`, a frame that this gave before, become those of the new one; `reuse` has none then. Within
   * a group only what moves is written.
   */
  frame(number: number, reuse?: Frame<L>): Promise<Frame<L>>;
  /** Ends the workers; frames that were asked for are rejected. Node does not end before. */
  close(): void;
}

/** Opens a sequence of frames. */
export function loadSequence<L extends Layout = 'planar'>(source: Source, options?: SequenceOptions<L>): Promise<Sequence<L>>;

/**
 * What went wrong. Codes: `not-gsvx`, `version`, `truncated`, `damaged`, `limit`, `http`, `network` (the source
 * cannot be read: a server, a file, a stream), `memory`, `option`, `failed`.
 */
export class GsvxError extends Error {
  code: string;
  /** Offset in the stream. */
  offset?: number;
  chunk?: number;
  layer?: number;
  /** Status of the HTTP response. */
  status?: number;
}
