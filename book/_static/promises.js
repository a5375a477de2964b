/* The recommended method's choices in the page: as vtlib/promises.py, which says what each number means. */
"use strict";

const [WIDE, LOOKS, RECENT, AHEAD, ENOUGH, MARGIN, KEPT] = [10, 32, 20, 1, 10, 0.5, 0.5];
const SHARES = [0, ...Array.from({ length: 200 }, (_, i) => (i + 0.5) / 200)];

const averageOf = (x) => x.reduce((total, y) => total + y, 0) / x.length;
const spreadOf = (x) => Math.sqrt(Math.max(0, averageOf(x.map((y) => (y - averageOf(x)) ** 2))));

const evidence = (short) => WIDE * Math.exp((-(short ** 2) * (1 - WIDE ** -2)) / 2);

/* Probabilities that tried sources are of the task's kind, and that another one is, by their evidence. */
function beliefs(factors) {
  const either = (share, factor) => share * factor + 1 - share;
  const logs = SHARES.map((share) =>
    factors.reduce((total, factor) => total + Math.log(either(share, factor)), Math.log(share ? 0.5 / 200 : 0.5)));
  const top = Math.max(...logs), weights = logs.map((x) => Math.exp(x - top)), all = weights.reduce((a, b) => a + b);
  const over = (what) => SHARES.reduce((total, share, i) => total + (weights[i] / all) * what(share), 0);
  return { own: factors.map((factor) => over((share) => (share * factor) / either(share, factor))), another: over((share) => share) };
}

/* What a run has seen of its sources and of what it has learned, which is the last arm. */
class Record {
  constructor(count) {
    Object.assign(this, { count, played: [], gained: [], short: [], trust: 0 });
  }

  add(gained, promise, spread) {
    const missing = Math.max(promise - gained, 0);
    this.gained.push(gained);
    this.short.push(spread > 0 ? missing / spread : 2 * WIDE * (missing > 0));
  }

  /* The arm of the next episode, by a uniform number and a normal one for each source. */
  choose(begun, coin, normal) {
    const { kept, another } = this.kept(), tried = this.tried();
    const fresh = Array.from({ length: this.count }, (_, j) => j).filter((j) => !tried.includes(j)).slice(0, 1);
    const hope = coin < another ? fresh : [];
    const arm = () => {
      if (!begun) return kept.length ? this.draw(kept, hope, normal) : (fresh[0] ?? this.best());
      if (this.looks()) return this.count;
      if (kept.length) return this.lead(this.returns(this.best())) >= -AHEAD ? this.draw(kept, hope, normal) : this.count;
      if (this.lead(this.returns(this.best())) > AHEAD) return this.best();
      return coin < 0.5 && this.stuck() ? this.draw(tried, fresh, normal) : this.count;
    };
    this.trust = another;
    this.played.push(arm());
    return this.played.at(-1);
  }

  tried() {
    return [...new Set(this.played.slice(0, this.gained.length))].filter((j) => j < this.count).sort((a, b) => a - b);
  }

  of(values, arm) {
    return values.filter((_, i) => this.played[i] === arm);
  }

  returns(arm) {
    return this.of(this.gained, arm);
  }

  kept() {
    const tried = this.tried(), { own, another } = beliefs(tried.map((j) => evidence(averageOf(this.of(this.short, j)))));
    return { kept: tried.filter((_, i) => own[i] > KEPT), another };
  }

  best() {
    const means = this.tried().map((j) => [averageOf(this.returns(j)), j]);
    return means.reduce((one, other) => (other[0] > one[0] ? other : one), [-Infinity, 0])[1];
  }

  recent() {
    return this.returns(this.count).slice(-RECENT);
  }

  /* Whether what was learned has earned no more lately than the least that was ever earned. */
  lost() {
    const recent = this.recent(), own = recent.length ? recent : this.gained;
    return own.length > 0 && Math.max(...own) <= Math.min(...this.gained);
  }

  lead(returns) {
    const own = this.recent(), scale = this.gained.length ? spreadOf(this.gained) : 0;
    return returns.length && own.length && scale ? (averageOf(returns) - averageOf(own)) / scale : 0;
  }

  stuck() {
    const theirs = this.gained.filter((_, i) => this.played[i] < this.count);
    const error = Math.sqrt(1 / Math.max(1, theirs.length) + 1 / Math.max(1, this.recent().length));
    return this.lead(theirs) >= -MARGIN * error && this.returns(this.count).length >= ENOUGH;
  }

  looks() {
    const episode = this.played.length + 1;
    return episode >= LOOKS && !(episode & (episode - 1));
  }

  /* Thompson sampling among sources, which are alike beforehand. */
  draw(kept, hope, normal) {
    const arms = [...kept, ...hope], every = kept.flatMap((j) => this.returns(j));
    const centre = every.length ? averageOf(every) : 0, scale = (every.length && spreadOf(every)) || 1;
    const drawn = arms.map((j, i) => {
      const own = i < kept.length ? this.returns(j) : [], count = own.length + 1;
      return (own.reduce((a, b) => a + b, 0) + centre) / count + (scale / Math.sqrt(count)) * normal[j];
    });
    return arms[drawn.indexOf(Math.max(...drawn))];
  }
}

if (typeof module !== "undefined") module.exports = { Record, beliefs, evidence };
