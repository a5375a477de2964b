/* A stage that is driven: the run in training moves on it, and so does whoever the reader puts at the wheel. */
"use strict";

const DRIVER = 7, STATE = 8; // places in the kernel

/* An action by the keys that are held; without any, what the stage has for an idle hand. */
const byHand = (held, time) => held ?? STAGE.idle(time);

class Driven {
  constructor(root, { fields, wasm }, { onTask, ask, calm }) {
    const { numbers: [i, j], ends: [[left, right], [low, high]] } = STAGE.plane;
    this.placed = (state) => [30 + (340 * (state[i] - left)) / (right - left), 170 - (160 * (state[j] - low)) / (high - low)];
    const [scene, plane] = [".scene", ".plane"].map((part) => root.querySelector(part));
    Object.assign(this, { root, calm, plane, inputs: [...root.querySelectorAll(".task input")], held: undefined, until: 0 });
    this.task_at = 4 * (fields.integers.length + fields.numbers.length);
    this.pose = STAGE.scene(scene);
    this.inputs.forEach((input) => this.listenTo(input, onTask));
    this.wheel = root.querySelector("[name=driver]");
    const button = root.querySelector(".drive");
    button.addEventListener("click", () => {
      if (this.timer) return this.stop("Stopped");
      if (this.wheel.value === "you") scene.focus();
      return ask();
    });
    this.button = button;
    this.listen(scene);
    WebAssembly.instantiate(wasm).then(({ instance }) => { this.kernel = instance.exports; });
  }

  get task() {
    return [...this.inputs.map((input) => Number(input.value)), ...STAGE.shared];
  }

  /* How far the first number is from its least. */
  get along() {
    const [{ value, min, max }] = this.inputs;
    return (value - min) / (max - min);
  }

  set(task) {
    this.inputs.forEach((input, i) => {
      input.value = task[i] ?? input.value;
      input.nextElementSibling.textContent = input.value;
    });
  }

  listenTo(input, onTask) {
    let gesture = {};
    input.addEventListener("input", () => {
      this.set(this.task);
      onTask(gesture);
    });
    input.addEventListener("change", () => { gesture = {}; });
  }

  /* The reader's hands: arrow keys, or the side of the scene that a finger is on. */
  listen(scene) {
    scene.addEventListener("keydown", (event) => {
      if (!(event.key in STAGE.keys) || event.altKey || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      this.held = STAGE.keys[event.key];
    });
    const free = () => { this.held = undefined; };
    for (const end of ["keyup", "blur", "pointerup", "pointercancel"]) scene.addEventListener(end, free);
    scene.addEventListener("pointerdown", (event) => {
      const { left, width } = scene.getBoundingClientRect();
      this.held = STAGE.keys[event.clientX < left + width / 2 ? "ArrowLeft" : "ArrowRight"];
    });
  }

  floats(place, count, offset = 0) {
    return new Float32Array(this.kernel.memory.buffer, this.kernel.place(place) + offset, count);
  }

  /* One episode. drivers: the weights that the worker knows; a source that this run has not is its last. */
  drive({ sources, ...drivers }) {
    const who = this.wheel.value, weights = drivers[who] ?? sources[Math.min(who, sources.length - 1)];
    if (!this.kernel) return;
    Object.assign(this, { time: 0, earned: 0, trace: [[...STAGE.start]], name: this.wheel.selectedOptions[0].text });
    this.floats(0, this.task.length, this.task_at).set(this.task);
    this.floats(STATE, STAGE.states).set(STAGE.start);
    const driver = this.floats(DRIVER, 16 * (weights?.length ?? 0));
    weights?.forEach((w, i) => { driver[16 * i] = w; });
    this.button.textContent = "Stop";
    this.say(`At the wheel: ${this.name}.`);
    const step = () => {
      const over = this.step(who === "you" ? byHand(this.held, this.time) : -1);
      const wait = (1000 / STAGE.pace) * (who === "you" ? STAGE.slower : 1);
      if (over) this.stop(over);
      else if (!this.calm || who === "you") this.timer = setTimeout(step, wait);
      return over;
    };
    if (!this.calm || who === "you") return void step();
    while (!step()); // all at once, where no motion is wanted
  }

  /* One step of whoever drives; why the episode is over, if it is. */
  step(action) {
    const code = this.kernel.step_stage(action);
    this.earned += STAGE.reward * 0.99 ** this.time++;
    this.trace.push([...this.floats(STATE, STAGE.states)]);
    this.paint(this.trace.at(-1), code & 255, this.trace, []);
    if (code >> 8) return STAGE.ends[1](this.time);
    return this.time === STAGE.horizon ? STAGE.ends[0](this.time) : undefined;
  }

  /* What was driven stays in view a while, though training goes on. */
  stop(how) {
    clearTimeout(this.timer);
    this.timer = undefined;
    this.until = performance.now() + 4000;
    this.button.textContent = "Drive";
    this.say(`At the wheel: ${this.name}. ${how}: return ${measured(this.earned)}.`);
  }

  say(text) {
    this.root.querySelector(".drove").textContent = text;
  }

  show({ path, last }) {
    if (this.timer || performance.now() < this.until) return;
    this.say("In training");
    this.paint(path.at(-1), undefined, path, last);
  }

  paint(state, action, now, last) {
    this.pose(state, this.task, action);
    this.plane.querySelector(".now").setAttribute("points", points(now.map(this.placed)));
    this.plane.querySelector(".last").setAttribute("points", points(last.map(this.placed)));
  }
}

if (typeof module !== "undefined") module.exports = Driven;
