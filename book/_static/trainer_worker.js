/* Trains in a thread of its own. The algorithm is the kernel's (book/vtlab/native), compiled for the page;
   here are the prior, what is read off a run, and the messages to and from the panel. */
"use strict";

const PLACES = ["settings", "means", "sources", "precision", "factors", "reached", "observation", "driver", "stage", "wheel"];
const BEGUN = 64, NORMAL = 1.349, RANDOM = 0.1; // as in vtlib/trust.py

/* Pool of sources (count x weights) from integers, each source with its own scale. */
function decodePool(integers, scales) {
  const d = integers.length / scales.length;
  return Array.from(scales, (scale, j) =>
    Float32Array.from(integers.subarray(j * d, (j + 1) * d), (x) => x * scale));
}

/* A function that gives another number in [0, 1) at each call. Source of the generator: mulberry32. */
function uniforms(seed) {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let x = Math.imul(state ^ (state >>> 15), 1 | state);
    x = (x + Math.imul(x ^ (x >>> 7), 61 | x)) ^ x;
    return ((x ^ (x >>> 14)) >>> 0) / 2 ** 32;
  };
}

/* Standard normal numbers from such a function. Source: Box and Muller (1958). */
const normals = (count, uniform) => Array.from({ length: count }, () =>
  Math.sqrt(-2 * Math.log(1 - uniform())) * Math.cos(2 * Math.PI * uniform()));

/* Distinct indices below size, drawn by a seed. */
function choose(size, count, seed) {
  const uniform = uniforms(seed), all = Array.from({ length: size }, (_, i) => i);
  return Array.from({ length: Math.min(count, size) },
    () => all.splice(Math.floor(uniform() * all.length), 1)[0]);
}

function meanOf(rows) {
  return rows[0].map((_, i) => rows.reduce((total, row) => total + row[i], 0) / rows.length);
}

/* Lower-triangular factor, in rows, of the matrix whose entries entry(i, j) gives. */
function cholesky(n, entry) {
  const L = new Float64Array(n * n);
  for (let i = 0; i < n; i++) {
    for (let j = 0; j <= i; j++) {
      let rest = entry(i, j);
      for (let k = 0; k < j; k++) rest -= L[i * n + k] * L[j * n + k];
      L[i * n + j] = i === j ? Math.sqrt(rest) : rest / L[j * n + j];
    }
  }
  return L;
}

/* The Gaussian prior of sources (eqs. 5.5, 5.6): its mean, the rows of W for its precision
   (I - W W^T) / jitter, and the factor of B B^T + variance I, where a posterior starts. */
function gaussianPrior(sources, jitter, variance, ddof) {
  const count = sources.length, freedom = Math.max(1, count - ddof);  // one source has no spread
  const mean = meanOf(sources.map((w) => Float64Array.from(w)));
  const B = sources.map((w) => mean.map((m, i) => (w[i] - m) / Math.sqrt(freedom)));
  const inner = (i, j) => B[i].reduce((total, b, k) => total + b * B[j][k], i === j ? jitter : 0);
  const R = cholesky(count, inner), W = [];
  for (let i = 0; i < count; i++) {
    W.push(B[i].map((b, k) => {
      for (let j = 0; j < i; j++) b -= R[i * count + j] * W[j][k];
      return b / R[i * count + i];
    }));
  }
  const covariance = (i, j) => B.reduce((total, b) => total + b[i] * b[j], i === j ? variance : 0);
  return { mean, W, factor: cholesky(mean.length, covariance) };
}

/* The recommended method's settings in the units of its sources (vtlib/units.py); eta is its curvature there. */
function inUnits({ alpha_mu, scale, deviation, eta }, sources) {
  const unit = Math.sqrt(averageOf(sources.map((w) => averageOf(w.map((x) => x * x)))));
  const narrow = deviation * unit;
  return { alpha_mu: alpha_mu * unit, scale: scale / unit, deviation: narrow, variance: narrow ** 2, weight: 1 / (eta * unit) };
}

/* One run in an instance of the kernel. setup: the kernel's fields in its order, how many weights and
   numbers of a state there are, and how far first weights spread; base: values of those fields, and the algorithm's name; chosen: {task,
   lambda, psi, components, seed}; sources: what is transferred. A learner (family 0) starts from their
   mean, or without any from weights of its own. */
class Run {
  constructor(module, { fields, weights, states, arrives, spread }, base, chosen, sources) {
    this.kernel = new WebAssembly.Instance(module).exports;
    Object.assign(this, { weights, states, arrives, spread, sources, row: Math.ceil(weights / 16) * 16 });
    this.last = [];
    this.steps = this.arrival = this.episodes = 0;
    this.learning = NaN;  // mean return of the last episodes, once one has ended
    this.base = base;
    this.settings = { ...base, ...(base.eta && inUnits(base, sources)) };
    if (base.init && !base.eta) Object.assign(this.settings, { lambda_: chosen.lambda, psi: chosen.psi });
    if (base.name === "MGVT") this.settings.components = chosen.components;
    this.hand(sources, uniforms(chosen.seed));
    const view = new DataView(this.kernel.memory.buffer), at = this.at("settings");
    fields.integers.forEach((name, i) => view.setInt32(at + 4 * i, this.settings[name] ?? 0, true));
    const numbers = at + 4 * fields.integers.length;
    fields.numbers.forEach((name, i) => view.setFloat32(numbers + 4 * i, this.settings[name] ?? 0, true));
    this.task = numbers + 4 * fields.numbers.length;
    this.setTask(chosen.task);
    this.kernel.begin_run(chosen.seed);
    if (base.eta) Object.assign(this, { record: new Record(sources.length), uniform: uniforms(~chosen.seed) });
    this.choose();
    this.path = [Array.from(this.floats("observation", states))];
  }

  floats(name, size, offset = 0) {
    return new Float32Array(this.kernel.memory.buffer, this.at(name) + 4 * offset, size);
  }

  at(name) {
    return this.kernel.place(PLACES.indexOf(name));
  }

  /* What the run begins with: means, prior and factors. */
  hand(sources, uniform) {
    const { settings, weights } = this;
    const rows = (name, list) => list.forEach((row, i) => this.floats(name, weights, i * this.row).set(row));
    if (!this.base.family) {
      const first = sources.length ? meanOf(sources) : normals(weights, uniform).map((x) => x * this.spread);
      return rows("means", [first]);
    }
    settings.sources = sources.length;
    if (this.base.name === "GVT") {
      const prior = gaussianPrior(sources, 1 / settings.scale, this.base.variance, this.base.ddof);
      rows("means", [prior.mean]);
      rows("sources", [prior.mean]);
      rows("precision", prior.W);
      return this.floats("factors", weights ** 2).set(prior.factor);
    }
    const starts = Array.from({ length: settings.components }, (_, c) =>
      this.base.init === "mean" ? meanOf(sources) : sources[c % sources.length]);
    rows("means", starts);
    rows("sources", settings.equal ? [meanOf(sources)] : sources);
    if (settings.equal) settings.sources = 1;  // only their mean matters
    const factors = this.floats("factors", starts.length * weights ** 2);
    for (let i = 0; i < factors.length; i++) {
      if (i % weights ** 2 % (weights + 1) === 0) factors[i] = Math.sqrt(settings.variance);
    }
  }

  /* Puts weights at the wheel; the most that they expect from here. */
  drive(weights) {
    const wheel = this.floats("wheel", 16 * this.weights);
    weights.forEach((w, i) => { wheel[16 * i] = w; });
    return this.kernel.promise();
  }

  /* Who plays the next episode: a source, or what is learned. */
  choose() {
    const { record, sources, uniform } = this;
    if (!record) return;
    const tops = sources.map((w) => this.drive(w)).sort((a, b) => a - b);
    const [low, promise, high] = [0.25, 0.5, 0.75].map((share) => {
      const at = share * (tops.length - 1), below = tops[Math.floor(at)];
      return below + (at % 1) * (tops[Math.ceil(at)] - below);
    });
    const arm = record.choose(this.steps >= BEGUN, uniform(), normals(sources.length, uniform));
    Object.assign(this, { promise, promised: (high - low) / NORMAL, driven: arm < sources.length });
    (this.turns ??= []).push([this.steps, arm]);
    if (this.driven) this.drive(sources[arm]);
  }

  setTask(numbers) {
    new Float32Array(this.kernel.memory.buffer, this.task, numbers.length).set(numbers);
  }

  advance() {
    const astray = this.record && !this.driven && this.record.lost() && this.uniform() < RANDOM;
    if (astray) this.drive(normals(this.weights, this.uniform));  // whose favourite action is any
    const ended = this.kernel.iterate_run(Boolean(this.driven || astray));
    this.steps++;
    this.path.push(Array.from(this.floats("reached", this.states)));
    if (ended === this.arrives) this.arrival ||= this.steps;
    if (!ended) return;
    this.episodes++;
    this.learning = this.kernel.learning();
    this.record?.add(this.kernel.earned(), this.promise, this.promised);
    this.choose();
    this.last = this.path;
    this.path = [Array.from(this.floats("observation", this.states))];
  }

  /* Of each component the mean and, in rows, the factor of the covariance. */
  components() {
    const d = this.weights;
    return Array.from({ length: this.settings.components }, (_, c) => {
      this.kernel.unpack(c);
      return { mean: this.floats("means", d, c * this.row), factor: this.floats("factors", d ** 2, c * d ** 2) };
    });
  }

  /* Weights to drive with: the mean of what was learned, a draw from it, what was transferred, and its mean. */
  drivers() {
    const parts = this.components(), { mean, factor } = parts[Math.floor(Math.random() * parts.length)];
    const d = this.weights, z = normals(d, Math.random);
    const draw = mean.map((m, i) => {
      for (let j = 0; j <= i; j++) m += factor[i * d + j] * z[j];
      return m;
    });
    return { learned: meanOf(parts.map((part) => part.mean)), draw, mean: meanOf(this.sources), sources: this.sources };
  }
}

/* Of each learner, over its curves from several seeds, the mean, least and most at each record; of what was
   not measured in all of them there is none. */
function bandsOf(trainings) {
  const over = (name, what) => trainings[0][name].map((_, i) => what(trainings.map((curves) => curves[name][i])));
  return Object.fromEntries(Object.keys(trainings[0]).map((name) => [name, {
    mean: over(name, (x) => x.reduce((total, y) => total + y, 0) / x.length),
    least: over(name, (x) => Math.min(...x)), most: over(name, (x) => Math.max(...x)),
  }]));
}

/* The runs that a panel watches, on one task from one seed, in slices of time between its commands:
   chosen (begin anew with these numbers), task (from now on), rate (iterations a second;
   0 to pause), steps (so many, at once), seeds (so many trainings, one after the other). After each, and along the way, it is told where the runs are. */
class Training {
  constructor({ wasm, pool, scales, setup }, tell) {
    Object.assign(this, { setup, tell, rate: 0, looked: 0, told: 0 });
    this.module = new WebAssembly.Module(wasm);
    this.pool = decodePool(pool, scales);
  }

  command({ chosen, task, rate, steps, calm, drivers, seeds = 1 }) {
    if (chosen) {
      Object.assign(this, { left: seeds, finished: [] });
      this.chosen = chosen;
      this.runs = null;  // made when needed: a dragged slider asks for many that nobody waits for
    }
    if (task) {
      this.chosen = { ...this.chosen, task };
      Object.values(this.runs ?? {}).forEach((run) => run.setTask(task));
    }
    if (rate !== undefined) this.pace(rate, calm);
    if (steps) this.advance(steps);
    if (drivers) {
      if (!this.runs) this.make();
      return this.tell({ drivers: this.runs.transfer.drivers() });
    }
    this.waiting ??= setTimeout(() => this.tick(), 0);
  }

  /* From here on so many iterations a second, and these are counted. */
  pace(rate, calm) {
    const now = performance.now();
    Object.assign(this, { rate, calm, owed: 0, before: now, since: now, done: 0 });
  }

  make() {
    const { chosen, pool, setup } = this, size = pool.length / setup.pools;
    const given = choose(size, chosen.sources, chosen.seed).map((i) => pool[chosen.pool * size + i]);
    const run = (name, what) => new Run(this.module, setup, setup.settings[name], chosen, what);
    this.runs = { transfer: run(chosen.family, given) };
    if (chosen.fine) this.runs.fine = run("fine", given);
    if (chosen.none) this.runs.none = run("NT", []);
    this.curves = Object.fromEntries(Object.keys(this.runs).map((name) => [name, []]));
    this.speed = 0;
  }

  /* So many iterations, or as many as there are milliseconds for. */
  advance(count, milliseconds = Infinity) {
    if (!this.runs) this.make();
    const { every, iterations } = this.setup, { transfer } = this.runs, start = performance.now();
    let done = 0;
    for (; done < count && transfer.steps < iterations && performance.now() - start < milliseconds; done++) {
      for (const [name, run] of Object.entries(this.runs)) {
        run.advance();
        if (run.steps % every === 0) this.curves[name].push(run.learning);
      }
    }
    if (transfer.steps >= iterations && this.rate) this.finish();
    return done;
  }

  /* The next seed, where several are asked for. */
  finish() {
    this.finished.push(this.curves);
    this.left--;
    if (this.left < 1) this.rate = 0;
    else this.chosen = { ...this.chosen, seed: this.chosen.seed + 1 };
    if (this.rate) this.make();
  }

  tick() {
    const now = performance.now();
    this.waiting = null;
    if (!this.runs) this.make();
    if (this.rate) {
      this.owed += (this.rate * (now - this.before)) / 1000;
      this.before = now;
      const done = this.advance(Math.floor(this.owed), 30);
      this.owed = Math.min(this.owed - done, this.rate);
      this.done += done;
      this.speed = (1000 * this.done) / (performance.now() - this.since);
    }
    this.report();
    if (this.rate) this.waiting ??= setTimeout(() => this.tick(), this.rate < 1000 ? 30 : 0);
  }

  report() {
    const { transfer } = this.runs, now = performance.now(), running = this.rate > 0;
    if (running && this.calm && Math.floor(transfer.steps / 500) === this.told) return;
    this.told = Math.floor(transfer.steps / 500);
    const look = !running || now - this.looked > 250;
    if (look) this.looked = now;
    this.tell({
      running, iteration: transfer.steps, episodes: transfer.episodes, arrival: transfer.arrival,
      path: transfer.path, last: transfer.last, curves: this.curves, speed: this.speed,
      seeds: this.finished.length, bands: this.finished.length > 1 && bandsOf(this.finished),
      plays: transfer.record && { turns: transfer.turns, count: transfer.record.count, trust: transfer.record.trust },
      learning: Object.fromEntries(Object.entries(this.runs).map(([k, r]) => [k, r.learning])),
      ...(look && { maps: typeof mapsOf === "function" && mapsOf(transfer) }),
    });
  }
}

if (typeof WorkerGlobalScope !== "undefined") {
  let training, turn;  // of the last command: a panel need not look at what was reported before it
  onmessage = ({ data }) => {
    training ??= new Training(data, (report) => postMessage({ ...report, turn }));
    turn = data.turn;
    training.command(data);
  };
}
