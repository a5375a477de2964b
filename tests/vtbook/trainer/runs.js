/* Runs of the page's kernel, one for each {family, components, doors, indices, seed} in the argument;
   prints after so many iterations their learning returns, and of each component the mean and the
   diagonal of L. */
"use strict";

const path = require("node:path");
const { Run, decodePool } = require(path.resolve(__dirname, "../../../book/_static/trainer_worker.js"));
const { setup, pool } = require("./given.js");

const module_ = new WebAssembly.Module(Buffer.from(setup.wasm, "base64"));
const sources = decodePool(pool, setup.scales), [runs, iterations] = JSON.parse(process.argv[2]);
console.log(JSON.stringify(runs.map(({ family, indices, ...told }) => {
  const base = setup.settings[family], chosen = { ...told, lambda: base.lambda_, psi: base.psi };
  const run = new Run(module_, setup.fields, base, chosen, indices.map((i) => sources[i]));
  for (let i = 0; i < iterations; i++) run.advance();
  const components = Array.from({ length: told.components }, (_, c) => c);
  components.forEach((c) => run.kernel.unpack(c));
  const means = components.map((c) => Array.from(run.floats("means", 484, 496 * c)));
  const diagonals = components.map((c) => {
    const L = run.floats("factors", 484 ** 2, 484 ** 2 * c);
    return Array.from({ length: 484 }, (_, i) => L[485 * i]);
  });
  return [run.kernel.learning(), means, diagonals];
})));
