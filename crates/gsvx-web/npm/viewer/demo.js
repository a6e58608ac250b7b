// The page of `cargo xtask demo`: a model untuned and tuned, side by side, and the bytes of both as they arrive.
import { Stage, size } from './stage.js';

/* global FACTS */
const { name, plyBytes, original, tuned, start } = FACTS;
const $ = (id) => document.getElementById(id);
const numbers = new Intl.NumberFormat('en');
const bytes = (count) => `${numbers.format(count)} bytes`;
const sides = [['left', original], ['right', tuned]];
const failures = new Set();
const stage = (window.gsvx = new Stage({ show, say }));

/** Both scenes can fail. */
function say(text) {
  if (text) failures.add(text);
  $('message').textContent = [...failures].join('\n');
  $('message').hidden = !failures.size;
}

/** What is drawn of a scene, in words. */
function drawn(slot) {
  const count = slot.drawn();
  if (!count) return slot.complete ? 'nothing to show' : 'loading';
  return `${slot.isCoarse() ? 'coarse, ' : ''}${numbers.format(count)} Gaussians`;
}

function show() {
  for (const [i, [side, file]] of sides.entries()) {
    const slot = stage.slots[i];
    if (!slot?.stop) continue;
    $(`${side}-bytes`).textContent = bytes(slot.received);
    $(`${side}-progress`).value = slot.received / file.bytes;
    $(`${side}-state`).textContent = drawn(slot);
  }
}

function describe() {
  $('title').textContent = `${name}: ${size(plyBytes)} as PLY, ${size(tuned.bytes)} tuned`;
  document.title = `gsvx: ${name}`;
  const facts = {
    'left-quality': original.quality, 'left-psnr': original.psnr.toFixed(1), ply: bytes(plyBytes), 'right-quality': tuned.quality,
    times: Math.round(plyBytes / tuned.bytes), 'model-psnr': tuned.modelPsnr.toFixed(1), 'right-psnr': tuned.psnr.toFixed(1),
  };
  for (const [id, text] of Object.entries(facts)) $(id).textContent = text;
  $('about').open = !matchMedia('(max-width: 600px)').matches;
}

function begin() {
  describe();
  $('reset').onclick = () => stage.camera.reset();
  stage.camera.start = start;
  stage.camera.setUp(start.up);
  if (location.protocol === 'file:') {
    say('A browser reads no scenes from a folder: put it on a web host, or run `python3 -m http.server` in it and open http://localhost:8000');
    return;
  }
  for (const [i, [, { file }]] of sides.entries()) stage.open(new URL(file, location.href).href, file, i);
}

begin();
