/* The car in its valley. */
"use strict";

const STAGE = {
  make: (...given) => new Driven(...given),
  ranges: { speed: [0.001, 0.0015, 0.00001, 0.00125] },
  labels: { speed: "engine" },
  shared: [-1], // what the step to the goal earns
  states: 2, start: [-0.5, 0], horizon: 200, reward: -1,
  arrives: 2,
  pace: 40, slower: 1.5, // steps a second, and what a reader's hand gets
  keys: { ArrowLeft: 0, ArrowDown: 1, ArrowRight: 2 },
  idle: () => 1,
  ends: [(time) => `It never arrived in ${time} steps`, (time) => `It arrived after ${time} steps`],
  hint: "“You” drive with the arrow keys, or touch the left or right of the picture. Roll back first.",
  limits: [-90, -40], ticks: [-90, -80, -70, -60, -50, -40], tenths: 0, digits: 1,
  arrival: "top first reached", reached: "the top was first reached", never: "the top was not reached yet",
  plane: { numbers: [0, 1], ends: [[-1.2, 0.6], [-0.07, 0.07]], labels: ["position", "velocity"] },
  works: () => true,

  /* Draws the scene; a function that moves it to a state, task and action (or none). */
  scene(svg) {
    const height = (x) => -0.45 * Math.sin(3 * x), hill = Array.from({ length: 91 }, (_, i) => -1.2 + i / 50);
    svg.setAttribute("viewBox", "-1.25 -0.8 1.9 1.3");
    draw(svg, "polyline", { points: hill.map((x) => `${x},${height(x)}`).join(" "), class: "ground" });
    draw(svg, "path", { d: `M.5 ${height(0.5)} v-.28 l.12 .06 l-.12 .06`, class: "flag" });
    const car = draw(svg, "g", {});
    draw(car, "path", { d: "M-.09 -.03 v-.05 h.04 l.02 -.04 h.06 l.02 .04 h.04 v.05 z", class: "body" });
    for (const cx of [-0.05, 0.05]) draw(car, "circle", { cx, cy: -0.024, r: 0.024, class: "wheels" });
    const push = draw(car, "path", { class: "push" });
    return ([x], _, action) => {
      const side = (action ?? 1) - 1, slope = Math.atan(-1.35 * Math.cos(3 * x));
      car.setAttribute("transform", `translate(${x} ${height(x)}) rotate(${(slope * 180) / Math.PI})`);
      push.setAttribute("d", side ? `M${0.1 * side} -.06 h${0.13 * side} l${-0.04 * side} -.03 m${0.04 * side} .03 l${-0.04 * side} .03` : "");
    };
  },
};

if (typeof module !== "undefined") module.exports = STAGE;
