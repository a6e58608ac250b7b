// The viewer page: opens scenes, draws them, and shows what is known of them.
import { Camera } from './camera.js';
import { load } from './loading.js';
import { View } from './view.js';

const $ = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);
const numbers = new Intl.NumberFormat('en');
/** Milliseconds that are drawn after the last change: Spark sorts beside the frames. */
const LINGER = 1200;

const slots = [];
const state = (window.gsvx = { slots, frames: 0 });
let until = 0;
/** A change that no frame has shown yet, however long frames take. */
let changed = false;
const dirty = () => {
  until = performance.now() + LINGER;
  changed = true;
};
const stage = $('stage');
const camera = new Camera(stage, dirty);

function size(bytes) {
  if (!bytes) return '–';
  const [unit, name] = bytes >= 1e6 ? [1e6, 'MB'] : [1e3, 'kB'];
  return `${(bytes / unit).toFixed(bytes / unit < 100 ? 1 : 0)} ${name}`;
}

function say(text) {
  $('message').textContent = text;
  $('message').hidden = !text;
}

/** A scene, its view, and its loading. */
class Slot {
  constructor(number) {
    this.number = number;
    this.view = new View($('views'), dirty);
    const { canvas } = this.view;
    canvas.tabIndex = number ? -1 : 0;
    canvas.setAttribute('role', 'img');
    canvas.classList.toggle('second', number > 0);
    canvas.addEventListener('webglcontextlost', (event) => event.preventDefault());
    this.view.maxSh = Number($('sh').value);
  }

  async open(source, name, lod = 0) {
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
    this.complete = false;
    if (type === 'head') this.head = message.head;
    else if (type === 'progress') Object.assign(this, message);
    else if (type === 'view') this.frame(message);
    else {
      this.view.put(message);
      for (const id of message.replaces) this.shown.delete(id);
      this.shown.set(message.id, message);
      const { id, replaces, lod, shDegree, count } = message;
      (state.log ??= []).push({ id, replaces, lod, shDegree, count, at: performance.now() });
      dirty();
    }
    show();
  }

  /** Goes to where the scene is best looked at from, unless that was done. */
  frame({ view, last }) {
    if (this.number > 0 || state.framed || camera.isFixed || !view) return;
    state.framed = last;
    camera.frame(view);
  }

  /** Gaussians that are drawn. */
  drawn() {
    return [...this.view.pieces.keys()].reduce((sum, id) => sum + (this.shown?.get(id)?.count ?? 0), 0);
  }

  layers() {
    const pieces = [...this.shown.values()];
    if (!pieces.length) return '–';
    const coarse = Math.max(...pieces.map((p) => p.lod)) > this.head.lod;
    const degree = Math.min(...pieces.map((p) => p.shDegree));
    return `${coarse ? 'coarse, ' : ''}base${degree ? ` + SH ${degree > 1 ? `1–${degree}` : 1}` : ''}`;
  }
}

/** Writes what is known into the panel. */
function show() {
  const [one, two] = slots;
  $('welcome').hidden = Boolean(one);
  $('panel').hidden = !one;
  if (!one) return;
  // What is the same of both is said once.
  const both = (f) => [...new Set(slots.filter((s) => s.shown).map(f))].join(' | ');
  $('title').textContent = two ? `${one.name} | ${two.name}` : one.name;
  document.title = $('title').textContent;
  $('size').textContent = both((s) => size(s.head?.length ?? s.received));
  $('count').textContent = both((s) => s.drawn() ? numbers.format(s.drawn()) : '–');
  $('layers').textContent = both((s) => s.layers());
  const { lods = 1, shDegree = 0 } = one.head ?? {};
  $('lod-row').hidden = lods < 2;
  if ($('lod').options.length !== lods) {
    $('lod').replaceChildren(...Array.from({ length: lods }, (_, i) => new Option(i === 0 ? 'finest' : i === lods - 1 ? 'coarsest' : `level ${i}`, i)));
  }
  $('lod').value = one.lod;
  $('sh-row').hidden = Math.max(shDegree, two?.head?.shDegree ?? 0) === 0;
  for (const [i, id] of ['left-name', 'right-name'].entries()) {
    $(id).hidden = !two;
    $(id).textContent = slots[i]?.name ?? '';
  }
  $('divider').hidden = !two;
  $('compare').textContent = two ? 'One scene' : 'Compare';
  const loading = slots.filter((s) => !s.complete);
  const done = loading.reduce((sum, s) => sum + (s.length ? s.received / s.length : 0), 0);
  $('progress').hidden = !loading.length;
  $('progress').value = loading.length ? done / loading.length : 0;
}

function open(source, name, number) {
  if (!slots[number]) {
    slots[number] = new Slot(number);
    theme();
    resize();
  }
  if (number === 0) {
    state.framed = false;
    camera.isMoved = false;
  }
  return slots[number].open(source, name);
}

/** Ends the comparison. */
function endComparison() {
  const [second] = slots.splice(1);
  second.stop.abort();
  second.view.dispose();
  show();
}

function theme() {
  const colour = getComputedStyle(document.documentElement).getPropertyValue('--back').trim();
  const wanted = query.get('background') ?? colour;
  for (const { view } of slots) view.background(wanted);
  dirty();
}

function resize() {
  const { innerWidth: width, innerHeight: height } = window;
  camera.resize(width / height);
  for (const { view } of slots) view.resize(width, height, Math.min(devicePixelRatio, 2));
  dirty();
}

function split(percent) {
  const value = Math.round(Math.min(98, Math.max(2, percent)));
  document.documentElement.style.setProperty('--split', `${value}%`);
  $('divider').setAttribute('aria-valuenow', value);
}

let last = 0;
let counted = 0;
let since = 0;
function frame(now) {
  requestAnimationFrame(frame);
  const seconds = Math.min((now - last) / 1000, 0.1);
  last = now;
  camera.step(seconds);
  if ((changed || now < until) && slots.length) {
    changed = false;
    for (const { view } of slots) view.draw(camera.camera);
    counted += 1;
    state.frames += 1;
  }
  if (now - since > 500) {
    const rate = (1000 * counted) / (now - since);
    const rests = counted < 2 && !changed && now >= until;
    $('fps').textContent = rests ? 'at rest' : rate < 1 ? rate.toFixed(1) : Math.round(rate);
    [counted, since] = [0, now];
  }
}

function listen() {
  let number = 0;
  const pick = (n) => () => {
    number = n;
    $('file').click();
  };
  $('pick').onclick = pick(0);
  $('open').onclick = pick(0);
  $('compare').onclick = () => slots[1] ? endComparison() : pick(1)();
  $('file').onchange = () => {
    const [file] = $('file').files;
    if (file) open(file, file.name, number);
    $('file').value = '';
  };
  $('reset').onclick = () => camera.reset();
  $('toggle').onclick = () => hide($('toggle').getAttribute('aria-expanded') === 'true');
  $('sh').oninput = () => {
    $('sh-text').textContent = Number($('sh').value) ? `SH ${$('sh').value}` : 'off';
    for (const { view } of slots) view.setMaxSh(Number($('sh').value));
    dirty();
  };
  $('lod').onchange = () => {
    const [{ source, name }] = slots;
    slots[0].open(source, name, Number($('lod').value));
  };
  $('up').onchange = () => camera.setUp($('up').value.split(',').map(Number));
  const { classList } = document.body;
  addEventListener('dragover', (event) => {
    event.preventDefault();
    classList.add('over');
  });
  addEventListener('dragleave', (event) => event.relatedTarget ?? classList.remove('over'));
  addEventListener('drop', (event) => {
    event.preventDefault();
    classList.remove('over');
    [...event.dataTransfer.files].slice(0, 2).forEach((file, i) => open(file, file.name, i));
  });
  addEventListener('keydown', (event) => {
    if (event.target.closest?.('input, select') || event.ctrlKey || event.metaKey) return;
    if (event.code === 'KeyR') camera.reset();
    if (event.code === 'KeyH') $('panel').hidden = !$('panel').hidden;
  });
  const divider = $('divider');
  divider.onpointerdown = (event) => divider.setPointerCapture(event.pointerId);
  divider.onpointermove = (event) => divider.hasPointerCapture(event.pointerId) && split((100 * event.clientX) / innerWidth);
  divider.onkeydown = ({ key }) => {
    const step = { ArrowLeft: -2, ArrowRight: 2 }[key];
    if (step) split(Number(divider.getAttribute('aria-valuenow')) + step);
  };
  addEventListener('resize', resize);
  matchMedia('(prefers-color-scheme: light)').addEventListener('change', theme);
}

function hide(hidden) {
  $('body').hidden = hidden;
  $('toggle').setAttribute('aria-expanded', String(!hidden));
}

function start() {
  listen();
  if (matchMedia('(max-width: 600px)').matches) hide(true);
  if (query.get('up')) {
    const up = query.get('up').split(',').map(Number);
    // The axis that is nearest.
    const axis = up.map(Math.abs).indexOf(Math.max(...up.map(Math.abs)));
    $('up').value = [0, 1, 2].map((k) => (k === axis ? Math.sign(up[k]) : 0)).join(',');
    camera.setUp(up);
  }
  const triple = (name) => query.get(name).split(',').map(Number);
  if (query.get('eye') && query.get('ahead')) {
    camera.start = { eye: triple('eye'), ahead: triple('ahead') };
    if (query.get('angle')) camera.start.angle = Number(query.get('angle'));
  }
  if (query.get('camera')) camera.fixed(JSON.parse(query.get('camera')));
  const named = (url) => [new URL(url, location.href).href, decodeURIComponent(new URL(url, location.href).pathname.split('/').pop())];
  if (query.get('url')) open(...named(query.get('url')), 0);
  if (query.get('compare')) open(...named(query.get('compare')), 1);
  show();
  requestAnimationFrame(frame);
}

start();
