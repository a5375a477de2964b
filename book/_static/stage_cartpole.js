/* The cart and its pole. */
"use strict";

const STAGE = {
  make: (...given) => new Driven(...given),
  shared: [],
  states: 4, start: [0, 0, 0.05, 0], horizon: 100, reward: 1,
  arrives: 1, // to balance until time is up
  pace: 50, slower: 2, // steps a second, and what a reader's hand gets
  keys: { ArrowLeft: 0, ArrowRight: 1 },
  idle: (time) => time % 2,
  ends: [(time) => `It balanced to the end, ${time} steps`, (time) => `It fell after ${time} steps`],
  digits: 1,
  reached: "it first balanced to the end", never: "it never balanced to the end",
  plane: { numbers: [2, 3], ends: [[-0.21, 0.21], [-2, 2]] },
  works: () => true,

  /* A function that moves the scene to a state, task and action (or none). */
  scene(svg) {
    const [cart, body, pole, push] = ["g", ".body", ".pole", ".push"].map((part) => svg.querySelector(part));
    return ([x, , angle], [mass, weight, half], action) => {
      const side = 2 * action - 1, width = 0.35 + 0.35 * mass, tip = (width / 2) * side;
      cart.setAttribute("transform", `translate(${x} 0)`);
      body.setAttribute("x", -width / 2);
      body.setAttribute("width", width);
      pole.setAttribute("transform", `rotate(${(angle * 180) / Math.PI} 0 -0.34)`);
      pole.setAttribute("y2", -0.34 - 2 * half);
      pole.style.strokeWidth = 0.03 + 0.3 * weight;
      push.setAttribute("d", action === undefined ? "" : `M${tip} -.2 h${0.4 * side} l${-0.12 * side} -.09 m${0.12 * side} .09 l${-0.12 * side} .09`);
    };
  },
};

if (typeof module !== "undefined") module.exports = STAGE;
