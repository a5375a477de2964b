/* The parts of the page's trainer that need no page: node --test tests/vtbook/trainer/parts.test.js */
"use strict";

const assert = require("node:assert/strict");
const test = require("node:test");

const { panel, worker, setup, pool } = require("./given.js");
const wasm = Buffer.from(setup.wasm, "base64");

const close = (a, b, within = 1e-6) => assert.ok(Math.abs(a - b) <= within, `${a} is not ${b}`);
const sources = worker.decodePool(pool, setup.scales);
const chosen = panel.chosen({ family: "MGVT", power: -6, psi: 0.5, components: 1, sources: 10, seed: 1, pool: 0, task: [2, 8, 2] });
const run = (changes = {}, given = sources.slice(0, 3)) => {
  const choice = { ...chosen, ...changes };
  const module = new WebAssembly.Module(wasm);
  return new worker.Run(module, setup, setup.settings[choice.family], choice, given);
};
const means = (one, steps) => {
  for (let i = 0; i < steps; i++) one.advance();
  return [...one.floats("means", 484)];
};

test("the kernel gets numbers, a Gaussian one component, and every seed is one", () => {
  const told = { family: "MGVT", power: "-1", psi: "0.25", components: "3", sources: "2", pool: "1", seed: "7", task: [5, 9.5, 2] };
  assert.deepEqual(panel.chosen({ ...told, fine: true, none: false }), {
    family: "MGVT", lambda: 0.1, psi: 0.25, components: 3, sources: 2, pool: 1, seed: 7, task: [5, 9.5, 2], fine: true, none: false,
  });
  assert.equal(panel.chosen({ ...told, family: "GVT" }).components, 1);
  for (const [seed, held] of [["", 0], ["x", 0], [-3, 0], [1e9, 9999], [2.4, 2]]) assert.equal(panel.chosen({ ...told, seed }).seed, held);
});

test("doors are held to where they can be", () => {
  for (const [door, place] of [[3.14159, 3.1], [-1e9, 0.5], [1e9, 9.5], [0.2, 0.5], [7.25, 7.3]]) assert.equal(panel.held(door), place);
});

test("keys move a door within its range, and numbers, colours and walls are as drawn", () => {
  assert.equal(panel.moved(5, "ArrowLeft"), 4.9);
  assert.equal(panel.moved(9.5, "PageUp"), 9.5);
  assert.equal(panel.moved(5, "Home"), 0.5);
  assert.equal(panel.moved(5, "End"), 9.5);
  assert.equal(panel.moved(5, "Tab"), undefined);
  assert.equal(panel.scientific(-6), "10⁻⁶");
  assert.equal(panel.scientific(-4.5), "3.2 · 10⁻⁵");
  assert.equal(panel.weightOf(1e-6, { scale: 1e5 }), "0.1");
  assert.notEqual(panel.colour(0), panel.colour(1));
  const shares = [1e-5, 1e-3, 1, 3].map((x) => panel.shareOf("deviation", x));
  shares.forEach((share, i) => close(share, [0, 0, 1, 1][i]));
  close(panel.shareOf("deviation", 10 ** -1.5), 0.5);
  assert.deepEqual(panel.wallsOf(1), [5]);
});

test("the least place of lambda is 0, and the next 1e-8", () => {
  const least = -8.1;
  assert.equal(panel.lambdaOf(least), 0);
  assert.equal(panel.scientific(least), "0");
  close(panel.lambdaOf(-8), 1e-8, 1e-20);
  assert.equal(panel.scientific(-8), "10⁻⁸");
  for (const power of [-6, -3]) close(panel.lambdaOf(power), 10 ** power, 1e-12);
});

test("a run with a lambda of 0 trains, and unlike one with a larger", () => {
  for (const family of ["MGVT", "GVT"]) {
    const free = run({ family, lambda: 0 }), start = means(free, 0), after = means(free, 100);
    assert.ok(after.every(Number.isFinite));
    assert.notDeepEqual(after, start);
    assert.notDeepEqual(means(run({ family, lambda: 0.1 }), 100), after);
  }
});

test("the recommended method remembers 64 steps, and then takes eight of Adam's each, in units of its sources", () => {
  const given = sources.slice(0, 3), one = run({ family: "Trust", components: 1 }, given), start = means(one, 0);
  const unit = Math.sqrt(given.flatMap((w) => [...w]).reduce((total, x) => total + x * x, 0) / (3 * start.length));
  assert.deepEqual(means(one, 64), start);
  const most = Math.max(...means(one, 1).map((w, i) => Math.abs(w - start[i]))) / (0.002 * unit);
  assert.ok(most > 6 && most < 8.01, `${most} steps`);
});

test("sources are drawn by the seed, each at most once", () => {
  const drawn = worker.choose(50, 10, 7);
  assert.deepEqual(drawn, worker.choose(50, 10, 7));
  assert.notDeepEqual(drawn, worker.choose(50, 10, 8));
  assert.equal(new Set(drawn).size, 10);
  assert.ok(drawn.every((i) => i >= 0 && i < 50));
  assert.equal(worker.choose(3, 10, 1).length, 3);
});

test("the precision of the Gaussian prior is the inverse of the covariance that L L' makes", () => {
  const jitter = 1e-4, few = sources.slice(0, 4), d = few[0].length;
  const { mean, W, factor } = worker.gaussianPrior(few, jitter, jitter, 0);
  close(mean[100], few.reduce((total, w) => total + w[100] / 4, 0));
  const x = Float64Array.from({ length: d }, (_, i) => Math.sin(i));
  const down = x.map((_, j) => x.reduce((t, v, i) => t + (i >= j ? factor[i * d + j] * v : 0), 0));
  const up = x.map((_, i) => down.reduce((t, v, j) => t + (j <= i ? factor[i * d + j] * v : 0), 0));
  const along = W.map((w) => w.reduce((t, v, i) => t + v * up[i], 0));
  up.forEach((v, i) => close((v - W.reduce((t, w, j) => t + w[i] * along[j], 0)) / jitter, x[i], 1e-5));
});

test("a seed gives one run, another another, and doors move while what was learned stays", () => {
  const one = run({ seed: 3 }), before = means(one, 100);
  assert.deepEqual(means(run({ seed: 3 }), 100), before);
  assert.notDeepEqual(means(run({ seed: 4 }), 100), before);
  one.setTask([9, 1, 2]);
  assert.deepEqual(means(one, 0), before);
  assert.notDeepEqual(means(one, 100), before);
});

test("there is no return before an episode has ended, and a curve begins with the first", () => {
  const training = new worker.Training({ wasm, pool, scales: setup.scales, setup }, () => {});
  training.chosen = { ...chosen, none: true };
  training.make();
  const { none } = training.runs;
  while (!none.episodes) {
    assert.ok(Number.isNaN(none.learning));
    training.advance(1);
  }
  assert.equal(none.learning, none.kernel.learning());
  const unmeasured = Math.ceil(none.steps / setup.every) - 1;
  assert.ok(unmeasured > 0);
  training.advance(setup.every);
  assert.equal(training.curves.none.filter(Number.isNaN).length, unmeasured);
  assert.ok(!Number.isNaN(training.curves.none[unmeasured]));
});

test("the noise of the motion is normal with deviation 0.2", () => {
  const noise = [], one = run({ family: "NT" }, []);
  for (let i = 0; i < 20000; i++) {
    one.advance();
    const ended = one.path.length === 1, walk = ended ? one.last : one.path;
    const [from, to] = walk.slice(-2), off = to.map((x, k) => x - from[k]);
    const inside = [...from, ...to].every((x) => x > 0.8 && x < 9.2);
    if (inside && (off[0] || off[1])) noise.push(Math.abs(off[0]) < Math.abs(off[1]) ? off[0] : off[1]);
  }
  const moment = (k) => noise.reduce((total, x) => total + (x / 0.2) ** k, 0) / noise.length;
  assert.ok(noise.length > 1000, `${noise.length} steps inside`);
  close(moment(1), 0, 4 / Math.sqrt(noise.length));
  close(moment(2), 1, 4 * Math.sqrt(2 / noise.length));
  close(moment(4), 3, 4 * Math.sqrt(96 / noise.length));
});

test("the maps begin as the prior: the source's values, and its narrow deviation", () => {
  const { value, deviation } = worker.mapsOf(run({}, [sources[0]]));
  assert.ok(Math.max(...value) > 0.5 && Math.max(...value) < 2);
  const variance = setup.settings.MGVT.variance;
  for (const [cell, position] of [[0, [0.25, 0.25]], [399, [9.75, 9.75]]]) {
    const shares = worker.features(position).map(([, share]) => share);
    close(shares.reduce((total, x) => total + x, 0), 1);  // radial bases sum to one
    close(deviation[cell], Math.sqrt(variance * shares.reduce((total, x) => total + x ** 2, 0)), 1e-6);
  }
});

test("trainings from several seeds follow one another, and have a band", () => {
  const told = [], training = new worker.Training({ wasm, pool, scales: setup.scales, setup: { ...setup, iterations: 50, every: 25 } }, (x) => told.push(x));
  Object.assign(training, { chosen, left: 2, finished: [], rate: 1 });
  training.advance(50);
  assert.deepEqual([training.rate, training.chosen.seed, training.runs.transfer.steps], [1, chosen.seed + 1, 0]);
  training.advance(50);
  assert.deepEqual([training.rate, training.finished.length], [0, 2]);
  const { mean, least, most } = worker.bandsOf([{ transfer: [1, NaN] }, { transfer: [3, 4] }]).transfer;
  assert.deepEqual([mean, least, most], [[2, NaN], [1, NaN], [3, NaN]]);
});
