/* Runs of the page's kernel, one for each {family, components, task, indices, seed} in the argument;
   prints after so many iterations their learning returns, and of each component the mean and the
   diagonal of L. */
"use strict";

const { setup, pool, worker: { Run, decodePool } } = require("./given.js");

const module_ = new WebAssembly.Module(Buffer.from(setup.wasm, "base64"));
const sources = decodePool(pool, setup.scales), [runs, iterations] = JSON.parse(process.argv[2]);
console.log(JSON.stringify(runs.map(({ family, indices, ...told }) => {
  const base = setup.settings[family], chosen = { ...told, lambda: base.lambda_, psi: base.psi };
  const run = new Run(module_, setup, base, chosen, indices.map((i) => sources[i]));
  for (let i = 0; i < iterations; i++) run.advance();
  const parts = run.components(), d = setup.weights;
  const means = parts.map(({ mean }) => Array.from(mean));
  const diagonals = parts.map(({ factor }) => Array.from({ length: d }, (_, i) => factor[(d + 1) * i]));
  return [run.kernel.learning(), means, diagonals];
})));
