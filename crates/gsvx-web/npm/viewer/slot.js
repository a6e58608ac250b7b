// A scene on the stage: its view, its loading, and what is known of it.
import { Detail } from './detail.js';
import { load } from './loading.js';
import { View } from './view.js';

export class Slot {
  constructor(number, stage) {
    this.number = number;
    this.stage = stage;
    this.view = new View(document.getElementById('views'), () => stage.dirty());
    const { canvas } = this.view;
    canvas.tabIndex = number ? -1 : 0;
    canvas.setAttribute('role', 'img');
    canvas.classList.toggle('second', number > 0);
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    this.view.maxSh = stage.maxSh;
  }

  /** Opens a scene; if `keep`, the one before is drawn until all of it is there. */
  async open(source, name, lod = 0, keep = false) {
    const { say, show, budget } = this.stage;
    this.stop?.abort();
    if (keep) this.view.keep();
    else this.view.clear();
    Object.assign(this, { source, name, lod, stop: new AbortController(), complete: false, received: 0, gaussians: 0, length: undefined, head: undefined, detail: undefined });
    const { stop } = this;
    this.view.canvas.setAttribute('aria-label', `Scene ${name}`);
    say('');
    show();
    try {
      const { skipped, received } = await load(source, name, { lod, budget }, (message, ask) => !stop.signal.aborted && this.take(message, ask), stop.signal);
      this.received = received;
      if (skipped.length) say(`${name}: ${skipped[0]}${skipped.length > 1 ? `, and ${skipped.length - 1} more` : ''}`);
    } catch (error) {
      if (stop.signal.aborted) return;
      say(error.message.includes(name) ? error.message : `${name}: ${error.message}`);
    }
    this.complete = true;
    this.view.complete();
    this.stage.dirty();
    show();
  }

  take({ type, ...message }, ask) {
    const { stage, view, name } = this;
    if (type !== 'progress') this.complete = false;
    if (type === 'head') {
      this.head = message.head;
      view.antialias(message.head.antialiased);
      if (message.detail) this.detail = new Detail(message.head, { budget: stage.budget, view, ask });
    } else if (type === 'progress') Object.assign(this, message);
    else if (type === 'view') this.frame(message);
    else if (type === 'sequence') stage.play?.(this);
    else if (type === 'note') stage.say(`${name}: ${message.text}`);
    else if (type === 'loaded') {
      if (message.skipped.length) stage.say(`${name}: ${message.skipped[0]}`);
      this.detail.finish(message.chunk, message.isGood);
      stage.dirty();
    } else {
      if (this.detail) this.detail.take(message);
      else view.put(message);
      const { id, replaces, lod, shDegree, count } = message;
      (stage.log ??= []).push({ number: this.number, id, replaces, lod, shDegree, count, at: performance.now() });
      // What waits for the rest of its scene is not drawn.
      if (!view.before.length) stage.dirty();
    }
    stage.show();
  }

  /** Asks for what a camera sees, if that is a part of the scene. */
  look(camera, now) {
    const { detail, view } = this;
    if (!detail) return;
    detail.look(camera, view.canvas.height, now);
    const complete = detail.isSettled();
    if (complete !== this.complete) {
      this.complete = complete;
      this.stage.show();
    }
  }

  /** Goes to where the scene is best looked at from, unless that was done. */
  frame({ view, last }) {
    const { stage } = this;
    if (this.number > 0 || stage.framed || stage.camera.isFixed || !view) return;
    stage.framed = last;
    stage.camera.frame(view);
  }

  /** Gaussians that are drawn. */
  drawn() {
    return this.view.drawn();
  }

  pieces() {
    return [...this.view.pieces.values()].map((mesh) => mesh.piece);
  }

  /** Whether a coarser level stands for a part of the scene. */
  isCoarse() {
    return this.pieces().some((piece) => piece.lod > this.head.lod);
  }

  layers() {
    const pieces = this.pieces();
    if (!pieces.length) return '–';
    const degree = Math.min(...pieces.filter((p) => !this.detail || p.lod === this.head.lod).map((p) => p.shDegree), 3);
    return `${this.isCoarse() ? 'coarse, ' : ''}base${degree ? ` + SH ${degree > 1 ? `1–${degree}` : 1}` : ''}`;
  }
}
