/* A corridor of ten cells: draw a value function, act on it, and keep what fits. */
"use strict";

(function () {
  const PAUSE = 280; // milliseconds that a step of the agent is shown

  /* Mean and covariance of the old value functions; where links are none, the mean and one variance. */
  function prior({ old, jitter, links = true }) {
    const each = old[0].map((_, i) => i), sum = (f) => old.reduce((all, one) => all + f(one), 0);
    const mean = each.map((i) => sum((one) => one[i]) / old.length);
    const spread = (i, j) => (links ? sum((one) => (one[i] - mean[i]) * (one[j] - mean[j])) : 0);
    const covariance = each.map((i) =>
      each.map((j) => spread(i, j) / (old.length - 1) + (i === j ? jitter : 0)),
    );
    return { mean, covariance };
  }

  const neighbours = (cell, count) => [cell - 1, cell + 1].filter((one) => one >= 0 && one < count);

  /* TD targets of all cells: 1 at the treasure, elsewhere the discounted better neighbour. */
  function targets(mean, { treasure, discount }) {
    const better = (i) => Math.max(...neighbours(i, mean.length).map((j) => mean[j]));
    return mean.map((_, i) => (i === treasure ? 1 : discount * better(i)));
  }

  /* Bayes' rule for one noisy observation of one cell's value. */
  function observe({ mean, covariance }, cell, target, noise) {
    const row = covariance[cell], gain = row.map((one) => one / (row[cell] + noise ** 2));
    return {
      mean: mean.map((one, i) => one + gain[i] * (target - mean[cell])),
      covariance: covariance.map((line, i) => line.map((one, j) => one - gain[i] * row[j])),
    };
  }

  /* The belief after visits of some cells; targets are computed again until they settle. */
  function posterior(before, seen, setup) {
    let belief = before;
    for (let sweep = 0; sweep < setup.sweeps; sweep++) {
      const aims = targets(belief.mean, setup);
      const add = (old, cell) => observe(old, cell, aims[cell], setup.noise);
      belief = seen.reduce(add, before);
    }
    return belief;
  }

  /* Standard normal numbers. */
  const normal = () => Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());

  /* One value function: the mean plus a Cholesky factor times independent noise. */
  function drawn({ mean, covariance }, noise = mean.map(normal)) {
    const factor = mean.map(() => []);
    return mean.map((centre, i) => {
      for (let j = 0; j <= i; j++) {
        let rest = covariance[i][j];
        for (let k = 0; k < j; k++) rest -= factor[i][k] * factor[j][k];
        factor[i][j] = i === j ? Math.sqrt(Math.max(rest, 1e-12)) : rest / factor[j][j];
      }
      return factor[i].reduce((all, one, j) => all + one * noise[j], centre);
    });
  }

  /* The cells from the start to the peak, or to a treasure on the way. */
  function walk(values, { start, treasure }) {
    const cells = [start], peak = values.indexOf(Math.max(...values));
    while (cells.at(-1) !== treasure && cells.at(-1) !== peak) cells.push(cells.at(-1) + Math.sign(peak - cells.at(-1)));
    return cells;
  }

  if (typeof module !== "undefined") {
    module.exports = { drawn, posterior, prior, walk };
    return;
  }

  const X = (cell) => 21 + 42 * cell, Y = (value) => 150 - 100 * value;

  class Corridor {
    constructor(root) {
      this.root = root;
      this.linked = JSON.parse(root.querySelector("script").textContent);
      this.svg = root.querySelector("svg");
      this.box = root.querySelector("input");
      this.box.addEventListener("change", () => this.again());
      root.querySelectorAll("button").forEach((one) => one.addEventListener("click", () => this[one.value]()));
      root.hidden = false;
      this.again();
    }

    again() {
      clearTimeout(this.timer);
      Object.assign(this, { seen: [], fresh: [], values: null, shown: 0, found: false, rounds: 0 });
      this.setup = this.box.checked ? { ...this.linked, ...this.linked.narrow, links: false } : this.linked;
      this.before = this.belief = prior(this.setup);
      this.say("Ten tasks are solved. Where the treasure lies now, nobody has told the agent.", "draw");
    }

    draw() {
      this.arrive();
      if (this.fresh.length) return this.say("First update: the walk has not been learned from yet.", "update");
      // the first sample leads left, away from the treasure, as half of all do
      do this.values = drawn(this.belief);
      while (!this.rounds && !(walk(this.values, this.setup).at(-1) < this.setup.start));
      this.shown = 0;
      const like = this.box.checked ? "the mean, as every draw does here" : "an old one";
      this.say(`One value function that the belief holds possible. It looks much like ${like}.`, "act");
    }

    act() {
      if (this.fresh.length) return this.arrive();
      if (!this.values) return this.say("First draw a value function to act on.", "draw");
      this.fresh = walk(this.values, this.setup);
      this.found = this.fresh.at(-1) === this.setup.treasure;
      this.rounds += 1;
      this.step();
    }

    /* One more step of the walk, and a pause, but for those who want no motion. */
    step() {
      this.shown += 1;
      if (matchMedia("(prefers-reduced-motion: reduce)").matches) this.shown = this.fresh.length;
      if (this.shown >= this.fresh.length) return this.arrive();
      this.say("The agent walks to the peak of what it has drawn.", "act");
      this.timer = setTimeout(() => this.step(), PAUSE);
    }

    arrive() {
      clearTimeout(this.timer);
      if (!this.fresh.length) return;
      this.shown = this.fresh.length;
      const end = this.found ? "the treasure is found" : "here is the peak of the draw, and no treasure";
      this.say(`Round ${this.rounds}: ${end}.`, "update");
    }

    update() {
      this.arrive();
      if (!this.fresh.length) return this.say("First act: without a walk there is nothing to learn.", this.values ? "act" : "draw");
      this.seen.push(...this.fresh);
      this.belief = posterior(this.before, this.seen, this.setup);
      Object.assign(this, { fresh: [], values: null });
      const learned = this.box.checked
        ? "Values have changed where the agent has been, and nowhere else: what fails on the left says nothing about the right."
        : "The band is narrow where the agent has been, and wider elsewhere. Shapes that do not fit have become unlikely.";
      if (!this.found) return this.say(learned, "draw");
      this.say(`The treasure was found in round ${this.rounds}, and the belief knows the way. Start again, with the box ticked or without.`, "again");
    }

    say(words, next) {
      this.root.querySelector(".said").textContent = words;
      for (const one of this.root.querySelectorAll("button")) {
        one.classList.toggle("next", one.value === next);
        one.disabled = next === "again" && one.value !== next;
      }
      this.picture();
    }

    picture() {
      const { old, colours, treasure, start } = this.setup, { mean, covariance } = this.belief;
      const line = (values, style) =>
        `<polyline points="${values.map((one, i) => `${X(i)},${Y(one)}`).join(" ")}" style="${style}"/>`;
      const width = mean.map((_, i) => 2 * Math.sqrt(covariance[i][i]));
      const edge = (side) => mean.map((one, i) => `${X(i)},${Y(one + side * width[i])}`);
      const visited = new Set([...this.seen, ...this.fresh.slice(0, this.shown)]);
      const agent = this.fresh.length && this.shown ? this.fresh[this.shown - 1] : start;
      const cell = (_, i) =>
        `<rect x="${X(i) - 20}" y="206" width="40" height="34" style="fill:${visited.has(i) ? `${colours.draw}44` : "none"};stroke:currentColor"/>` +
        `<text x="${X(i)}" y="256">${i + 1}</text>` +
        (i === treasure ? `<text x="${X(i) + 11}" y="229" style="font-size:18px">★</text>` : "");
      this.svg.innerHTML =
        `<polygon points="${[...edge(1), ...edge(-1).reverse()].join(" ")}" style="fill:${colours.belief};opacity:0.35"/>` +
        old.map((one) => line(one, "stroke-width:1;opacity:0.35")).join("") +
        line(mean, `stroke:${colours.belief};stroke-width:1.5`) +
        (this.values ? line(this.values, `stroke:${colours.draw};stroke-width:4`) : "") +
        mean.map(cell).join("") +
        `<circle cx="${X(agent)}" cy="223" r="8" style="fill:${colours.draw}"/>`;
    }
  }

  for (const root of document.querySelectorAll(".corridor[hidden]")) new Corridor(root);
})();
