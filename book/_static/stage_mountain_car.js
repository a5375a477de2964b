/* The car in its valley. */
"use strict";

const STAGE = {
  make: (...given) => new Driven(...given),
  shared: [-1], // what the step to the goal earns
  states: 2, start: [-0.5, 0], horizon: 200, reward: -1,
  arrives: 2,
  pace: 40, slower: 1.5, // steps a second, and what a reader's hand gets
  keys: { ArrowLeft: 0, ArrowDown: 1, ArrowRight: 2 },
  idle: () => 1,
  ends: [(time) => `It never arrived in ${time} steps`, (time) => `It arrived after ${time} steps`],
  digits: 1,
  reached: "the top was first reached", never: "the top was not reached yet",
  plane: { numbers: [0, 1], ends: [[-1.2, 0.6], [-0.07, 0.07]] },
  works: () => true,

  /* A function that moves the scene to a state, task and action (or none). */
  scene(svg) {
    const [car, push] = ["g", ".push"].map((part) => svg.querySelector(part)), height = (x) => -0.45 * Math.sin(3 * x);
    return ([x], _, action) => {
      const side = (action ?? 1) - 1, slope = Math.atan(-1.35 * Math.cos(3 * x));
      car.setAttribute("transform", `translate(${x} ${height(x)}) rotate(${(slope * 180) / Math.PI})`);
      push.setAttribute("d", side ? `M${0.1 * side} -.06 h${0.13 * side} l${-0.04 * side} -.03 m${0.04 * side} .03 l${-0.04 * side} .03` : "");
    };
  },
};

if (typeof module !== "undefined") module.exports = STAGE;
