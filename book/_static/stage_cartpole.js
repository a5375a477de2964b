/* The cart and its pole. */
"use strict";

const STAGE = {
  make: (...given) => new Driven(...given),
  ranges: { cart_mass: [0.5, 1.5, 0.05, 1], pole_mass: [0.1, 0.3, 0.01, 0.2], half_length: [0.2, 1, 0.02, 0.5] },
  labels: { cart_mass: "cart, kg", pole_mass: "pole, kg", half_length: "half length, m" },
  shared: [],
  states: 4, start: [0, 0, 0.05, 0], horizon: 100, reward: 1,
  arrives: 1, // to balance until time is up
  pace: 50, slower: 2, // steps a second, and what a reader's hand gets
  keys: { ArrowLeft: 0, ArrowRight: 1 },
  idle: (time) => time % 2,
  ends: [(time) => `It balanced to the end, ${time} steps`, (time) => `It fell after ${time} steps`],
  hint: "“You” push with the arrow keys, or touch the left or right of the picture, at half speed.",
  limits: [0, 66], ticks: [0, 20, 40, 60], tenths: 0, digits: 1,
  arrival: "first balanced to the end", reached: "it first balanced to the end", never: "it never balanced to the end",
  plane: { numbers: [2, 3], ends: [[-0.21, 0.21], [-2, 2]], labels: ["angle", "angular velocity"] },
  works: () => true,

  /* Draws the scene; a function that moves it to a state, task and action (or none). */
  scene(svg) {
    svg.setAttribute("viewBox", "-2.9 -2.5 5.8 2.8");
    draw(svg, "path", { d: "M-2.9 0 H2.9 M-2.4 0 V.12 M2.4 0 V.12", class: "ground" });
    const cart = draw(svg, "g", {}), body = draw(cart, "rect", { y: -0.34, height: 0.28, rx: 0.04, class: "body" });
    for (const cx of [-0.16, 0.16]) draw(cart, "circle", { cx, cy: -0.07, r: 0.07, class: "wheels" });
    const pole = draw(cart, "line", { y1: -0.34, class: "pole" }), push = draw(cart, "path", { class: "push" });
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
