// The part of the page for `gsvx view --encode`: has the server encode the model at a quality, and shows what it makes.
import { size } from './stage.js';

const $ = (id) => document.getElementById(id);

/** Milliseconds in which a stream must come for more to be made while the slider moves. */
const SOON = 600;

/** Asks the server; without a `signal`, nothing ends the request. */
async function post(path, query, signal) {
  let answer;
  try {
    answer = await fetch(`/${path}?${query}`, { method: 'POST', signal });
  } catch (error) {
    throw signal?.aborted ? error : new Error('gsvx view has ended in the terminal: start it again');
  }
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

export class Encode {
  /** Begins at a quality; `hasCameras` if there is a choice. */
  constructor(stage, quality, hasCameras) {
    this.stage = stage;
    $('encode').hidden = false;
    $('open').hidden = $('compare').hidden = true;
    $('cameras-row').hidden = !hasCameras;
    $('cameras').checked = hasCameras;
    $('quality').value = quality;
    $('quality').oninput = () => this.move();
    $('quality').onchange = $('cameras').onchange = () => this.ask();
    $('worst').onclick = () => {
      stage.camera.isMoved = true;
      stage.camera.stand(this.worst);
    };
    $('save').onclick = () => this.save();
    this.ask();
  }

  /** While the slider moves, one stream after the other is made; of a large model, one when it is let go. */
  move() {
    $('quality-text').textContent = $('quality').value;
    if (!this.isBusy && this.took < SOON) this.ask();
  }

  /** Asks for the stream of now; one that is under way is given up. */
  async ask() {
    this.stop?.abort();
    const { signal } = (this.stop = new AbortController());
    const quality = $('quality').value;
    const query = (this.query = new URLSearchParams({ quality, cameras: $('cameras').checked }));
    $('quality-text').textContent = quality;
    $('made').textContent = 'encoding …';
    // What was said of the stream before stays, so that nothing moves.
    $('loss').classList.add('old');
    $('save').disabled = $('worst').disabled = this.isBusy = true;
    const start = performance.now();
    try {
      const stream = await (await post('encode', query, signal)).blob();
      await this.stage.open(stream, `quality ${quality}`, 1, true);
      if (signal.aborted) return;
      this.isBusy = false;
      this.took = performance.now() - start;
      this.describe(stream.size);
      $('save').disabled = false;
      // The slider has moved on.
      if ($('quality').value !== quality && this.took < SOON) return void this.ask();
      $('made').append(', comparing …');
      this.judge(stream.size, await (await post('estimate', query, signal)).json());
    } catch (error) {
      if (signal.aborted) return;
      this.isBusy = false;
      $('made').textContent = $('loss').textContent = '';
      this.stage.say(error.message);
    }
  }

  describe(bytes) {
    const [model] = this.stage.slots;
    const all = model.head?.length ?? model.length;
    $('made').textContent = `${size(bytes)}${all ? `, ${(all / bytes).toFixed(1)} times smaller` : ''}`;
  }

  /** Says how much less the stream shows. */
  judge(bytes, { words, warnings, worst }) {
    this.describe(bytes);
    $('loss').classList.remove('old');
    $('loss').textContent = [words, ...warnings].join('\n');
    this.worst = worst;
    $('worst').disabled = !worst;
  }

  async save() {
    $('save').disabled = true;
    try {
      const { command } = await (await post('save', this.query)).json();
      $('command').textContent = command;
      $('saved').hidden = false;
    } catch (error) {
      this.stage.say(error.message);
    }
    $('save').disabled = false;
  }
}
