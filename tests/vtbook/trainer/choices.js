/* Who plays, by the page's own choices: one list of arms for each [count, episodes] in the argument. */
"use strict";

const { worker: { Record } } = require("./given.js");

console.log(JSON.stringify(JSON.parse(process.argv[2]).map(([count, episodes]) => {
  const record = new Record(count);
  for (const [begun, coin, normal, earned] of episodes) {
    record.choose(begun, coin, normal);
    record.add(...earned);
  }
  return record.played;
})));
