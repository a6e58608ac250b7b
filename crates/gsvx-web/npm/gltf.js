// Streams inside glTF, for GLTFLoader of three.js: the extension GSVX_gaussian_splatting_compression.
import { Group } from 'three';
import { GLTFGaussianSplatLoaderExtension } from 'three/addons/loaders/GLTFGaussianSplatLoaderExtension.js';
import { SH_BAND_WORDS } from 'three/addons/utils/GaussianSplatUtils.js';
import { GsvxError } from './error.js';
import { decode } from './index.js';
import { splatObject } from './three.js';

const SPLATS = 'KHR_gaussian_splatting';
const NAME = 'GSVX_gaussian_splatting_compression';
const POINTS = 0;

const splats = (primitive) => primitive.extensions?.[SPLATS];
const compression = (primitive) => splats(primitive)?.extensions?.[NAME];

function negate(values, stride, places) {
  for (let at = 0; at < values.length; at += stride) for (const k of places) values[at + k] = -values[at + k];
}

/** The places of the bytes of a degree's coefficients that are odd in x and y. */
function oddBytes(degree) {
  const orders = Array.from({ length: 2 * degree + 1 }, (_, i) => i).filter((i) => (i - degree) % 2);
  return orders.flatMap((i) => [3 * i, 3 * i + 1, 3 * i + 2]);
}

/** Turns decoded Gaussians from the axes of a stream to those of glTF: half a turn about z. */
function turn({ centers, covariances, sh1, sh2, sh3 }) {
  negate(centers, 3, [0, 1]);
  negate(covariances, 6, [2, 4]);
  [sh1, sh2, sh3].forEach((words, i) => {
    if (!words) return;
    const bytes = new Uint8Array(words.buffer, words.byteOffset, words.byteLength);
    const odd = oddBytes(i + 1);
    // 128 is zero.
    for (let at = 0; at < bytes.length; at += 4 * SH_BAND_WORDS[i + 1]) {
      for (const k of odd) bytes[at + k] = Math.min(256 - bytes[at + k], 255);
    }
  });
}

/**
 * A plugin of GLTFLoader that makes GaussianSplat objects of compressed primitives, and of others as three.js' own
 * plugin, which it takes the place of.
 */
export class GSVXGLTFExtension extends GLTFGaussianSplatLoaderExtension {
  constructor(parser, options = {}) {
    super(parser);
    this.name = NAME;
    this.options = options;
  }

  /** The plugin of three.js would make Gaussians of accessors without data: this one is asked before it. */
  beforeRoot() {
    this.parser.plugins = { [NAME]: this, ...this.parser.plugins };
  }

  loadMesh(index) {
    const mesh = this.parser.json.meshes[index];
    return mesh.primitives.some(compression) ? this.compressed(mesh, index) : super.loadMesh(index);
  }

  /** The object of a mesh; a group if it has several primitives. */
  async compressed(mesh, index) {
    const { parser } = this;
    const objects = await Promise.all(mesh.primitives.map(async (primitive, i) => {
      const object = await this.primitive(primitive, `mesh ${index}, primitive ${i}`);
      object.name = parser.createUniqueName(mesh.name || `mesh_${index}`);
      parser.associations.set(object, { meshes: index, primitives: i });
      return object;
    }));
    const all = objects.length === 1 ? objects[0] : new Group().add(...objects);
    if (objects.length > 1) parser.associations.set(all, { meshes: index });
    if (typeof mesh.extras === 'object') Object.assign(all.userData, mesh.extras);
    return all;
  }

  async primitive(primitive, place) {
    const fail = (what, code = 'damaged') => { throw new GsvxError(`${place}: ${what}`, { code }); };
    if (!compression(primitive)) fail(`it is beside compressed ones, but has no ${NAME}`, 'failed');
    const { kernel } = splats(primitive);
    if (primitive.mode !== POINTS) fail('it is not of mode POINTS', 'failed');
    if (kernel !== 'ellipse') fail(`it has the kernel ${kernel}; ellipse is read`, 'failed');
    const { bufferViews = [], accessors = [] } = this.parser.json;
    const view = compression(primitive).bufferView;
    if (!bufferViews[view]) fail(`${NAME} names a bufferView that is not there`);
    const count = accessors[primitive.attributes?.POSITION]?.count;
    const bytes = await this.parser.getDependency('bufferView', view);
    const onHead = (head) => {
      if (head.count !== count) fail(`its accessors promise ${count} Gaussians, its stream holds ${head.count}`);
    };
    const scene = await decode(bytes, { ...this.options, onHead, layout: 'covariances' });
    turn(scene);
    const object = splatObject(scene);
    object.userData.gltfExtensions = { [SPLATS]: { ...splats(primitive) } };
    return object;
  }
}
