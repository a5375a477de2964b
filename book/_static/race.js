/* Two recorded runs in the same rooms: play, pause, or drag to any step. */
"use strict";

(function () {
  const A_SECOND = 400; // steps that are played in a second
  const TRAIL = 40; // steps whose way is drawn as a line

  class Square {
    constructor(figure, run, setup) {
      this.canvas = figure.querySelector("canvas");
      this.count = figure.querySelector(".count");
      this.run = run;
      this.setup = setup;
      this.places = Uint8Array.from(atob(run.places), (one) => one.charCodeAt(0));
    }

    /* Where a step led, in pixels of the canvas. */
    at(step) {
      const size = this.canvas.width / 255;
      return [this.places[2 * step] * size, this.canvas.height - this.places[2 * step + 1] * size];
    }

    draw(until) {
      const pen = this.canvas.getContext("2d");
      pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
      this.drawRooms(pen);
      const ink = getComputedStyle(this.canvas).color; // light on dark pages
      pen.fillStyle = pen.strokeStyle = `color-mix(in oklab, ${this.run.colour} 70%, ${ink})`;
      pen.globalAlpha = 0.5;
      for (let step = 0; step < until; step++) {
        const [x, y] = this.at(step);
        pen.fillRect(x - 1, y - 1, 2, 2);
      }
      pen.globalAlpha = 1;
      this.drawTrail(pen, until);
      const times = this.run.reached.filter((step) => step <= until).length;
      this.count.textContent = `goal reached ${times} time${times === 1 ? "" : "s"}`;
    }

    drawRooms(pen) {
      const { side, gap, goal, walls, doors } = this.setup;
      const unit = this.canvas.width / side;
      pen.fillStyle = "#009e7366";
      pen.beginPath();
      pen.moveTo(this.canvas.width, 0);
      pen.arc(this.canvas.width, 0, goal * unit, Math.PI / 2, Math.PI);
      pen.fill();
      pen.strokeStyle = getComputedStyle(this.canvas).color;
      pen.lineWidth = 2;
      pen.strokeRect(1, 1, this.canvas.width - 2, this.canvas.height - 2);
      pen.lineWidth = 4;
      pen.beginPath();
      walls.forEach((height, i) => {
        const y = this.canvas.height - height * unit;
        pen.moveTo(0, y);
        pen.lineTo((doors[i] - gap / 2) * unit, y);
        pen.moveTo((doors[i] + gap / 2) * unit, y);
        pen.lineTo(this.canvas.width, y);
      });
      pen.stroke();
    }

    /* The last steps of the episode, and the agent at their end. */
    drawTrail(pen, until) {
      if (!until) return;
      const jump = this.canvas.width / 5; // farther than any step: a new episode
      let [x, y] = this.at(until - 1);
      pen.beginPath();
      pen.arc(x, y, 6, 0, 2 * Math.PI);
      pen.fill();
      pen.lineWidth = 2;
      pen.beginPath();
      pen.moveTo(x, y);
      for (let step = until - 2; step >= Math.max(0, until - TRAIL); step--) {
        const [a, b] = this.at(step);
        if (Math.hypot(a - x, b - y) > jump) break;
        [x, y] = [a, b];
        pen.lineTo(x, y);
      }
      pen.stroke();
    }
  }

  class Race extends Player {
    constructor(root) {
      const setup = JSON.parse(root.querySelector("script").textContent);
      const figures = [...root.querySelectorAll("figure")];
      const squares = figures.map((one, i) => new Square(one, setup.runs[i], setup));
      super(root, setup.iterations, A_SECOND, squares);
    }

    show() {
      this.output.textContent = `step ${this.place.toLocaleString("en")}`;
      for (const square of this.squares) square.draw(this.place);
    }
  }

  for (const root of document.querySelectorAll(".race:not(.ready)")) {
    root.classList.add("ready");
    new Race(root);
  }
})();
