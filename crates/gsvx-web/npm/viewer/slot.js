// A scene on the stage: its view, its loading, and what is known of it.
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

  async open(source, name, lod = 0) {
    const { say, show } = this.stage;
    this.stop?.abort();
    this.view.clear();
    Object.assign(this, { source, name, lod, stop: new AbortController(), complete: false, received: 0, gaussians: 0, length: undefined, head: undefined, shown: new Map() });
    const { stop } = this;
    this.view.canvas.setAttribute('aria-label', `Scene ${name}`);
    say('');
    show();
    try {
      const { skipped, received } = await load(source, name, lod, (message) => !stop.signal.aborted && this.take(message), stop.signal);
      this.received = received;
      if (skipped.length) say(`${name}: ${skipped[0]}${skipped.length > 1 ? `, and ${skipped.length - 1} more` : ''}`);
    } catch (error) {
      if (stop.signal.aborted) return;
      say(error.message.includes(name) ? error.message : `${name}: ${error.message}`);
    }
    this.complete = true;
    show();
  }

  take({ type, ...message }) {
    const { stage } = this;
    this.complete = false;
    if (type === 'head') this.head = message.head;
    else if (type === 'progress') Object.assign(this, message);
    else if (type === 'view') this.frame(message);
    else {
      this.view.put(message);
      for (const id of message.replaces) this.shown.delete(id);
      this.shown.set(message.id, message);
      const { id, replaces, lod, shDegree, count } = message;
      (stage.log ??= []).push({ number: this.number, id, replaces, lod, shDegree, count, at: performance.now() });
      stage.dirty();
    }
    stage.show();
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
    return [...this.view.pieces.keys()].reduce((sum, id) => sum + (this.shown?.get(id)?.count ?? 0), 0);
  }

  /** Whether a coarser level stands for a part of the scene. */
  isCoarse() {
    return [...this.shown.values()].some((piece) => piece.lod > this.head.lod);
  }

  layers() {
    const pieces = [...this.shown.values()];
    if (!pieces.length) return '–';
    const degree = Math.min(...pieces.map((p) => p.shDegree));
    return `${this.isCoarse() ? 'coarse, ' : ''}base${degree ? ` + SH ${degree > 1 ? `1–${degree}` : 1}` : ''}`;
  }
}
