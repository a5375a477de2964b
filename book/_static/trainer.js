/* The panel of "Train it here": a reader trains the method in the page, in a thread beside it. What trains
   and moves is a STAGE, whose script stands before this. */
"use strict";

const NUMBERS = ["power", "psi", "components", "sources", "seed", "pool"]; // controls
const ZERO = -8.1, SEEDS = 10000; // the least place of lambda, a power of ten, stands for a lambda of 0
const BOX = [34, 372, 22, 200]; // left, right, top and bottom of the chart, in its picture's units
const LIVE = { transfer: "this run", fine: "fine-tuning", none: "no transfer" };

const lambdaOf = (power) => (power > ZERO ? Number((10 ** power).toPrecision(6)) : 0);

/* What the kernel is asked for, by what the controls hold; only a mixture has several components. */
function chosen({ family, power, psi, components, sources, seed, pool, task, fine, none }) {
  return {
    family, task, fine, none, lambda: lambdaOf(Number(power)), psi: Number(psi), sources: Number(sources), pool: Number(pool),
    components: family === "MGVT" ? Number(components) : 1,
    seed: Math.min(SEEDS - 1, Math.max(0, Math.round(seed) || 0)),
  };
}

/* Lambda as a reader writes it: 3.2 · 10⁻⁵, or 0. */
function scientific(power) {
  if (!lambdaOf(power)) return "0";
  const whole = Math.floor(power + 1e-9), digit = (10 ** (power - whole)).toFixed(1);
  const raised = String(whole).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)]);
  return `${digit === "1.0" ? "" : `${digit} · `}10${raised}`;
}

/* How hard the prior pulls: lambda over its variance, with two digits. */
const weightOf = (lambda, { scale }) => String(Number((lambda * scale).toPrecision(2)));

const bytesOf = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
const grouped = (number) => Math.round(number).toLocaleString("en");
const measured = (y) => (Number.isNaN(y) ? "(no episode yet)" : y.toFixed(STAGE.digits).replace("-", "−"));
const average = (values) => {
  const known = values.filter((y) => !Number.isNaN(y));
  return known.reduce((total, y) => total + y, 0) / known.length; // of none it is none
};
const points = (pairs) => pairs.map((pair) => pair.map((x) => x.toFixed(2)).join()).join(" ");

function draw(parent, kind, attributes, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  Object.entries(attributes).forEach(([name, value]) => element.setAttribute(name, value));
  element.textContent = text;
  return parent.appendChild(element);
}

/* Learning return over iterations: those of this run, over the stored ones. */
class Chart {
  constructor(svg, setup) {
    const [left, right, top, bottom] = BOX, [least, most] = setup.limits;
    Object.assign(this, { svg, setup, top, bottom, marks: svg.querySelector(".marks"), optimum: svg.querySelector(".optimum") });
    this.across = (t) => left + ((right - left) * t) / setup.iterations;
    this.down = (y) => bottom - ((bottom - top) * (Math.min(most, Math.max(least, y)) - least)) / (most - least);
    const [axes, stored] = [".axes", ".references"].map((part) => svg.querySelector(part));
    for (const tick of setup.ticks) {
      const y = this.down(tick);
      draw(axes, "line", { x1: left, x2: right, y1: y, y2: y });
      draw(axes, "text", { x: left - 6, y: y + 4, "text-anchor": "end" }, String(tick).replace("-", "−"));
    }
    for (let i = 0; i <= 5; i++) {
      const t = (i * setup.iterations) / 5, anchor = i === 5 ? "end" : "middle";
      draw(axes, "text", { x: this.across(t), y: bottom + 15, "text-anchor": anchor }, grouped(t));
    }
    for (const { family, colour, iterations, values } of setup.references) {
      this.trace(draw(stored, "polyline", { class: family, style: `--own: ${colour}` }), iterations, values);
    }
  }

  /* The optimum of a task that is a share of the way along the landmarks. */
  aim(share) {
    const { optima } = this.setup, at = share * (optima.length - 1), low = optima[Math.floor(at)];
    this.optimum.setAttribute("transform", `translate(0 ${this.down(low + (optima[Math.ceil(at)] - low) * (at % 1))})`);
  }

  /* The curve of this setting, or its mean over seeds, stays where it is until it is let go. */
  pin(on) {
    this.svg.querySelector(".pinned").setAttribute("points", on ? this.drawn : "");
  }

  get drawn() {
    return this.svg.querySelector(this.svg.matches(".many") ? ".mean.transfer" : ".run.transfer").getAttribute("points");
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

  /* Who plays, episode by episode, along the bottom. */
  tell({ turns, count }, iteration) {
    const ends = [...turns.slice(1).map(([step]) => step), iteration], players = this.svg.querySelector(".players");
    players.replaceChildren();
    turns.forEach(([step, arm], i) => {
      const x = this.across(step), width = Math.max(0, this.across(ends[i]) - x);
      draw(players, "rect", { x, width, y: this.bottom - 6, height: 6, class: arm < count ? "source" : "own" });
    });
  }

  show({ curves, learning, iteration, bands, plays }) {
    this.tell(plays && !bands ? plays : { turns: [] }, iteration);
    for (const name of Object.keys(LIVE)) {
      const values = [...(curves[name] ?? []), learning[name]];
      const places = values.map((_, i) => Math.min((i + 1) * this.setup.every, iteration));
      this.trace(this.svg.querySelector(`.run.${name}`), places, values);
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
    const { start, worker, pools } = this.setup, [wasm, bytes] = [this.setup.wasm, this.setup.pool].map(bytesOf);
    if (!STAGE.works() || typeof WebAssembly !== "object" || !WebAssembly.validate(wasm)) {
      root.querySelectorAll("button, input, select").forEach((control) => { control.disabled = true; });
      this.say(this.find(".says").dataset.lacks);
      return;
    }
    this.calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.form = this.find("form");
    this.stage = STAGE.make(root, { ...this.setup, wasm }, {
      onTask: (gesture) => this.onTask(gesture),
      ask: () => this.worker.postMessage({ drivers: true, turn: this.turn }),
      calm: this.calm,
    });
    this.chart = new Chart(this.find(".chart"), this.setup);
    this.worker = new Worker(URL.createObjectURL(new Blob([worker], { type: "text/javascript" })));
    this.worker.onmessage = ({ data }) => this.receive(data);
    this.worker.onerror = ({ message }) => this.say(`The training stopped: ${message}`);
    this.listen();
    this.set(start);
    const pool = new Int16Array(bytes.buffer);
    const { fields, settings, every, iterations, scales, weights, spread } = this.setup, { states, arrives } = STAGE;
    const setup = { fields, settings, every, iterations, weights, spread, states, arrives, pools };
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
      this.form.seed.value = (this.choice.seed + 1) % SEEDS;
      this.begin();
    });
    onClick(".another", () => {
      this.stage.set(this.setup.ranges.map(([least, most]) => least + (most - least) * Math.random()));
      this.onTask({});
    });
    onClick(".pin", ({ target }) => this.pin(target));
    for (const button of this.root.querySelectorAll(".preset")) {
      button.addEventListener("click", () => {
        if (!this.pinned && this.chart.drawn) this.pin(this.find(".pin")); // to compare with
        this.set(JSON.parse(button.dataset.state));
        this.press(button);
        this.find(".look").textContent = button.dataset.look;
        this.running = true;
        this.begin();
      });
    }
    this.form.seed.addEventListener("change", ({ target }) => { target.value = this.choice.seed; });
    this.find("[name=rate]").addEventListener("change", () => this.running && this.go());
    this.form.addEventListener("submit", (event) => event.preventDefault());
    this.form.addEventListener("input", ({ target }) => {
      if (!target.closest(".pull, .choices")) return; // the stage's controls tell of themselves
      if (target.name === "family") this.setFamily();
      this.press();
      if (target.name !== "keep") this.begin();
    });
  }

  /* The thesis' lambda of a family, and controls only where there is a choice: the recommended method has none. */
  setFamily() {
    const { family, power, psi, components } = this.form, trusts = family.value === "Trust";
    if (!trusts) power.value = Math.log10(this.setup.settings[family.value].lambda_);
    power.disabled = psi.disabled = trusts;
    components.disabled = family.value !== "MGVT";
  }

  /* The preset that stands as it was chosen, or none. */
  press(chosen) {
    if (!chosen) this.find(".look").textContent = "";
    for (const button of this.root.querySelectorAll(".preset")) button.setAttribute("aria-pressed", button === chosen);
  }

  /* Puts the controls where a preset says. */
  set({ family, task, ...numbers }) {
    if (family) this.form.family.value = family;
    this.setFamily();
    for (const name of NUMBERS) this.form[name].value = numbers[name] ?? this.form[name].value;
    if (task) this.stage.set(task);
    this.form.seed.value = this.choice.seed;
  }

  get choice() {
    const { family, fine, none } = this.form, { task } = this.stage;
    const held = Object.fromEntries(NUMBERS.map((name) => [name, this.form[name].value]));
    return chosen({ ...held, family: family.value, task, fine: fine.checked, none: none.checked });
  }

  pin(button) {
    const on = this.root.classList.toggle("pinned");
    button.setAttribute("aria-pressed", on);
    button.textContent = on ? "Unpin" : "Pin this curve";
    this.pinned = on && [{ name: "pinned", label: `pinned: ${this.setting}` }];
    this.chart.pin(on);
    this.showNumbers(this.report);
  }

  /* Reports from before the last command are not looked at, unless it only changed the task. */
  send(message) {
    if (!message.task) this.turn = (this.turn ?? 0) + 1;
    this.worker.postMessage({ ...message, turn: this.turn });
    this.chart.aim(this.stage.along);
  }

  /* Begins anew, and goes on running if it was. */
  begin(first = {}) {
    const { choice, form } = this, psi = choice.psi.toFixed(2), power = scientific(Number(form.power.value));
    this.find(".weight").textContent = choice.family === "Trust" ? "" : weightOf(choice.lambda, this.setup.settings[choice.family]);
    for (const [name, text] of Object.entries({ ...choice, psi, power: choice.family === "Trust" ? "" : power })) {
      if (form[name]?.type !== "range") continue;
      form[name].nextElementSibling.textContent = text;
      form[name].setAttribute("aria-valuetext", text);
    }
    this.setting = `${choice.family}, ${choice.family === "Trust" ? "" : `λ = ${power}, ψ = ${psi}, `}${choice.sources} sources`;
    this.root.dataset.family = choice.family; // whose colour the run has
    this.root.classList.toggle("elsewhere", choice.pool > 0); // stored runs are from the first pool
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
    Object.assign(this, { report, running: report.running, iteration: report.iteration });
    this.find(".go").textContent = this.running ? "Pause" : "Run";
    this.stage.show(report);
    this.chart.show(report);
    this.showNumbers(report);
    this.sayWhere(report);
  }

  /* A screen reader hears every 500 iterations, and the end. */
  sayWhere({ iteration, learning, arrival, seeds, bands }) {
    const value = measured(learning.transfer), passed = 500 * Math.floor(iteration / 500);
    if (this.running) {
      if (passed && passed !== this.passed) this.say(`training${seeds ? ` seed ${seeds + 1}` : ""}, past ${grouped(passed)}: learning return ${value}`);
      this.passed = passed;
      return;
    }
    if (seeds > 1) {
      const { mean } = bands.transfer;
      return this.say(`${seeds} seeds: learning return ${measured(average(mean))} over the run, ${measured(mean.at(-1))} at its end.`);
    }
    const end = iteration >= this.setup.iterations ? "Done" : "Paused";
    const goal = arrival ? `${STAGE.reached} at ${grouped(arrival)}` : STAGE.never;
    this.say(iteration ? `${end} at ${grouped(iteration)}: learning return ${value}; ${goal}.` : "Ready.");
  }

  showNumbers({ iteration, speed, arrival, episodes, learning, seeds, bands, plays }) {
    const texts = { arrival: arrival ? `at ${grouped(arrival)}` : "not yet" };
    for (const [name, number] of Object.entries({ iteration, episodes, speed })) texts[name] = grouped(number);
    for (const [name, text] of Object.entries(texts)) this.find(`.facts .${name}`).textContent = text;
    const arm = plays?.turns.at(-1)[1], who = plays && (arm < plays.count ? `old policy ${arm + 1} plays` : "the learner plays");
    this.find(".plays").textContent = plays ? `${who}; an untried one fits with probability ${plays.trust.toFixed(2)}. Strip: grey for old policies, violet for the learner.` : "";
    const own = Object.entries(learning).map(([name, y]) => {
      if (!bands) return { name, label: `${LIVE[name]} ${measured(y)}` };
      const over = measured(average(bands[name].mean));
      return { name, label: `${name === "transfer" ? "this setting" : LIVE[name]}, ${seeds} seeds: ${over} over the run` };
    });
    this.find(".legend").replaceChildren(...[...own, ...(this.pinned || this.setup.references)].map((one) => {
      const entry = document.createElement("li");
      entry.className = one.name ?? `reference ${one.family}`;
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
