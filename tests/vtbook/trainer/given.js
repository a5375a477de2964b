/* What a page hands to its trainer, written by the tests into the file that VTLIB_TRAINER names. */
"use strict";

const { pool, ...setup } = JSON.parse(require("node:fs").readFileSync(process.env.VTLIB_TRAINER, "utf8"));
module.exports = { setup, pool: new Int8Array(Buffer.from(pool, "base64")) };
