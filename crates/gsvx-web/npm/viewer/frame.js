// Where a scene is best looked at from, as far as the means of its first chunk tell.

/** The value below which a share of the numbers lie. */
function quantile(sorted, share) {
  return sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
}

/** Centre and radius of what most Gaussians are in, from the words of the layout `packed`. */
export function bulk({ count, data }) {
  const words = new Float32Array(data.a.buffer);
  const step = Math.max(1, Math.floor(count / 4000));
  const columns = [[], [], []];
  for (let i = 0; i < count; i += step) for (let k = 0; k < 3; k += 1) columns[k].push(words[4 * i + k]);
  const points = columns[0].map((_, i) => columns.map((c) => c[i]));
  const centre = columns.map((c) => quantile(Float32Array.from(c).sort(), 0.5));
  const distances = Float32Array.from(points, (p) => Math.hypot(...p.map((v, k) => v - centre[k]))).sort();
  return { centre, radius: Math.max(quantile(distances, 0.7), 1e-3) };
}
