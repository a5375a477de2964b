/* Stages that are driven, and their runs: node --test tests/vtbook/trainer/driven.test.js */
"use strict";

const assert = require("node:assert/strict");
const test = require("node:test");

const { panel, worker, setup, pool } = require("./given.js");
const { STAGE } = panel, sources = worker.decodePool(pool, setup.scales);
const module_ = new WebAssembly.Module(Buffer.from(setup.wasm, "base64"));
const chosen = panel.chosen({ family: "MGVT", power: Math.log10(setup.settings.MGVT.lambda_), psi: 0.5, components: 1, seed: 1, task: [...setup.task, ...STAGE.shared] });
const run = (family, given, changes = {}) =>
  new worker.Run(module_, setup, setup.settings[family], { ...chosen, ...changes }, given);

/* One episode on the stage: weights drive, or the actions that a function of the time gives. */
function drive(weights, action = () => -1) {
  const { kernel } = run("MGVT", sources.slice(0, 2)), path = [];
  const floats = (place, count) => new Float32Array(kernel.memory.buffer, kernel.place(place), count);
  weights?.forEach((w, i) => { floats(7, 16 * weights.length)[16 * i] = w; });
  floats(8, STAGE.states).set(STAGE.start);
  for (let time = 0; time < STAGE.horizon; time++) {
    const over = kernel.step_stage(action(time)) >> 8;
    path.push([...floats(8, STAGE.states)]);
    if (over) break;
  }
  return path;
}

test("an idle hand does what the stage says", () => {
  assert.equal(panel.byHand(undefined, 4), STAGE.idle(4));
  assert.equal(panel.byHand(0, 4), 0);
});

test("every episode begins and ends as the stage says", () => {
  for (const [family, given] of [["MGVT", sources.slice(0, 3)], ["GVT", sources.slice(0, 3)], ["NT", []]]) {
    const one = run(family, given);
    while (one.episodes < 2) one.advance();
    assert.ok(one.last.length <= STAGE.horizon + 1);
    assert.equal(one.last[0].length, STAGE.states);
    assert.ok(one.learning >= setup.limits[0] && one.learning <= setup.limits[1]);
    assert.ok([...one.floats("means", setup.weights)].every(Number.isFinite));
  }
});

test("sources drive better than networks that nobody has taught", () => {
  const lengths = (each) => each.map((w) => drive(w).length).sort((a, b) => a - b)[Math.floor(each.length / 2)];
  const blank = Array.from({ length: 9 }, (_, i) => run("NT", [], { seed: i }).floats("means", setup.weights));
  const [taught, untaught] = [lengths(sources.slice(0, 9)), lengths(blank)];
  assert.ok(STAGE.reward * (taught - untaught) > 20, `${taught} steps against ${untaught}`);
});

test("a reader's actions move the scene, and a new task moves it otherwise", () => {
  const left = drive(null, () => 0), right = drive(null, () => STAGE.keys.ArrowRight);
  assert.ok(left[3][1] < right[3][1]); // velocities
});

test("who may be put at the wheel", () => {
  const one = run("MGVT", sources.slice(0, 3)), { learned, draw, mean, sources: own } = one.drivers();
  assert.equal(own.length, 3);
  learned.forEach((x, i) => assert.ok(Math.abs(x - mean[i]) < 1e-5)); // where the run begins
  const apart = Math.hypot(...draw.map((x, i) => x - learned[i])) / Math.sqrt(setup.weights);
  const deviation = Math.sqrt(setup.settings.MGVT.variance);
  assert.ok(apart > 0.8 * deviation && apart < 1.2 * deviation);
});
