/* Small repairs that make the built pages complete without a server or a third party. */

/* Where a browser blocks storage, to read it raises: the theme then remembers its mode on this page alone. */
for (const name of ["localStorage", "sessionStorage"]) {
  try {
    window[name].getItem("mode");
  } catch {
    const kept = new Map();
    const storage = {
      getItem: (key) => kept.get(key) ?? null,
      setItem: (key, value) => kept.set(key, String(value)),
      removeItem: (key) => kept.delete(key),
    };
    Object.defineProperty(window, name, { value: storage });
    Object.assign(document.documentElement.dataset, { mode: "", theme: "" });
  }
}

/* Paper is white: what is printed from the dark theme is printed in the light one. */
(function () {
  const root = document.documentElement;
  let before = null;
  matchMedia("print").addEventListener("change", ({ matches }) => {
    if (matches) before = root.dataset.theme;
    root.dataset.theme = matches ? "light" : before;
  });
})();

/* The search looks words up in plain objects, where "constructor" is always found and is no page. */
document.addEventListener("DOMContentLoaded", () => {
  if (typeof Search === "undefined") return;
  const { hasOwnProperty } = Object.prototype;
  for (const words of [Search._index?.terms, Search._index?.titleterms]) {
    if (words) Object.setPrototypeOf(words, Object.create(null, { hasOwnProperty: { value: hasOwnProperty } }));
  }
});

/* No line ends within the name of an algorithm, such as 1-MGVT. */
document.addEventListener("DOMContentLoaded", () => {
  const apart = "code, pre, script, select, style, svg, .math, .sig, .race, .trainer";
  const article = document.querySelector(".bd-article") ?? document.createElement("div");
  const texts = document.createTreeWalker(article, NodeFilter.SHOW_TEXT);
  const found = [];
  while (texts.nextNode()) {
    const text = texts.currentNode;
    if (/\d-MGVT/.test(text.data) && !text.parentElement.closest(apart)) found.push(text);
  }
  for (const text of found) {
    const parts = text.data.split(/\b(\d-MGVT)\b/).map((part, at) => {
      if (at % 2 === 0) return part;
      const whole = Object.assign(document.createElement("span"), { className: "whole" });
      whole.append(part);
      return whole;
    });
    text.replaceWith(...parts);
  }
});

/* The sliders' script asks MathJax 2 to typeset its labels; this answers with MathJax 3. */
(function () {
  let mathjax = window.MathJax;
  const loaded = new Promise((resolve) => {
    if (document.readyState === "complete") resolve();
    else window.addEventListener("load", resolve);
  });
  let queue = loaded.then(() => mathjax?.startup?.promise);
  const hub = {
    Queue(...jobs) {
      for (const [, , element] of jobs) {
        queue = queue
          .then(() => mathjax?.typesetPromise?.([element]))
          .catch((error) => console.warn("a label was not typeset:", error));
      }
    },
  };
  const withHub = (value) => {
    if (value && typeof value === "object" && !value.Hub) value.Hub = hub;
    return value;
  };
  /* MathJax replaces the global object while it starts, hence an accessor. */
  Object.defineProperty(window, "MathJax", {
    configurable: true,
    enumerable: true,
    get: () => mathjax,
    set: (value) => { mathjax = withHub(value); },
  });
  if (mathjax) withHub(mathjax);
})();

/* Slider handles get a spoken name (the tooltip, else the label) and a spoken value (the readout).
   Where they stand can be linked: #lambda=2&psi=1, by the first words of those names. */
(function () {
  const linked = new URLSearchParams(location.hash.includes("=") ? location.hash.slice(1) : "");
  addEventListener("hashchange", () => location.hash.includes("=") && location.reload());
  const known = new WeakSet();
  const keep = (name, value) => {
    linked.set(name, value);
    history.replaceState(null, "", `#${linked}`);
  };
  const link = (slider, name) => {
    const track = slider.querySelector(".noUi-target").noUiSlider;
    if (known.has(track)) return;
    known.add(track);
    track.on("change", ([index]) => keep(name, index));
    if (!linked.has(name)) return;
    track.set(linked.get(name));
    slider.scrollIntoView({ block: "center" });
  };
  const plain = (text) => text.replace(/\\[()]|[\\$]/g, "").trim();
  const say = (handle, attribute, text) => {
    if (text && handle.getAttribute(attribute) !== text) handle.setAttribute(attribute, text);
  };
  const describe = (slider) => {
    const handle = slider.querySelector(".noUi-handle");
    const label = slider.querySelector(".widget-label");
    const readout = slider.querySelector(".widget-readout");
    if (!handle || !label || !readout) return;
    const tooltip = label.title === "null" ? "" : label.title;
    const typeset = label.querySelector("mjx-assistive-mml");
    if (tooltip) link(slider, tooltip.split(",")[0]);
    say(handle, "aria-label", plain(tooltip || (typeset ?? label).textContent));
    say(handle, "aria-valuetext", plain(readout.textContent));
  };
  document.addEventListener("DOMContentLoaded", () => {
    const all = () => document.querySelectorAll(".widget-slider").forEach(describe);
    new MutationObserver(all).observe(document.body, {
      attributeFilter: ["aria-valuetext", "title"],
      characterData: true,
      childList: true,
      subtree: true,
    });
    all();
  });
})();

/* The arrows that fold the table of contents get a spoken name: the theme gives them none. */
document.addEventListener("DOMContentLoaded", () => {
  for (const arrow of document.querySelectorAll(".bd-sidebar-primary summary")) {
    const chapter = arrow.closest("li")?.querySelector("a")?.textContent.trim();
    arrow.setAttribute("aria-label", `Pages of ${chapter ?? "this part"}`);
  }
});

/* In the table of contents the thesis and what follows it are folded, but where the reader is. */
document.addEventListener("DOMContentLoaded", () => {
  for (const caption of [...document.querySelectorAll(".bd-sidebar-primary p.caption")].slice(2)) {
    const list = caption.nextElementSibling, part = document.createElement("details");
    const summary = document.createElement("summary");
    part.className = "part";
    part.open = list.querySelector(".current, .active") !== null;
    caption.before(part);
    summary.append(caption);
    part.append(summary, list);
  }
});

/* Pages opened from disk may not read each other, so search there shows titles without excerpts. */
if (location.protocol === "file:" && typeof DOCUMENTATION_OPTIONS !== "undefined") {
  DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
}

/* A list of references calls itself a list, and its entries something else: a spoken list of nothing. */
document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll(".citation-list[role=list]").forEach((list) => list.removeAttribute("role"));
});

/* Figures change light and dark in the dark theme; what calls a thing black or white says so there. */
document.addEventListener("DOMContentLoaded", () => {
  for (const words of document.querySelectorAll("figcaption, .bd-article section > p")) {
    if (/\b(black|white)\b/.test(words.innerText)) words.classList.add("names-shades");
  }
});

/* The theme looks for what keys can scroll when the window changes: so does the column with a sidebar. */
document.addEventListener("DOMContentLoaded", () => {
  const column = document.querySelector(".bd-article");
  let before = column?.clientWidth;
  const look = new ResizeObserver(() => {
    if (column.clientWidth === before) return;
    before = column.clientWidth;
    window.dispatchEvent(new Event("resize"));
  });
  if (column) look.observe(column);
});
