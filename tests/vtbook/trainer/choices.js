/* Who plays, by the page's own choices: for each [count, episodes] in the argument its arms, and
   whether what was learned was lost then. */
"use strict";

const { worker: { Record } } = require("./given.js");

console.log(JSON.stringify(JSON.parse(process.argv[2]).map(([count, episodes]) => {
  const record = new Record(count), lost = [];
  for (const [begun, coin, normal, earned] of episodes) {
    record.choose(begun, coin, normal);
    lost.push(record.lost());
    record.add(...earned);
  }
  return [record.played, lost];
})));
