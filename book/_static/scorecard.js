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
  /* What a reader asks first; or the claims of the page that the reader comes from. */
  const [verdict, page] = chosen, follow = () => {
    const from = location.hash.replace("#claims-", "").replaceAll("-", "_");
    page.value = [...page.options].some(({ value }) => value === from) ? from : "";
    verdict.value = page.value ? "" : "not reproduced";
    show();
  };
  addEventListener("hashchange", follow);
  follow();
}
