"""Numbers that the pages print, computed again from the stored arrays with NumPy alone."""

import re
from pathlib import Path

import numpy as np
from bs4 import BeautifulSoup
from scipy import stats

RESULTS = Path(__file__).resolve().parents[2] / "book" / "results"
END = 10**6
FLOOR = -(1 - 0.99**200) / (1 - 0.99)  # the return of a car that never arrives
NUMBER = r"[−+-]?\d[\d,.]*%?"
SHARE, SHARES, COUNT, HALF = r"(\d+%)", r"(\d+%(?: \d+%)+)", r"(\d+)", r"([−+-][\d.]+ ± [\d.]+)"
RANGE = rf"({NUMBER} \({NUMBER} to {NUMBER}\))"  # a number and its interval
SAYS = rf".*?Our runs: {RANGE}"
ROOMS, OTHER, SEARCH = "rooms-evaluation", "rooms-distribution-change", "rooms-exploration"
LIKELY, FEW, MEAN = "rooms-likelihood", "rooms-number-of-sources", "fine-tuned mean"
POLE, CAR, MAZE, PRIOR = "cartpole", "mountain-car", "maze-8", "rooms-evaluation-prior-weight"
GENTLE = "GVT, weight 0.1", "1-MGVT, weight 0.1"
NT_OF = {f"maze-{n}": f"maze-{n}-no-transfer" for n in (0, 6, 13)} | {MAZE: "maze-no-transfer"}


def stored(name, label, key="learning"):
    with np.load(RESULTS / name / f"{label}.npz") as arrays:
        return arrays[key].astype(float)


def shares(name, label, chosen):
    floor, optimum = FLOOR * name.startswith(CAR), stored(name, "tasks", "optimum").mean()
    return (stored(name, label)[:, chosen] - floor) / (optimum - floor)


def at(name, label, t):
    return shares(name, label, stored(name, label, "iterations") == t)[:, 0]


def until(name, label, t=END):
    return shares(name, label, stored(name, label, "iterations") <= t).mean(1)


def interval(values):
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return values.mean(), values.mean() - half, values.mean() + half


def gain(name, a, b, t=END):
    return interval(until(name, a, t) - until(name, b, t))


def points(name, a, b):
    centre, low, _ = gain(name, a, b)
    return 100 * centre, 100 * (centre - low)


def lead(name, a, b, t=END):
    return 100 * gain(name, a, b, t)[0]


def over_reuse(name):
    ours, reuse = (name + "-trust", "trust"), (name + "-trust-parts", "policy reuse")
    return 100 * (until(*ours) - until(*reuse)).mean()


def mean_at(name, label, t):
    return at(name, label, t).mean()


def mean_until(name, label, *times):
    return [until(name, label, t).mean() for t in times]


def in_mazes(label):
    return [until(name, label).mean() for name in ("maze-0", "maze-6", MAZE, "maze-13")]


def over_mazes(a, b):
    earned = [[until(NT_OF[m] if x[:2] == "NT" else m, x) for m in NT_OF] for x in (a, b)]
    return interval(np.subtract(*earned).ravel())


def at_six_doors(a, b, t):
    """A difference at the least likely doors, each with the mean over its twenty runs."""
    door, own = stored(LIKELY, "tasks", "doors")[:, 0], stored(LIKELY, "tasks", "optimum")
    gap = (at(LIKELY, a, t) - at(LIKELY, b, t)) * own.mean() / own
    return interval(gap[(door < 1.6) | (door > 8.4)].reshape(-1, 20).mean(1))


def cells(label):
    """How many unit cells of the lower room each run (R,) visits."""
    visits = stored(SEARCH, label, "visited")
    return np.array([len({(min(int(x), 9), int(y)) for x, y in run if y < 5}) for run in visits])


def held(label, level):
    return interval(stored("rooms-calibration", label, "inside")[:, -1, 1, level])


# page, words around the number, and what computes it from what
NUMBERS = [
    (
        "index",
        f"like it end, on average, at {SHARE}",
        mean_at,
        ROOMS + "-controls",
        "1-MGVT",
        5_000,
    ),
    (
        "index",
        f"average earns {COUNT} percentage points less",
        lead,
        ROOMS + "-controls",
        "1-MGVT",
        MEAN,
    ),
    ("index", f"changed what it earns over four mazes by {RANGE}", over_mazes, "1-MGVT", "NT"),
    ("index", f"left alone, averages {SHARE}", mean_until, CAR + "-untouched", "untouched", END),
    (ROOMS, f"2,000 steps it earns {SHARE}", mean_at, ROOMS + "-controls", "1-MGVT", 2_000),
    (ROOMS, f"of the mean then earns {SHARE}", mean_at, ROOMS + "-controls", MEAN, 2_000),
    ("scorecard", f"GVT is ahead of no transfer{SAYS}", gain, ROOMS, "GVT", "NT", 14_900),
    ("scorecard", f"surpasses GVT{SAYS}", gain, ROOMS, "1-MGVT", "GVT", 14_900),
    (ROOMS, f"over 5,000 steps, is {RANGE}", gain, ROOMS + "-controls", "1-MGVT", MEAN),
    (OTHER, f"over 5,000 steps, is {RANGE}", gain, OTHER + "-controls", "1-MGVT", MEAN),
    (SEARCH, f"explore at random only {COUNT} do", lambda: (stored(SEARCH, "NT").max(1) > 0).sum()),
    ("scorecard", f"GVT: cells visited{SAYS}", lambda: interval(cells("1-MGVT") - cells("GVT"))),
    ("scorecard", f"At 1,000 iterations GVT falls{SAYS}", at_six_doors, "GVT", "1-MGVT", 1_000),
    (LIKELY, f"fine-tuning of the mean by {RANGE}", at_six_doors, "1-MGVT", MEAN, 1_000),
    (FEW, f"with one component\\) earns {SHARE}", mean_at, FEW, "1-MGVT-from-2", 1_950),
    ("scorecard", f"1-MGVT is not behind DDQN{SAYS}", gain, POLE, "1-MGVT", "DDQN", 8_900),
    (POLE, f"steps 1-MGVT earns {COUNT}", lead, POLE + "-controls", "1-MGVT", MEAN, 500),
    (CAR, f"steps 1-MGVT has come {SHARE}", mean_at, CAR, "1-MGVT", 40_000),
    (CAR, f"GVT {SHARES} 1-MGVT", mean_until, CAR, "GVT", 5_000, 10_000, END),
    ("mazes", f"ends at {SHARE}", mean_at, MAZE, "1-MGVT", 20_000),
    ("mazes", f"1-MGVT {SHARES}", in_mazes, "1-MGVT"),
    ("mazes", f"guide, minus NT {RANGE}", over_mazes, "NT, guided", "NT"),
    ("prior_weight", f"at 0.1: GVT minus 1-MGVT {RANGE}", gain, PRIOR, *GENTLE),
    ("controls", f"λ = 0 {HALF}", points, ROOMS + "-controls", "1-MGVT", "1-MGVT, lambda 0"),
    ("controls", f"mean, three rooms {HALF}", points, ROOMS + "-controls", "1-MGVT", MEAN),
    ("comparison", f"untouched {RANGE}, less", gain, ROOMS + "-compared", "untouched", "1-MGVT"),
    ("trust_in_full", f"untouched: {RANGE}", gain, POLE + "-trust", "trust", "untouched"),
    ("trust_in_full", f"no transfer: {RANGE}", gain, MAZE + "-trust", "trust", "NT"),
    ("recommended", f"two wirings \\), Trust earns {COUNT} points", over_reuse, "wired-cartpole"),
    ("calibration", f"with one component, contain {RANGE}", held, "1-MGVT", 2),
]


def agrees(printed, value):
    """Whether a number is a value rounded to the digits that are printed."""
    digits = printed.strip("%.,").replace(",", "").replace("−", "-")
    value = 100 * value if "%" in printed else value
    return abs(float(digits) - value) < 0.501 * 10.0 ** -len(digits.partition(".")[2])


def test_printed_numbers_are_what_the_stored_files_say(book):
    wrong = []
    for page, words, compute, *of in NUMBERS:
        path = book / "book" / f"{page.replace('-', '_')}.html"
        html = BeautifulSoup(path.read_text(encoding="utf-8"), "html.parser")
        found = re.search(words, " ".join(html.select_one("article").get_text(" ").split()))
        printed = re.findall(NUMBER, found[1]) if found else []
        values = np.ravel(compute(*of))
        if len(printed) != len(values) or not all(map(agrees, printed, values)):
            wrong.append(f"{page}: {found[0][-80:] if found else words} is {values}")
    assert not wrong, "\n".join(wrong)
