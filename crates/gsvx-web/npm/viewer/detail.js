// A scene that is too large for its budget of Gaussians: asks for chunks as the camera moves, and lets go of others.
import { Box3, Frustum, Matrix4, Vector3 } from 'three';
import { Tree } from './cut.js';

/** Milliseconds between two looks. */
const OFTEN = 200;

/** How long boxes look from a camera. */
function looker(camera, height) {
  camera.updateMatrixWorld();
  const seen = new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
  const eye = new Vector3().setFromMatrixPosition(camera.matrixWorld);
  const perRadian = height / 2 / Math.tan((camera.fov * Math.PI) / 360);
  return (bounds) => {
    const box = new Box3(new Vector3(...bounds.slice(0, 3)), new Vector3(...bounds.slice(3)));
    const long = box.min.distanceTo(box.max);
    // Around the camera all is near.
    return { length: (perRadian * long) / Math.max(box.distanceToPoint(eye), long / 8), seen: seen.intersectsBox(box) };
  };
}

export class Detail {
  /** `ask(chunks, gone)` has chunks fetched, the first ones first, unless they were fetched and are not `gone`. */
  constructor(head, { budget, view, ask }) {
    Object.assign(this, { head, budget, view, ask });
    this.tree = new Tree(head);
    /** The pieces of chunks that are drawn or hidden behind finer ones, and of those that are still arriving. */
    this.loaded = new Map();
    this.arriving = new Map();
    this.failed = new Set();
    this.gone = [];
    /** What is wanted now; the worker begins with the roots. */
    this.chosen = this.tree.roots;
    this.looked = 0;
  }

  /** A piece of a chunk has come. */
  take(piece) {
    const pieces = this.arriving.get(piece.chunk) ?? [];
    this.arriving.set(piece.chunk, [...pieces, piece]);
  }

  /** All pieces of a chunk have come. */
  finish(chunk, isGood) {
    const pieces = this.arriving.get(chunk) ?? [];
    this.arriving.delete(chunk);
    if (!isGood) this.failed.add(chunk);
    else if (this.makeRoom(chunk)) this.put(chunk, pieces);
    else this.gone.push(chunk);
    this.looked = 0;
  }

  put(chunk, pieces) {
    for (const behind of this.tree.finer(chunk)) {
      this.tree.standIns.set(behind, pieces.find(({ id }) => id === `${chunk}/${behind}`)?.count ?? 0);
    }
    pieces.forEach((piece) => this.view.put({ ...piece, replaces: [] }));
    this.view.hide(this.standIn(chunk));
    this.loaded.set(chunk, pieces.map(({ id }) => id));
  }

  /** The name of the piece that stands for a chunk. */
  standIn(chunk) {
    return `${this.tree.parents.get(chunk)}/${chunk}`;
  }

  /** Lets go of what shows least until a chunk fits. False if it does not, or if nothing is left that it is a part of. */
  makeRoom(chunk) {
    const { tree, loaded } = this;
    if (!tree.parents.has(chunk)) return true;
    if (!loaded.has(tree.parents.get(chunk))) return false;
    while (this.view.drawn() + tree.extra(chunk) > this.budget) {
      const least = this.chosen.includes(chunk) ? this.least() : undefined;
      if (least === undefined) return false;
      this.drop(least);
    }
    return true;
  }

  /** Of the chunks that are not wanted, and have no finer ones, the one that shows least. */
  least() {
    const { tree, loaded, pixels } = this;
    const idle = [...loaded.keys()].filter((c) => tree.parents.has(c) && !this.chosen.includes(c) && !tree.finer(c).some((f) => loaded.has(f)));
    const apart = new Map(idle.map((c) => [c, pixels ? tree.apart(c, pixels) : 0]));
    return idle.sort((a, b) => apart.get(a) - apart.get(b))[0];
  }

  drop(chunk) {
    this.loaded.get(chunk).forEach((id) => this.view.drop(id));
    this.loaded.delete(chunk);
    this.view.unhide(this.standIn(chunk));
    this.gone.push(chunk);
  }

  /** Chunks that are wanted and not there. */
  missing() {
    const { tree, loaded, failed } = this;
    const broken = (chunk) => chunk !== undefined && (failed.has(chunk) || broken(tree.parents.get(chunk)));
    return this.chosen.filter((chunk) => !loaded.has(chunk) && !broken(chunk));
  }

  /** Whether what is drawn is what the last look asked for. */
  isSettled() {
    return this.looked > 0 && !this.missing().length;
  }

  /** Asks for what a camera sees. `height` is that of the picture, in pixels. */
  look(camera, height, now) {
    if (now - this.looked < OFTEN || !this.tree.roots.every((root) => this.loaded.has(root) || this.failed.has(root))) return;
    this.looked = now;
    this.pixels = looker(camera, height);
    this.chosen = this.tree.choose(this.pixels, this.budget);
    const list = this.chosen.join();
    if (list === this.asked && !this.gone.length) return;
    this.asked = list;
    this.ask(this.chosen, this.gone.splice(0));
  }
}
