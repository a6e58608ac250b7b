// Which chunks of a stream with levels of detail are drawn: near ones fine, distant ones coarse, and in all no more
// Gaussians than a budget has.

/** Gaussians that are so many pixels apart or less need no finer ones. */
const APART = 1;
/** What the camera does not see, or may see next, counts as if it were so much smaller. */
const UNSEEN = 1 / 8;

/** The chunks of a head as a tree: its roots are the coarsest level and what has no levels. */
export class Tree {
  constructor({ chunks, lods, lod }) {
    this.chunks = chunks;
    this.roots = [];
    this.parents = new Map();
    /** For each chunk: Gaussians of its parent that stand for it. Before the parent is there, about. */
    this.standIns = new Map();
    chunks.forEach(({ exact, lod: level, count, finer }, number) => {
      if (exact || level === lods - 1) this.roots.push(number);
      if (exact || level <= lod) return;
      for (const behind of finer) {
        this.parents.set(behind, number);
        this.standIns.set(behind, count / finer.length);
      }
    });
  }

  /** The chunks that a chunk stands for. */
  finer(number) {
    return this.chunks[number].finer.filter((behind) => this.parents.get(behind) === number);
  }

  /** Gaussians that are drawn more when a chunk is drawn in the place of what stands for it. */
  extra(number) {
    return this.chunks[number].count - (this.standIns.get(number) ?? 0);
  }

  /** How many pixels the Gaussians are apart that stand for a chunk. `pixels(bounds)` is how long a box looks, if it is seen. */
  apart(number, pixels) {
    const { length, seen } = pixels(this.chunks[number].bounds);
    return (length * (seen ? 1 : UNSEEN)) / Math.sqrt(Math.max(this.standIns.get(number), 1));
  }

  /** The chunks to draw, parents first, those that show most before others. */
  choose(pixels, budget) {
    const chosen = [...this.roots];
    let drawn = chosen.reduce((sum, number) => sum + this.chunks[number].count, 0);
    const open = [];
    const add = (parent) => open.push(...this.finer(parent).map((number) => ({ number, apart: this.apart(number, pixels) })));
    chosen.forEach(add);
    while (open.length) {
      const widest = open.reduce((best, { apart }, i) => (apart > open[best].apart ? i : best), 0);
      const [{ number, apart }] = open.splice(widest, 1);
      drawn += this.extra(number);
      if (apart <= APART || drawn > budget) break;
      chosen.push(number);
      add(number);
    }
    return chosen;
  }
}
