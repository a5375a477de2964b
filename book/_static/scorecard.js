/* The claims with one verdict, of one page, or both. */
"use strict";

for (const root of document.querySelectorAll(".scorecard")) {
  const filter = root.querySelector(".filter"), chosen = [...filter.querySelectorAll("select")];
  const show = () => {
    let count = 0;
    for (const claim of root.querySelectorAll("li")) {
      claim.hidden = chosen.some(({ name, value }) => value && claim.dataset[name] !== value);
      count += !claim.hidden;
    }
    filter.querySelector("output").textContent = `${count} claim${count === 1 ? "" : "s"}`;
  };
  filter.hidden = false;
  filter.addEventListener("change", show);
  chosen.find(({ name }) => name === "verdict").value = "not reproduced"; // what a reader asks first
  show();
}
