/* The rooms: a map with doors to drag, and two maps of what the posterior believes. */
"use strict";

const SIDE = 10, CELLS = 20;
const LEAST = 1e-3, CERTAIN = 1e-2; // deviations: the lower end of their scale, whose upper is 1, and what is none

const STAGE = {
  make: (...given) => new Rooms(...given),
  states: 2, // numbers of a state
  arrives: 2, // the end of an episode that counts as arriving: by what happened (2), or by its time (1)
  digits: 2,
  reached: "the goal was first reached", never: "the goal was not reached yet",
  works: () => typeof OffscreenCanvas === "function" && CSS.supports("color", colour(0.5)),
};

/* The colour of a share between 0 and 1, from dark violet to light yellow in even steps. */
const colour = (share) => `oklch(${0.3 + 0.6 * share} 0.13 ${295 - 190 * share})`;

/* Values are drawn to 1, the return of who begins at the goal; deviations by their logarithms. */
const shareOf = (name, x) => Math.min(1, Math.max(0, name === "value" ? x : 1 - Math.log(x) / Math.log(LEAST)));

/* Heights of the walls between rooms of equal height. */
const wallsOf = (count) => Array.from({ length: count }, (_, i) => (SIDE * (i + 1)) / (count + 1));

const DOORS = [0.5, 9.5];

/* A place where a door can be. */
const held = (door) => Math.round(10 * Math.min(DOORS[1], Math.max(DOORS[0], door))) / 10;

/* Where a key takes a door; undefined when it means nothing here. */
function moved(door, key) {
  const by = { ArrowLeft: -0.1, ArrowDown: -0.1, ArrowRight: 0.1, ArrowUp: 0.1, PageDown: -1, PageUp: 1 };
  const ends = { Home: DOORS[0], End: DOORS[1] };
  return ends[key] ?? (key in by ? held(door + by[key]) : undefined);
}

/* The square, its doors as sliders, and where the agent was. */
class Rooms {
  constructor(root, { task: doors }, { onTask }) {
    const svg = root.querySelector(".map");
    Object.assign(this, { root, svg, doors: [...doors], onTask, heights: wallsOf(doors.length) });
    this.walls = [...svg.querySelectorAll(".walls path")];
    this.handles = [...svg.querySelectorAll(".door")];
    this.handles.forEach((door, i) => this.listen(door, i));
    this.set(doors);
  }

  listen(one, i) {
    let gesture; // a whole drag is one, and so is a key that is held: each leaves one mark at most
    one.addEventListener("keydown", (event) => {
      if (event.altKey || event.ctrlKey || event.metaKey) return; // the browser's own
      const to = moved(this.doors[i], event.key);
      if (to === undefined) return;
      event.preventDefault();
      if (!event.repeat) gesture = {};
      this.move(i, to, gesture);
    });
    one.addEventListener("pointerdown", (event) => {
      one.setPointerCapture(event.pointerId);
      gesture = {};
    });
    one.addEventListener("pointermove", (event) => {
      if (!one.hasPointerCapture(event.pointerId)) return;
      const inside = this.svg.getScreenCTM().inverse();
      const { x } = new DOMPoint(event.clientX, event.clientY).matrixTransform(inside);
      this.move(i, held(x), gesture);
    });
  }

  move(i, door, gesture) {
    if (gesture && door === this.doors[i]) return;
    this.doors[i] = door;
    const y = SIDE - this.heights[i];
    this.walls[i].setAttribute("d", `M0 ${y} H${door - 0.5} M${door + 0.5} ${y} H${SIDE}`);
    this.handles[i].setAttribute("transform", `translate(${door} ${y})`);
    this.handles[i].setAttribute("aria-valuenow", door);
    if (gesture) this.onTask(gesture);
  }

  show({ path, last, maps }) {
    for (const [name, values] of Object.entries(maps || {})) this.paint(name, values);
    const turned = (walk) => walk.map(([x, y]) => [x, SIDE - y]), [x, y] = turned(path).at(-1);
    this.svg.querySelector(".last").setAttribute("points", points(turned(last)));
    this.svg.querySelector(".now").setAttribute("points", points(turned(path)));
    this.svg.querySelector(".agent").setAttribute("transform", `translate(${x} ${y})`);
  }

  set(doors) {
    this.doors.forEach((_, i) => this.move(i, held(doors[i])));
  }

  /* What tells the task apart for the kernel. */
  get task() {
    return [this.doors[0], this.doors[1] ?? 0, this.doors.length];
  }

  /* How far the upper door is back from the lower one: the way to the goal is longer by that. */
  get along() {
    return Math.max(0, this.doors[0] - this.doors.at(-1)) / (DOORS[1] - DOORS[0]);
  }

  paint(name, values) {
    const part = this.root.querySelector(`.${name}`), small = new OffscreenCanvas(CELLS, CELLS);
    const canvas = part.querySelector("canvas"), context = canvas.getContext("2d"), cells = small.getContext("2d");
    values.forEach((x, i) => {
      cells.fillStyle = colour(shareOf(name, x));
      cells.fillRect(i % CELLS, CELLS - 1 - Math.floor(i / CELLS), 1, 1);
    });
    context.setTransform(canvas.width / SIDE, 0, 0, canvas.width / SIDE, 0, 0);
    context.drawImage(small, 0, 0, SIDE, SIDE);
    Object.assign(context, { strokeStyle: "#fff", lineWidth: 0.16 });
    this.walls.forEach((wall) => context.stroke(new Path2D(wall.getAttribute("d"))));
    if (name === "value") return;
    const most = Math.max(...values);
    part.querySelector(".most").textContent = most < CERTAIN ? `certain everywhere (below ${CERTAIN})` : `at most ${most.toPrecision(2)}`;
  }
}

if (typeof module !== "undefined") module.exports = STAGE;
