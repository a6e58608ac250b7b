// The viewer page: opens scenes, and shows what is known of them.
import { Encode } from './encode.js';
import { Player } from './play.js';
import { Stage, size } from './stage.js';

const $ = (id) => document.getElementById(id);
const query = new URLSearchParams(location.search);
const numbers = new Intl.NumberFormat('en');
/** Gaussians of a scene that are drawn at most, unless the address says otherwise. */
const BUDGET = 2_000_000;
const stage = (window.gsvx = new Stage({ show, say, background: query.get('background'), budget: Number(query.get('budget')) || BUDGET }));
const { camera, slots } = stage;
const player = (stage.player = new Player(stage));
stage.play = (slot) => player.open(slot);

/** Whether the panel is put away. */
let isHidden = false;

function say(text) {
  $('message').textContent = text;
  $('message').hidden = !text;
}

/** Writes what is known into the panel. */
function show() {
  const [one, two] = slots;
  $('welcome').hidden = Boolean(one);
  $('panel').hidden = !one || isHidden;
  if (!one) return;
  // A value that both scenes share is shown once.
  const both = (f) => [...new Set(slots.filter((s) => s.stop).map(f))].join(' | ');
  $('title').textContent = two ? `${one.name} | ${two.name}` : one.name;
  document.title = $('title').textContent;
  const length = (s) => size(s.head?.length ?? s.received);
  $('size').textContent = both((s) => s.detail ? `${size(s.received)} of ${length(s)}` : length(s));
  const count = (s) => `${numbers.format(s.drawn())}${s.detail ? ` of ${numbers.format(s.head.total)}` : ''}`;
  $('count').textContent = both((s) => s.drawn() ? count(s) : '–');
  $('budget-row').hidden = !slots.some((s) => s.detail);
  $('budget').textContent = numbers.format(stage.budget);
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

const open = (source, name, number) => stage.open(source, name, number);

let [counted, since] = [0, 0];
/** Says how fast frames come. */
function rate() {
  const [drawn, now] = [stage.frames - counted, performance.now()];
  const each = (1000 * drawn) / (now - since);
  $('fps').textContent = drawn < 2 && stage.isAtRest() ? 'at rest' : each < 1 ? each.toFixed(1) : Math.round(each);
  [counted, since] = [stage.frames, now];
}

function listen() {
  let number = 0;
  const pick = (n) => () => {
    number = n;
    $('file').click();
  };
  $('pick').onclick = pick(0);
  $('open').onclick = pick(0);
  $('compare').onclick = () => slots[1] ? stage.alone() : pick(1)();
  $('file').onchange = () => {
    const [file] = $('file').files;
    if (file) open(file, file.name, number);
    $('file').value = '';
  };
  $('reset').onclick = () => camera.reset();
  $('toggle').onclick = () => hide($('toggle').getAttribute('aria-expanded') === 'true');
  $('sh').oninput = () => {
    $('sh-text').textContent = Number($('sh').value) ? `SH ${$('sh').value}` : 'off';
    stage.setMaxSh(Number($('sh').value));
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
    // A model that is encoded stays.
    if (query.get('encode')) return;
    [...event.dataTransfer.files].slice(0, 2).forEach((file, i) => open(file, file.name, i));
  });
  addEventListener('keydown', (event) => {
    if (event.target.closest?.('input, select') || event.ctrlKey || event.metaKey) return;
    if (event.code !== 'KeyH') return;
    isHidden = !isHidden;
    document.body.classList.toggle('bare', isHidden);
    show();
  });
}

function hide(hidden) {
  $('body').hidden = hidden;
  $('toggle').setAttribute('aria-expanded', String(!hidden));
}

function start() {
  listen();
  // The slider comes first.
  if (query.get('encode') || matchMedia('(max-width: 600px)').matches) hide(true);
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
  if (query.get('encode')) new Encode(stage, query.get('encode'), query.get('cameras') === 'true');
  if (query.get('compare')) open(...named(query.get('compare')), 1);
  show();
  setInterval(rate, 500);
}

start();
