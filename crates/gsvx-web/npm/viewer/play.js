// Plays the sequences on the stage: play, pause, and the time line.
import { clip } from './loading.js';

const $ = (id) => document.getElementById(id);

/** A sequence in a slot. */
class Clip {
  constructor(slot, sequence) {
    Object.assign(this, { slot, sequence });
  }

  /** Draws a frame; of those that are asked for meanwhile, only the last one. */
  async show(number) {
    this.wanted = Math.min(number, this.sequence.frames - 1);
    if (this.isBusy) return;
    this.isBusy = true;
    try {
      while (this.wanted !== this.shown?.number) {
        const frame = await this.sequence.frame(this.wanted, this.spare);
        // What was drawn before is not drawn any more, so its arrays are free.
        [this.shown, this.spare] = [frame, this.shown];
        const { count, shDegree, data } = frame;
        this.slot.take({ type: 'chunk', id: 'frame', replaces: [], lod: 0, shDegree, count, data });
        this.slot.complete = true;
      }
    } finally {
      this.isBusy = false;
    }
  }
}

export class Player {
  constructor(stage) {
    Object.assign(this, { stage, clips: [], time: 0, isPlaying: false, last: 0 });
    $('play').onclick = () => this.play(!this.isPlaying);
    $('time').oninput = () => {
      this.play(false);
      this.seek(Number($('time').value) / this.clips[0].sequence.fps);
    };
    addEventListener('keydown', (event) => {
      if (event.code !== 'Space' || !this.clips.length || event.target.closest?.('button, select, input:not(#time)')) return;
      event.preventDefault();
      this.play(!this.isPlaying);
    });
    requestAnimationFrame((now) => this.step(now));
  }

  /** Plays what a slot shows, until it shows something else. */
  async open(slot) {
    const { stop, source, name } = slot;
    try {
      const sequence = await clip(source, stop.signal);
      const opened = new Clip(slot, sequence);
      this.clips.push(opened);
      this.clips.sort((a, b) => a.slot.number - b.slot.number);
      stop.signal.addEventListener('abort', () => this.drop(opened));
      $('time').max = this.clips[0].sequence.frames - 1;
      $('player').hidden = false;
      document.body.classList.add('plays');
      this.seek(0);
      this.play(sequence.frames > 1 && !matchMedia('(prefers-reduced-motion: reduce)').matches);
    } catch (error) {
      if (!stop.signal.aborted) this.stage.say(`${name}: ${error.message}`);
    }
  }

  drop(gone) {
    gone.sequence.close();
    this.clips = this.clips.filter((clip) => clip !== gone);
    if (this.clips.length) return;
    this.play(false);
    $('player').hidden = true;
    document.body.classList.remove('plays');
  }

  play(isPlaying) {
    this.isPlaying = isPlaying;
    $('play').setAttribute('aria-label', isPlaying ? 'Pause' : 'Play');
    $('play').classList.toggle('playing', isPlaying);
  }

  /** Goes to a time, in seconds; behind the end it begins again. */
  seek(time) {
    const { fps, frames } = this.clips[0].sequence;
    this.time = time % (frames / fps);
    // Times of frames are not exact.
    const number = Math.min(Math.floor(this.time * fps + 1e-6), frames - 1);
    $('time').value = number;
    $('clock').textContent = `${(number / fps).toFixed(1)} / ${(frames / fps).toFixed(1)} s`;
    $('time').setAttribute('aria-valuetext', `Frame ${number + 1} of ${frames}`);
    for (const shown of this.clips) {
      const same = this.clips[0] === shown ? number : Math.floor(this.time * shown.sequence.fps + 1e-6);
      shown.show(same).catch((error) => this.fail(shown, error));
    }
  }

  fail({ slot }, error) {
    if (slot.stop.signal.aborted) return;
    this.play(false);
    this.stage.say(`${slot.name}: ${error.message}`);
  }

  step(now) {
    requestAnimationFrame((next) => this.step(next));
    const seconds = Math.min((now - this.last) / 1000, 0.25);
    this.last = now;
    if (this.isPlaying) this.seek(this.time + seconds);
  }
}
