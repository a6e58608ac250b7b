// The camera: orbit by mouse and touch, fly and turn by keys. Both views share it.
import { PerspectiveCamera, Spherical, Quaternion, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';

/** Most degrees of the longer side of the view. */
const MOST = 75;
/** Keys that fly: right, up, back, in units of the distance per second. */
const FLY = { KeyW: [0, 0, -1], KeyS: [0, 0, 1], KeyA: [-1, 0, 0], KeyD: [1, 0, 0], KeyE: [0, 1, 0], KeyQ: [0, -1, 0] };
/** Keys that turn: around, up. */
const TURN = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const ZOOM = { Equal: -1, NumpadAdd: -1, Minus: 1, NumpadSubtract: 1 };

/** The angle of a side that is so many times as long as one with this angle; degrees. */
function wider(angle, times) {
  return (2 * Math.atan(times * Math.tan((angle * Math.PI) / 360)) * 180) / Math.PI;
}

export class Camera {
  constructor(element, onChange) {
    this.camera = new PerspectiveCamera();
    this.element = element;
    this.onChange = onChange;
    this.keys = new Set();
    this.up = new Vector3(0, -1, 0);
    this.home = { eye: [0, 0, -1], target: [0, 0, 0], up: [0, -1, 0], angle: 50 };
    this.listen();
    this.controlled();
  }

  /** Orbit controls take the direction of up when they are made. */
  controlled() {
    this.controls?.dispose();
    this.camera.up.copy(this.up);
    this.controls = new OrbitControls(this.camera, this.element);
    this.controls.enableDamping = !matchMedia('(prefers-reduced-motion: reduce)').matches;
    this.controls.dampingFactor = 0.12;
    this.controls.addEventListener('change', this.onChange);
    this.controls.addEventListener('start', () => (this.isMoved = true));
  }

  listen() {
    const typing = (event) => event.target.closest?.('input, select, textarea, [role="separator"]') || event.ctrlKey || event.metaKey || event.altKey;
    addEventListener('keydown', (event) => {
      if (typing(event) || !(event.code in FLY || event.code in TURN || event.code in ZOOM)) return;
      event.preventDefault();
      this.keys.add(event.code);
      this.isMoved = true;
      this.onChange();
    });
    addEventListener('keyup', (event) => this.keys.delete(event.code));
    addEventListener('blur', () => this.keys.clear());
  }

  setUp(up) {
    this.up.set(...up);
    this.controlled();
    this.reset();
  }

  /** Starts where `outlook` of the decoder says, or turns around what is there. */
  frame(home) {
    this.home = home;
    if (!this.isMoved) this.reset();
  }

  reset() {
    const [eye, target, up] = [this.home.eye, this.home.target, this.home.up].map((v) => new Vector3(...v));
    const offset = eye.sub(target);
    const distance = offset.length();
    if (this.start) {
      this.stand(this.start);
      return;
    }
    // The height above the horizon stays the same when the direction of up changes.
    const height = offset.dot(up) / distance;
    const level = offset.clone().addScaledVector(this.up, -offset.dot(this.up));
    if (level.length() < 0.3 * distance) level.copy(up);
    this.controls.target.copy(target);
    this.camera.position.copy(target).addScaledVector(this.up, height * distance);
    this.camera.position.addScaledVector(level.normalize(), Math.sqrt(1 - height * height) * distance);
    this.finish(distance);
  }

  /** Stands somewhere and looks ahead. */
  stand({ eye, ahead }) {
    const [home, target] = [new Vector3(...this.home.eye), new Vector3(...this.home.target)];
    this.camera.position.set(...eye);
    const away = Math.max(this.camera.position.distanceTo(target), 0.1 * home.distanceTo(target));
    this.controls.target.copy(this.camera.position).addScaledVector(new Vector3(...ahead), away);
    this.finish(away);
  }

  finish(distance) {
    this.camera.near = distance / 500;
    this.camera.far = distance * 500;
    this.resize(this.camera.aspect);
    this.controls.update();
    this.onChange();
  }

  /** Stands where a camera of cameras.json stands. */
  fixed({ position, rotation, fy, height }) {
    const column = (k, sign) => new Vector3(...[0, 1, 2].map((i) => sign * rotation[i][k]));
    this.controls.dispose();
    this.isFixed = true;
    this.camera.fov = (2 * Math.atan(height / 2 / fy) * 180) / Math.PI;
    this.camera.near = 0.01;
    this.camera.far = 100;
    this.camera.matrixAutoUpdate = false;
    this.camera.matrix.makeBasis(column(0, 1), column(1, -1), column(2, -1)).setPosition(new Vector3(...position));
    this.camera.updateMatrixWorld(true);
    this.camera.updateProjectionMatrix();
  }

  resize(aspect) {
    const angle = this.start?.angle ?? this.home.angle;
    this.camera.aspect = aspect;
    if (!this.isFixed) this.camera.fov = aspect < 1 ? Math.min(wider(angle, 1 / aspect), Math.max(MOST, angle)) : angle;
    this.camera.updateProjectionMatrix();
  }

  /** Moves by the keys that are down. */
  step(seconds) {
    if (this.isFixed) return;
    const { camera, controls } = this;
    const offset = camera.position.clone().sub(controls.target);
    const distance = offset.length();
    for (const key of this.keys) {
      if (FLY[key]) {
        const move = new Vector3(...FLY[key]).multiplyScalar(0.7 * distance * seconds).applyQuaternion(camera.quaternion);
        camera.position.add(move);
        controls.target.add(move);
      } else {
        const level = new Quaternion().setFromUnitVectors(this.up, new Vector3(0, 1, 0));
        const place = new Spherical().setFromVector3(offset.clone().applyQuaternion(level));
        place.theta += 1.2 * seconds * (TURN[key]?.[0] ?? 0);
        place.phi -= 1.2 * seconds * (TURN[key]?.[1] ?? 0);
        place.radius *= Math.exp((ZOOM[key] ?? 0) * seconds);
        place.makeSafe();
        camera.position.copy(controls.target).add(offset.setFromSpherical(place).applyQuaternion(level.invert()));
      }
    }
    if (this.keys.size) this.onChange();
    controls.update(seconds);
  }
}
