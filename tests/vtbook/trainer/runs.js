/* Runs of the page's kernel, one for each {family, doors, indices, seed} in the argument; prints their
   learning returns after so many iterations. */
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
  return run.kernel.learning();
})));
