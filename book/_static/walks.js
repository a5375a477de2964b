/* Six robots in a maze, driven by what agents know there after so many iterations. */
"use strict";

(function () {
  const A_SECOND = 25; // steps that are played in a second
  const SIDE = 10; // cells
  const GOAL = "#009e7366", RADIUS = 0.28; // of a robot, in cells

  /* What a page carries packed: bytes, each the change since the state before. */
  async function unpacked(run, states) {
    const packed = Uint8Array.from(atob(run.walks), (one) => one.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    for (let i = 3; i < bytes.length; i++) if (i % (3 * states) > 2) bytes[i] += bytes[i - 3];
    return bytes;
  }

  class Square {
    constructor(figure, setup) {
      this.canvas = figure.querySelector("canvas");
      this.count = figure.querySelector(".count");
      this.figure = figure;
      this.setup = setup;
    }

    take(maze, run) {
      this.figure.hidden = !run;
      [this.maze, this.run] = [maze, run];
    }

    /* Cell coordinates and heading of a robot at a step of its walk. */
    pose(moment, mode, robot, step) {
      const { robots, states, perMetre } = this.setup, { run } = this;
      const walk = (Math.min(moment, run.moments - 1) * run.modes + Math.min(mode, run.modes - 1)) * robots + robot;
      const [x, y, heading] = run.bytes.subarray(3 * (walk * states + step));
      return [(x + 0.5) / perMetre, (y + 0.5) / perMetre, (heading / 128) * Math.PI];
    }

    draw(moment, mode, step) {
      if (!this.run) return;
      const pen = this.canvas.getContext("2d"), ink = getComputedStyle(this.canvas).color;
      const unit = this.canvas.width / SIDE;
      pen.setTransform(unit, 0, 0, -unit, 0, this.canvas.height); // cells, from the bottom left
      pen.clearRect(0, 0, SIDE, SIDE);
      pen.fillStyle = GOAL;
      pen.fillRect(...this.maze.goal, 1, 1);
      pen.fillStyle = pen.strokeStyle = ink;
      pen.globalAlpha = 0.55;
      for (const cell of this.maze.walls) pen.fillRect(...cell, 1, 1);
      pen.lineWidth = 0.08;
      pen.strokeRect(0, 0, SIDE, SIDE);
      pen.fillStyle = pen.strokeStyle = `color-mix(in oklab, ${this.run.colour} 75%, ${ink})`;
      let arrived = 0;
      for (let robot = 0; robot < this.setup.robots; robot++) arrived += this.drawRobot(pen, moment, mode, robot, step);
      this.count.textContent = `${arrived} of ${this.setup.robots} at the goal`;
    }

    /* The way of a robot so far, and itself at its end; whether that is the goal. */
    drawRobot(pen, moment, mode, robot, step) {
      let x, y, heading;
      pen.globalAlpha = 0.6;
      pen.lineWidth = 0.1;
      pen.beginPath();
      for (let t = 0; t <= step; t++) {
        [x, y, heading] = this.pose(moment, mode, robot, t);
        pen.lineTo(x, y);
      }
      pen.stroke();
      pen.globalAlpha = 1;
      pen.beginPath();
      pen.moveTo(x + 1.7 * RADIUS * Math.cos(heading), y + 1.7 * RADIUS * Math.sin(heading));
      pen.arc(x, y, RADIUS, heading + 0.7, heading - 0.7);
      pen.fill();
      return Math.floor(x) === this.maze.goal[0] && Math.floor(y) === this.maze.goal[1];
    }
  }

  class Walks extends Player {
    constructor(root, setup) {
      const squares = [...root.querySelectorAll("figure")].map((one) => new Square(one, setup));
      super(root, setup.last, A_SECOND, squares);
      this.setup = setup;
      this.picture = root.querySelector(".squares");
      [this.maze, this.mode] = ["maze", "mode"].map((name) => root.querySelector(`select.${name}`));
      this.maze.addEventListener("change", () => this.enter());
      this.mode.addEventListener("change", () => this.show());
      this.enter();
    }

    enter() {
      const maze = this.setup.mazes[Number(this.maze.value)];
      this.squares.forEach((square, i) => square.take(maze, maze.runs[i]));
      this.show();
    }

    show() {
      if (!this.setup) return;
      const { states, every } = this.setup;
      const moment = Math.floor(this.place / states), step = this.place % states;
      this.output.textContent = `iteration ${((moment + 1) * every).toLocaleString("en")}, step ${step}`;
      for (const square of this.squares) square.draw(moment, Number(this.mode.value), step);
      if (this.playing) return;
      const shown = this.squares.filter((square) => square.run);
      const told = shown.map((one) => `${one.figure.querySelector("figcaption").textContent}: ${one.count.textContent}`);
      this.picture.setAttribute("aria-label", `${this.output.textContent}. ${told.join("; ")}.`);
    }
  }

  for (const root of document.querySelectorAll(".walks:not(.ready)")) {
    root.classList.add("ready");
    const setup = JSON.parse(root.querySelector("script").textContent);
    const runs = setup.mazes.flatMap((maze) => maze.runs).filter((run) => run);
    Promise.all(runs.map(async (run) => { run.bytes = await unpacked(run, setup.states); }))
      .then(() => new Walks(root, setup));
  }
})();
