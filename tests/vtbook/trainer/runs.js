/* Runs of the page's kernel, one for each {family, doors, indices, seed} in the argument; prints after
   so many iterations their learning returns, means, and diagonals of L. */
"use strict";

const path = require("node:path");
const { Run, decodePool } = require(path.resolve(__dirname, "../../../book/_static/trainer_worker.js"));
const { setup, pool } = require("./given.js");

const module_ = new WebAssembly.Module(Buffer.from(setup.wasm, "base64"));
const sources = decodePool(pool, setup.scales), [runs, iterations] = JSON.parse(process.argv[2]);
console.log(JSON.stringify(runs.map(({ family, doors, indices, seed }) => {
  const base = setup.settings[family], chosen = { doors, seed, components: 1, lambda: base.lambda_, psi: base.psi };
  const run = new Run(module_, setup.fields, base, chosen, indices.map((i) => sources[i]));
  for (let i = 0; i < iterations; i++) run.advance();
  run.kernel.unpack(0);
  const L = run.floats("factors", 484 ** 2), diagonal = Array.from({ length: 484 }, (_, i) => L[485 * i]);
  return [run.kernel.learning(), Array.from(run.floats("means", 484)), diagonal];
})));
