/* What the posterior believes in the rooms, read off a run (trainer_worker.js) for the two maps. */
"use strict";

const CELLS = 20, GRID = 11;

/* The radial bases that are not zero at a position, as [index, share]. */
function features(position) {
  const axes = position.map((at) => {
    const bases = Array.from({ length: GRID }, (_, i) => Math.exp(-4.5 * (at - i) ** 2));
    const total = bases.reduce((a, b) => a + b);
    return bases.map((b, i) => [i, b / total]).filter(([, share]) => share > 1e-7);
  });
  return axes[0].flatMap(([i, x]) => axes[1].map(([j, y]) => [i * GRID + j, x * y]));
}

/* Variance of a weighted sum of d weights from an index on, under the factor of their covariance. */
function varianceOf(factor, d, shares, from) {
  const along = new Float64Array(d);
  for (const [i, share] of shares) {
    const row = from + i, start = row * d;
    for (let j = 0; j <= row; j++) along[j] += share * factor[start + j];
  }
  return along.reduce((total, x) => total + x * x, 0);
}

/* Value of the posterior's mean, and the standard deviation of the best action's Q-value, in the
   cells of a grid, lowest row first. */
function mapsOf(run) {
  const parts = run.components(), value = new Float32Array(CELLS ** 2), deviation = new Float32Array(CELLS ** 2);
  for (let cell = 0; cell < CELLS ** 2; cell++) {
    const shares = features([cell % CELLS, Math.floor(cell / CELLS)].map((i) => (i + 0.5) / 2));
    const q = (w, action) => shares.reduce((t, [i, share]) => t + share * w[action * GRID ** 2 + i], 0);
    const values = [0, 1, 2, 3].map((a) => parts.reduce((t, part) => t + q(part.mean, a), 0) / parts.length);
    const top = Math.max(...values), best = values.indexOf(top);
    let variance = 0;
    for (const { mean, factor } of parts) {
      const own = varianceOf(factor, run.weights, shares, best * GRID ** 2);
      variance += (own + (q(mean, best) - top) ** 2) / parts.length;
    }
    value[cell] = top;
    deviation[cell] = Math.sqrt(variance);
  }
  return { value, deviation };
}

if (typeof module !== "undefined") module.exports = { features, mapsOf };
