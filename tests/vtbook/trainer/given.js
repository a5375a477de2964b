/* What a page hands to its trainer, written by the tests into the file that VTLIB_TRAINER names, and the
   scripts of panels, several read as one, as a page has them. */
"use strict";

const fs = require("node:fs");
const path = require("node:path");

const STATIC = path.resolve(__dirname, "..", "..", "..", "book", "_static");
const { pool, ...given } = JSON.parse(fs.readFileSync(process.env.VTLIB_TRAINER, "utf8"));
const bytes = Uint8Array.from(Buffer.from(pool, "base64"));

/* The named parts of some scripts. */
const read = (files, names) => {
  const text = files.map((name) => fs.readFileSync(path.join(STATIC, name), "utf8")).join("\n");
  return new Function(`${text}\nreturn { ${names} };`)();
};

const KINDS = { 226: "cartpole", 387: "mountain_car" }; // by their weights
const kind = KINDS[given.weights];
const scripts = [...(kind ? ["stage_drive.js", `stage_${kind}.js`] : ["stage_rooms.js"]), "trainer.js"];
const panel = read(scripts, `STAGE, NUMBERS, chosen, lambdaOf, scientific, weightOf${kind ? ", byHand" : ", colour, held, moved, shareOf, wallsOf"}`);
const worker = read(["promises.js", "trainer_worker.js", "stage_rooms_worker.js"], "Record, Run, Training, bandsOf, choose, decodePool, gaussianPrior, features, mapsOf");
const { states, arrives } = panel.STAGE;
module.exports = {
  STATIC, panel, worker, setup: { ...given, states, arrives },
  pool: new Int16Array(bytes.buffer),
};
