/* The panel of "Train it here": a reader trains the method in the page, in a thread beside it. What trains
   and moves is a STAGE, whose script stands before this. */
"use strict";

/* What a reader may choose: least, most, step and start of each number. */
const RANGES = {
  power: [-8.1, -1, 0.1, -6], // of ten; the least stands for a lambda of 0
  psi: [0, 1, 0.01, 0.5],
  components: [1, 3, 1, 1],
  sources: [1, 10, 1, 10],
  seed: [0, 9999, 1, 1],
  ...STAGE.ranges,
};
const LIVE = { transfer: "this run", fine: "fine-tuning", none: "no transfer" };

/* A number held to its range and step; what is no number becomes the start. */
function clamp(name, value) {
  const [least, most, step, start] = RANGES[name];
  const number = value === "" || value === null ? NaN : Number(value);
  if (Number.isNaN(number)) return start;
  const held = Math.min(most, Math.max(least, number));
  return Number((Math.round((held - least) / step) * step + least).toFixed(6));
}

const lambdaOf = (power) => (power > RANGES.power[0] ? 10 ** power : 0);

/* What the kernel is asked for, whatever the controls hold. */
function chosen(raw) {
  const family = raw.family === "GVT" ? "GVT" : "MGVT";
  return {
    family,
    lambda: lambdaOf(clamp("power", raw.power)),
    psi: clamp("psi", raw.psi),
    components: family === "GVT" ? 1 : clamp("components", raw.components),
    sources: clamp("sources", raw.sources),
    seed: clamp("seed", raw.seed),
    task: raw.task,
    fine: Boolean(raw.fine),
    none: Boolean(raw.none),
  };
}

/* Lambda as a reader writes it: 3.2 · 10⁻⁵, or 0. */
function scientific(power) {
  if (!lambdaOf(power)) return "0";
  const whole = Math.floor(power + 1e-9), digit = (10 ** (power - whole)).toFixed(1);
  const raised = String(whole).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)]);
  return `${digit === "1.0" ? "" : `${digit} · `}10${raised}`;
}

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const grouped = (number) => Math.round(number).toLocaleString("en");
const measured = (y) => (Number.isNaN(y) ? "(no episode yet)" : y.toFixed(STAGE.digits).replace("-", "−"));
const points = (pairs) => pairs.map((pair) => pair.map((x) => x.toFixed(2)).join()).join(" ");

function draw(parent, kind, attributes, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
  element.textContent = text;
  return parent.appendChild(element);
}

/* Learning return over iterations: stored curves, and over them those of this run. */
class Chart {
  constructor(svg, setup) {
    const [left, right, top, bottom] = [34, 372, 22, 200];
    const [axes, old, marks] = [".axes", ".references", ".marks"].map((part) => svg.querySelector(part));
    Object.assign(this, { svg, setup, top, bottom, marks });
    this.across = (t) => left + ((right - left) * t) / setup.iterations;
    const [least, most] = STAGE.limits;
    this.down = (y) => bottom - ((bottom - top) * (Math.min(most, Math.max(least, y)) - least)) / (most - least);
    for (const y of STAGE.ticks) {
      draw(axes, "line", { x1: left, x2: right, y1: this.down(y), y2: this.down(y) });
      draw(axes, "text", { x: left - 6, y: this.down(y) + 4, "text-anchor": "end" }, y.toFixed(STAGE.tenths).replace("-", "−"));
    }
    for (let t = 0; t <= setup.iterations; t += setup.iterations / 5) {
      const anchor = t === setup.iterations ? "end" : "middle";
      draw(axes, "text", { x: this.across(t), y: bottom + 15, "text-anchor": anchor }, grouped(t));
    }
    for (const one of setup.references) {
      const line = draw(old, "polyline", { class: one.family ?? "", style: `--own: ${one.colour}` });
      this.trace(line, one.iterations, one.values);
    }
  }

  /* A value that is not a number was not measured, and is not drawn. */
  trace(line, places, values) {
    const drawn = values.map((y, i) => [this.across(places[i]), this.down(y)]);
    line.setAttribute("points", points(drawn.filter(([, y]) => !Number.isNaN(y))));
  }

  mark(iteration) {
    const x = this.across(iteration), last = this.marks.lastElementChild;
    if (last && Number(last.getAttribute("x1")) === x) return;
    draw(this.marks, "line", { x1: x, x2: x, y1: this.top, y2: this.bottom });
  }

  show({ curves, learning, iteration, bands }) {
    for (const name of Object.keys(LIVE)) {
      const values = [...(curves[name] ?? []), learning[name]];
      const places = values.map((_, i) => Math.min((i + 1) * this.setup.every, iteration));
      this.trace(this.svg.querySelector(`.run.${name}`), places, values);
    }
    for (const name of Object.keys(LIVE)) {
      const { mean = [], least = [], most = [] } = bands[name] ?? {}, at = mean.map((_, i) => (i + 1) * this.setup.every);
      this.trace(this.svg.querySelector(`.mean.${name}`), at, mean);
      this.trace(this.svg.querySelector(`.band.${name}`), [...at, ...[...at].reverse()], [...most, ...least.reverse()]);
    }
    this.svg.classList.toggle("many", Boolean(bands));
    const said = Object.entries(learning).map(([name, y]) => `${LIVE[name]} ${measured(y)}`).join(", ");
    this.svg.setAttribute("aria-label", `Learning return after ${grouped(iteration)} iterations: ${said}`);
  }
}

class Panel {
  constructor(root) {
    this.root = root;
    this.setup = JSON.parse(root.querySelector("script[type='application/json']").textContent);
    const { start, worker, bits } = this.setup, [wasm, bytes] = [this.setup.wasm, this.setup.pool].map(bytesOf);
    if (!STAGE.works() || typeof WebAssembly !== "object" || !WebAssembly.validate(wasm)) {
      root.querySelectorAll("button, input, select").forEach((control) => { control.disabled = true; });
      this.say("This browser lacks what the training needs: WebAssembly with vector instructions (SIMD), and "
        + "off-screen canvases for its maps. Chrome 111, Firefox 113, Safari 16.4 and later have both.");
      return;
    }
    for (const [name, [min, max, step, value]] of Object.entries(RANGES)) {
      if (!(name in STAGE.ranges)) Object.assign(this.find(`[name=${name}]`), { min, max, step, value: start[name] ?? value });
    }
    this.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.form = this.find("form");
    this.form.family.value = start.family ?? "MGVT";
    this.stage = STAGE.make(root, { ...this.setup, wasm }, {
      onTask: (gesture) => this.onTask(gesture),
      ask: () => this.worker.postMessage({ drivers: true, turn: this.turn }),
      calm: this.calm,
    });
    this.find(".what").textContent = STAGE.arrival;
    this.chart = new Chart(this.find(".chart"), this.setup);
    this.worker = new Worker(URL.createObjectURL(new Blob([worker], { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this.receive(data);
    this.worker.onerror = ({ message }) => this.say(`The training stopped: ${message}`);
    this.listen();
    this.setFamily();
    this.form.power.value = start.power ?? this.form.power.value;
    const pool = bits === 8 ? new Int8Array(bytes.buffer) : new Int16Array(bytes.buffer);
    const { fields, settings, every, iterations, scales, weights, spread } = this.setup, { states, arrives } = STAGE;
    const setup = { fields, settings, every, iterations, weights, spread, states, arrives };
    this.begin({ wasm, pool, scales, setup });
  }

  find(selector) {
    return this.root.querySelector(selector);
  }

  say(text) {
    this.find(".says").textContent = text;
  }

  listen() {
    const onClick = (selector, does) => this.find(selector).addEventListener("click", does);
    onClick(".go", () => (this.running ? this.send({ rate: 0 }) : this.go()));
    onClick(".ten", () => {
      this.running = true;
      this.begin({ seeds: 10 });
    });
    onClick(".step", () => this.send({ rate: 0, steps: 1 }));
    onClick(".reset", () => { this.running = false; this.begin(); });
    onClick(".next", () => {
      this.form.seed.value = (this.choice.seed + 1) % (RANGES.seed[1] + 1);
      this.begin();
    });
    this.form.seed.addEventListener("change", ({ target }) => { target.value = this.choice.seed; });
    this.find("[name=rate]").addEventListener("change", () => this.running && this.go());
    this.form.addEventListener("submit", (event) => event.preventDefault());
    this.form.addEventListener("input", ({ target }) => {
      if (target.name === "family") this.setFamily();
      if (target.name !== "keep") this.begin();
    });
  }

  /* The thesis' lambda of a family, and components only where there is a choice. */
  setFamily() {
    const { family, power, components } = this.form;
    power.value = clamp("power", Math.log10(this.setup.settings[family.value].lambda_));
    components.disabled = family.value === "GVT";
  }

  get choice() {
    const { fine, none } = this.form, { task } = this.stage, held = Object.fromEntries(new FormData(this.form));
    return chosen({ ...held, task, fine: fine.checked, none: none.checked });
  }

  /* Reports from before the last command are not looked at, unless it only changed the task. */
  send(message) {
    if (!message.task) this.turn = (this.turn ?? 0) + 1;
    this.worker.postMessage({ ...message, turn: this.turn });
  }

  /* Begins anew, and goes on running if it was. */
  begin(first = {}) {
    const { choice, form } = this, psi = choice.psi.toFixed(2), power = scientific(Number(form.power.value));
    for (const [name, text] of Object.entries({ ...choice, psi, power })) {
      if (form[name]?.type !== "range") continue;
      form[name].nextElementSibling.textContent = text;
      form[name].setAttribute("aria-valuetext", text);
    }
    this.chart.marks.replaceChildren();
    this.send({ ...first, chosen: choice, rate: 0 });
    if (this.running) this.go();
  }

  go() {
    if (this.iteration >= this.setup.iterations && !this.running) this.begin();
    this.running = true;
    this.say("training");
    this.find(".go").textContent = "Pause";
    this.send({ rate: Number(this.find("[name=rate]").value), calm: this.calm });
  }

  onTask(gesture) {
    if (!this.form.keep.checked) return this.begin();
    if (this.iteration && !gesture.marked) this.chart.mark(this.iteration);
    gesture.marked = true;
    return this.send({ task: this.stage.task });
  }

  receive(report) {
    if (report.drivers) return this.stage.drive(report.drivers);
    if (report.turn !== this.turn) return;
    Object.assign(this, { running: report.running, iteration: report.iteration });
    this.find(".go").textContent = this.running ? "Pause" : "Run";
    this.stage.show(report);
    this.chart.show(report);
    this.greedy = report.greedy ?? this.greedy;
    this.showNumbers(report);
    this.sayWhere(report);
  }

  /* A screen reader hears every 500 iterations, and the end. */
  sayWhere({ iteration, learning, arrival, seeds, bands }) {
    const value = measured(learning.transfer), passed = 500 * Math.floor(iteration / 500);
    if (this.running) {
      if (passed && passed !== this.passed) this.say(`training, past ${grouped(passed)}: learning return ${value}`);
      this.passed = passed;
      return;
    }
    if (seeds > 1) return this.say(`${seeds} seeds: learning return ${measured(bands.transfer.mean.at(-1))} on average.`);
    const end = iteration >= this.setup.iterations ? "Done" : "Paused";
    const goal = arrival ? `${STAGE.reached} at ${grouped(arrival)}` : STAGE.never;
    this.say(iteration ? `${end} at ${grouped(iteration)}: learning return ${value}; ${goal}.` : "Ready.");
  }

  showNumbers({ iteration, speed, arrival, episodes, learning, seeds, bands }) {
    const texts = { arrival: arrival ? `at ${grouped(arrival)}` : "not yet", greedy: measured(this.greedy) };
    for (const [name, number] of Object.entries({ iteration, episodes, speed })) texts[name] = grouped(number);
    for (const [name, text] of Object.entries(texts)) this.find(`.facts .${name}`).textContent = text;
    const own = Object.entries(learning).map(([name, y]) => {
      const mean = bands && bands[name].mean.at(-1);
      return { name, label: bands ? `${name === "transfer" ? "this setting" : LIVE[name]}, ${seeds} seeds ${measured(mean)}` : `${LIVE[name]} ${measured(y)}` };
    });
    this.find(".legend").replaceChildren(...[...own, ...this.setup.references].map((one) => {
      const entry = document.createElement("li");
      entry.className = one.name ?? `reference ${one.family ?? ""}`;
      entry.textContent = one.label;
      if (one.colour) entry.style.setProperty("--own", one.colour);
      return entry;
    }));
  }
}

if (typeof document !== "undefined") {
  for (const root of document.querySelectorAll(".trainer:not(.ready)")) {
    root.classList.add("ready");
    new Panel(root);
  }
}
