// One scene on one canvas, drawn by Spark; its pieces come and go while it loads.
import { SparkRenderer } from '@sparkjsdev/spark';
import { Color, Scene, WebGLRenderer } from 'three';
import { splatMesh } from '../spark.js';

export class View {
  constructor(parent, onDirty) {
    this.renderer = new WebGLRenderer({ antialias: false, powerPreference: 'high-performance' });
    this.canvas = this.renderer.domElement;
    parent.append(this.canvas);
    this.scene = new Scene();
    // As gsvx render and the trainers draw: kernels of 0.3 pixels that dim nothing, up to three standard deviations.
    this.spark = new SparkRenderer({
      renderer: this.renderer, onDirty, sortRadial: false, preBlurAmount: 0.3, blurAmount: 0, maxStdDev: 3, minAlpha: 1 / 255,
      accumExtSplats: true,
    });
    this.scene.add(this.spark);
    this.pieces = new Map();
    /** Pieces that are there and not drawn. */
    this.hidden = new Map();
    /** Pieces of the scene before, which are drawn until this one is complete. */
    this.before = [];
    this.maxSh = 3;
  }

  /** As the model was trained: a blur whose opacity is compensated, or one that dims nothing. */
  antialias(antialiased) {
    Object.assign(this.spark, antialiased ? { preBlurAmount: 0, blurAmount: 0.3 } : { preBlurAmount: 0.3, blurAmount: 0 });
  }

  background(colour) {
    this.scene.background = new Color(colour);
  }

  resize(width, height, ratio) {
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  /** Shows a chunk in the place of what it replaces. */
  put(chunk) {
    const mesh = splatMesh(chunk);
    const { lod, shDegree, count } = chunk;
    mesh.piece = { lod, shDegree, count };
    mesh.maxSh = this.maxSh;
    for (const id of [chunk.id, ...chunk.replaces]) this.drop(id);
    this.pieces.set(chunk.id, mesh);
    if (!this.before.length) this.scene.add(mesh);
  }

  drop(id) {
    const mesh = this.pieces.get(id) ?? this.hidden.get(id);
    if (!mesh) return;
    this.pieces.delete(id);
    this.hidden.delete(id);
    this.scene.remove(mesh);
    mesh.dispose();
  }

  hide(id) {
    const mesh = this.pieces.get(id);
    if (!mesh) return;
    this.pieces.delete(id);
    this.hidden.set(id, mesh);
    this.scene.remove(mesh);
  }

  unhide(id) {
    const mesh = this.hidden.get(id);
    if (!mesh) return;
    this.hidden.delete(id);
    this.pieces.set(id, mesh);
    this.scene.add(mesh);
  }

  /** All pieces that are there. */
  all() {
    return new Map([...this.pieces, ...this.hidden]);
  }

  /** Gaussians that are drawn. */
  drawn() {
    return [...this.pieces.values()].reduce((sum, mesh) => sum + mesh.piece.count, 0);
  }

  clear() {
    for (const id of this.all().keys()) this.drop(id);
    this.complete();
  }

  /** Draws this scene until the next one is complete. */
  keep() {
    if (!this.before.length) {
      this.before = [...this.pieces.values()];
      this.pieces.clear();
    }
    for (const id of this.all().keys()) this.drop(id);
  }

  /** Draws what has come in the place of the scene before. */
  complete() {
    if (!this.before.length) return;
    this.scene.remove(...this.before);
    for (const mesh of this.before.splice(0)) mesh.dispose();
    for (const mesh of this.pieces.values()) this.scene.add(mesh);
  }

  /** Draws SH coefficients up to this degree. */
  setMaxSh(degree) {
    this.maxSh = degree;
    for (const mesh of this.all().values()) {
      mesh.maxSh = degree;
      mesh.updateGenerator();
    }
  }

  draw(camera) {
    this.renderer.render(this.scene, camera);
  }

  dispose() {
    this.clear();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
    this.canvas.remove();
  }
}
