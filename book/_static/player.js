/* A recording that is played, paused, or dragged to any place. */
"use strict";

globalThis.Player = class {
  /* last: the recording's last place; a second takes it so much further; squares: what is drawn. */
  constructor(root, last, aSecond, squares) {
    this.squares = squares;
    this.button = root.querySelector("button");
    this.range = root.querySelector("input");
    this.output = root.querySelector("output");
    this.last = last;
    this.aSecond = aSecond;
    this.playing = false;
    this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
    this.range.addEventListener("input", () => this.pause());
    for (const touch of ["pointerdown", "keydown"]) root.addEventListener(touch, () => this.seen?.disconnect());
    new MutationObserver(() => this.show()).observe(document.documentElement, {
      attributeFilter: ["data-theme"], // walls take the colour of the page's ink
    });
    this.show();
    this.playWhenSeen(root);
  }

  get place() {
    return Number(this.range.value);
  }

  /* Once, and not for those who want no motion. */
  playWhenSeen(root) {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.seen = new IntersectionObserver((entries) => {
      if (!entries.some((one) => one.isIntersecting)) return;
      this.seen.disconnect();
      this.play();
    }, { threshold: 0.6 });
    this.seen.observe(root);
  }

  play() {
    this.playing = true;
    this.button.textContent = "Pause";
    const from = this.place % this.last, began = performance.now();
    const frame = (now) => {
      if (!this.playing) return;
      const gone = Math.max(0, now - began) / 1000;
      this.range.value = Math.min(this.last, Math.round(from + this.aSecond * gone));
      this.show();
      if (this.place < this.last) requestAnimationFrame(frame);
      else this.pause();
    };
    requestAnimationFrame(frame);
  }

  pause() {
    this.playing = false;
    this.button.textContent = "Play";
    this.show();
  }
};
