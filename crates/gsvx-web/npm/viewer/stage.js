// The stage: scenes over each other, drawn with one camera, and the line that parts them.
import { Camera } from './camera.js';
import { Slot } from './slot.js';

/** Milliseconds that are drawn after the last change: Spark sorts beside the frames. */
const LINGER = 1200;

const $ = (id) => document.getElementById(id);

/** A size in words. */
export function size(bytes) {
  if (!bytes) return '–';
  const [unit, name] = bytes >= 1e6 ? [1e6, 'MB'] : [1e3, 'kB'];
  return `${(bytes / unit).toFixed(bytes / unit < 100 ? 1 : 0)} ${name}`;
}

export class Stage {
  /**
   * `show()` is called when more is known of a scene, `say(text)` when something fails. Of each scene with levels of detail
   * at most `budget` Gaussians are drawn.
   */
  constructor({ show, say, background, budget = Infinity }) {
    Object.assign(this, { show, say, background, budget, slots: [], frames: 0, maxSh: 3, last: 0, until: 0 });
    /** A change that no frame has shown yet, however long frames take. */
    this.changed = false;
    this.camera = new Camera($('stage'), () => this.dirty());
    this.listen();
    requestAnimationFrame((now) => this.frame(now));
  }

  dirty() {
    this.until = performance.now() + LINGER;
    this.changed = true;
  }

  isAtRest() {
    return !this.changed && performance.now() >= this.until;
  }

  /** Opens a scene: the first one, or the one that lies over it, right of the line. `keep` is as for slots. */
  open(source, name, number, keep = false) {
    if (!this.slots[number] && !this.add(number)) return undefined;
    if (number === 0) {
      this.framed = false;
      this.camera.isMoved = false;
    }
    return this.slots[number].open(source, name, 0, keep);
  }

  add(number) {
    try {
      this.slots[number] = new Slot(number, this);
    } catch (error) {
      this.say(`This browser cannot draw scenes: WebGL 2 is missing or turned off (${error.message})`);
      return false;
    }
    this.theme();
    this.resize();
    return true;
  }

  /** Takes the second scene away. */
  alone() {
    const [second] = this.slots.splice(1);
    second.stop.abort();
    second.view.dispose();
    this.show();
  }

  setMaxSh(degree) {
    this.maxSh = degree;
    for (const { view } of this.slots) view.setMaxSh(degree);
    this.dirty();
  }

  theme() {
    const colour = getComputedStyle(document.documentElement).getPropertyValue('--back').trim();
    for (const { view } of this.slots) view.background(this.background ?? colour);
    this.dirty();
  }

  resize() {
    const { innerWidth: width, innerHeight: height } = window;
    this.camera.resize(width / height);
    for (const { view } of this.slots) view.resize(width, height, Math.min(devicePixelRatio, 2));
    this.dirty();
  }

  /** Moves the line. */
  split(percent) {
    const value = Math.round(Math.min(98, Math.max(2, percent)));
    document.documentElement.style.setProperty('--split', `${value}%`);
    $('divider').setAttribute('aria-valuenow', value);
  }

  frame(now) {
    requestAnimationFrame((next) => this.frame(next));
    const seconds = Math.min((now - this.last) / 1000, 0.1);
    this.last = now;
    this.camera.step(seconds);
    if ((!this.changed && now >= this.until) || !this.slots.length) return;
    this.changed = false;
    for (const slot of this.slots) slot.look(this.camera.camera, now);
    for (const { view } of this.slots) view.draw(this.camera.camera);
    this.frames += 1;
  }

  listen() {
    const divider = $('divider');
    divider.onpointerdown = (event) => {
      divider.setPointerCapture(event.pointerId);
      // Otherwise the camera would turn.
      event.stopPropagation();
    };
    divider.onpointermove = (event) => divider.hasPointerCapture(event.pointerId) && this.split((100 * event.clientX) / innerWidth);
    divider.onkeydown = ({ key }) => {
      const step = { ArrowLeft: -2, ArrowRight: 2 }[key];
      if (step) this.split(Number(divider.getAttribute('aria-valuenow')) + step);
    };
    addEventListener('keydown', (event) => {
      if (event.target.closest?.('input, select') || event.ctrlKey || event.metaKey) return;
      if (event.code === 'KeyR') this.camera.reset();
    });
    addEventListener('resize', () => this.resize());
    matchMedia('(prefers-color-scheme: light)').addEventListener('change', () => this.theme());
  }
}
