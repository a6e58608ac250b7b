// gsvx streams in PlayCanvas: a parser for assets of type gsplat. The Gaussians stay packed on the GPU, 32
// bytes each and a word for each SH coefficient; the shaders below unpack them.
import { GSplatFormat, GSplatResourceBase, PIXELFORMAT_RGBA32U, Vec3 } from 'playcanvas';
import { decode } from './index.js';

/** The same in both languages: coefficients from the words of `d`. */
const coefficients = `    sh[0] = gsvxCoefficient(d.x); sh[1] = gsvxCoefficient(d.y); sh[2] = gsvxCoefficient(d.z);
    #if SH_BANDS > 1
        sh[3] = gsvxCoefficient(d.w);
        d = loadGsvxSh2();
        sh[4] = gsvxCoefficient(d.x); sh[5] = gsvxCoefficient(d.y); sh[6] = gsvxCoefficient(d.z); sh[7] = gsvxCoefficient(d.w);
    #endif
    #if SH_BANDS > 2
        d = loadGsvxSh3a();
        sh[8] = gsvxCoefficient(d.x); sh[9] = gsvxCoefficient(d.y); sh[10] = gsvxCoefficient(d.z); sh[11] = gsvxCoefficient(d.w);
        d = loadGsvxSh3b();
        sh[12] = gsvxCoefficient(d.x); sh[13] = gsvxCoefficient(d.y); sh[14] = gsvxCoefficient(d.z);
    #endif
`;

const readGLSL = /* glsl */`
uvec4 packedB;

vec3 getCenter() {
    packedB = loadGsvxB();
    return uintBitsToFloat(loadGsvxA().xyz);
}

vec4 getColor() {
    return vec4(unpackHalf2x16(packedB.x), unpackHalf2x16(packedB.y).x, unpackHalf2x16(loadGsvxA().w).x);
}

vec3 getScale() {
    return exp(vec3(unpackHalf2x16(packedB.y).y, unpackHalf2x16(packedB.z)));
}

// w, x, y, z: an axis on an octahedron, and an angle.
vec4 getRotation() {
    vec2 f = vec2(packedB.w & 1023u, (packedB.w >> 10u) & 1023u) / 511.5 - 1.0;
    vec3 axis = vec3(f, 1.0 - abs(f.x) - abs(f.y));
    float t = max(-axis.z, 0.0);
    axis.x += axis.x >= 0.0 ? -t : t;
    axis.y += axis.y >= 0.0 ? -t : t;
    float halfAngle = float(packedB.w >> 20u) * (1.5707963267948966 / 4095.0);
    return vec4(cos(halfAngle), normalize(axis) * sin(halfAngle));
}

#if SH_BANDS > 0

// Magnitudes of 8 bits, their signs, and a common exponent.
vec3 gsvxCoefficient(uint word) {
    vec3 v = vec3(uvec3(word, word >> 8u, word >> 16u) & 255u) * (exp2(float(word >> 27u) - 15.0) / 255.0);
    return v * (1.0 - 2.0 * vec3(uvec3(word >> 24u, word >> 25u, word >> 26u) & 1u));
}

void readSHData(out vec3 sh[SH_COEFFS], out float scale) {
    scale = 1.0;
    uvec4 d = loadGsvxSh1();
${coefficients}}

#endif
`;

const readWGSL = /* wgsl */`
var<private> packedB: vec4u;

fn getCenter() -> vec3f {
    packedB = loadGsvxB();
    return bitcast<vec3f>(loadGsvxA().xyz);
}

fn getColor() -> vec4f {
    return vec4f(unpack2x16float(packedB.x), unpack2x16float(packedB.y).x, unpack2x16float(loadGsvxA().w).x);
}

fn getScale() -> vec3f {
    return exp(vec3f(unpack2x16float(packedB.y).y, unpack2x16float(packedB.z)));
}

fn getRotation() -> vec4f {
    let f = vec2f(f32(packedB.w & 1023u), f32((packedB.w >> 10u) & 1023u)) / 511.5 - 1.0;
    var axis = vec3f(f, 1.0 - abs(f.x) - abs(f.y));
    let t = max(-axis.z, 0.0);
    axis.x += select(t, -t, axis.x >= 0.0);
    axis.y += select(t, -t, axis.y >= 0.0);
    let halfAngle = f32(packedB.w >> 20u) * (1.5707963267948966 / 4095.0);
    return vec4f(cos(halfAngle), normalize(axis) * sin(halfAngle));
}

#if SH_BANDS > 0

fn gsvxCoefficient(word: u32) -> half3 {
    let v = vec3f((vec3u(word) >> vec3u(0u, 8u, 16u)) & vec3u(255u)) * (exp2(f32(word >> 27u) - 15.0) / 255.0);
    return half3(v * (1.0 - 2.0 * vec3f((vec3u(word) >> vec3u(24u, 25u, 26u)) & vec3u(1u))));
}

fn readSHData(sh: ptr<function, array<half3, SH_COEFFS>>, scale: ptr<function, f32>) {
    *scale = 1.0;
    var d = loadGsvxSh1();
${coefficients}}

#endif
`;

/** The arrays of the layout `packed`, by the names of the textures that hold them. */
const TEXTURES = { a: 'gsvxA', b: 'gsvxB', sh1: 'gsvxSh1', sh2: 'gsvxSh2', sh3a: 'gsvxSh3a', sh3b: 'gsvxSh3b' };

/** What the engine asks of a scene: how many Gaussians, and where. */
class GSVXData {
  constructor({ count, shDegree, a }) {
    this.numSplats = count;
    this.shBands = shDegree;
    this.words = new Float32Array(a.buffer, a.byteOffset, a.length);
  }

  getCenters() {
    const { words } = this;
    const centers = new Float32Array(3 * this.numSplats);
    for (let i = 0; i < this.numSplats; i += 1) {
      for (let k = 0; k < 3; k += 1) centers[3 * i + k] = words[4 * i + k];
    }
    return centers;
  }

  calcAabb(box) {
    const [least, greatest] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
    for (let i = 0; i < this.numSplats; i += 1) {
      for (let k = 0; k < 3; k += 1) {
        const v = this.words[4 * i + k];
        if (v < least[k]) least[k] = v;
        if (v > greatest[k]) greatest[k] = v;
      }
    }
    if (this.numSplats) box.setMinMax(new Vec3(...least), new Vec3(...greatest));
    return this.numSplats > 0;
  }
}

/** A resource of decoded Gaussians in the layout `packed`. */
export class GSVXResource extends GSplatResourceBase {
  constructor(device, scene, options) {
    super(device, new GSVXData(scene), options);
    const present = Object.entries(TEXTURES).filter(([array]) => scene[array]);
    const streams = present.map(([, name]) => ({ name, format: PIXELFORMAT_RGBA32U }));
    this._format = new GSplatFormat(device, streams, { readGLSL, readWGSL });
    this.streams.init(this.format, scene.count);
    for (const [array, name] of present) {
      const texture = this.streams.getTexture(name);
      texture.lock().set(scene[array].subarray(0, 4 * scene.count));
      texture.unlock();
    }
    // The textures hold the data now.
    this.gsplatData.words = undefined;
  }

  configureMaterialDefines(defines) {
    defines.set('SH_BANDS', this.gsplatData.shBands);
  }
}

/**
 * A parser for .gsvx assets: `app.loader.getHandler('gsplat').addParser(new GSVXParser(app))`. Options are
 * those of `decode`; an asset's `data.gsvx` has more for that asset alone, such as `{ lod: 255 }`. The engine
 * loads an address once: two assets of one stream need addresses that differ, by `?coarse` for example.
 */
export class GSVXParser {
  constructor(app, options = {}) {
    this.app = app;
    this.options = options;
  }

  canParse({ ext }) {
    return ext === 'gsvx';
  }

  load(url, callback, asset) {
    const source = new URL(typeof url === 'string' ? url : url.load, globalThis.location?.href);
    decode(source, { ...this.options, ...asset?.data?.gsvx, layout: 'packed' })
      .then((scene) => {
        const prepareCenters = this.app.scene?.gsplatCentersEnabled !== false;
        return new GSVXResource(this.app.graphicsDevice, scene, { prepareCenters });
      })
      .then((resource) => callback(null, resource), (error) => callback(error));
  }

  open(url, data) {
    return data;
  }
}
