"""What each deviation changes, from stored runs: its table, its figure, the corner's sources."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vtlib.experiments.deviations import (
    COUNTS,
    DEVIATION_ITERATIONS,
    DEVIATIONS,
    GROUPS,
    HIGHER,
    LOWER,
    NONE,
    OPEN,
    PUBLISHED,
    ROOMS_DEVIATIONS,
    Comparison,
    DeviatingSettings,
    Deviation,
)
from vtlib.experiments.protocol import html_table
from vtlib.experiments.reading import returns
from vtlib.experiments.rooms import ROOMS_EVALUATION
from vtlib.plots import COLOURS, BookFigure, look
from vtlib.stats import Interval, difference_interval
from vtlib.store import Arrays

MARKERS = {"GVT": "s", "1-MGVT": "o", "3-MGVT": "D"}
PANELS = {"mean over the run": "over", "at its end": "end"}
LIMITS, TICKS = (-1.1, 0.25), (-1.0, -0.75, -0.5, -0.25, 0.0)
LINK = re.compile(r"\[([^|\]]+)\|([^\]]+)\]")
MINUS = "\N{MINUS SIGN}"
HEAD = ("What", "The thesis", "The published code", "Here")


@dataclass(frozen=True)
class Effect:
    """The other choice minus ours, paired by run, as shares of each run's planned optimum.

    over: of the mean learning return over the run; end: of the last one, after ``iterations``.
    """

    comparison: Comparison
    over: Interval
    end: Interval
    iterations: int

    @property
    def outcome(self) -> str:
        """What the other choice does to the mean over the run."""
        return outcome(self.over)


def effect_of(comparison: Comparison) -> Effect:
    """The effect of one comparison, as long as both ran, and not past `DEVIATION_ITERATIONS`."""
    both = [returns(*comparison.other), returns(*comparison.here)]
    last = min(DEVIATION_ITERATIONS, *(int(runs.iterations[-1]) for runs in both))
    shares = [runs.learning[:, runs.iterations <= last] / runs.optimum[:, None] for runs in both]
    over = difference_interval(*(share.mean(1) for share in shares))
    end = difference_interval(*(share[:, -1] for share in shares))
    return Effect(comparison, over, end, last)


def identical_runs(comparison: Comparison) -> int:
    """How many runs earn the same to the last bit, as long as both ran."""
    other, here = returns(*comparison.other), returns(*comparison.here)
    shared = min(len(other.iterations), len(here.iterations))
    alike = [
        (getattr(other, kind)[:, :shared] == getattr(here, kind)[:, :shared]).all(1)
        for kind in ("learning", "greedy")
    ]
    return int((alike[0] & alike[1]).sum())


def outcome(effect: Interval) -> str:
    """Whether an effect counts: its interval excludes zero, and it is as large as ``COUNTS``.

    There is none when the whole interval is smaller than that; otherwise it is undecided.
    """
    centre, low, high = map(float, effect)
    if abs(centre) >= COUNTS and low * high > 0:
        return HIGHER if centre > 0 else LOWER
    return NONE if max(-low, high) < COUNTS else OPEN


def every_effect(deviations: Sequence[Deviation] = DEVIATIONS) -> dict[str, list[Effect]]:
    """The effects of each deviation, by its name, in the table's order."""
    return {one.what: [effect_of(x) for x in one.comparisons] for one in deviations}


def table(effects: Mapping[str, Sequence[Effect]]) -> str:
    """What each says and does, and below it what the other choice changes, as HTML."""
    head = "".join(f"<th>{escape(x)}</th>" for x in HEAD)
    body = "".join(
        f"<tbody><tr><th colspan='{len(HEAD)}'>{escape(group)}</th></tr></tbody>"
        + "".join(_row(one, effects[one.what]) for one in deviations)
        for group, deviations in GROUPS.items()
    )
    return f"<table class='claims deviations'><thead><tr>{head}</tr></thead>{body}</table>"


def _row(one: Deviation, effects: Sequence[Effect]) -> str:
    said = (one.thesis, one.published, one.here)
    cells = "".join(
        f"<td data-label='{escape(label)}'>{linked(text)}</td>"
        for label, text in zip(HEAD[1:], said, strict=True)
    )
    measured = "<br>".join([f"<em>Otherwise: {linked(one.other)}</em>", *map(_numbers, effects)])
    return (
        f"<tbody><tr><td rowspan='2'>{linked(one.what)}</td>{cells}</tr>"
        f"<tr><td colspan='{len(said)}'>{measured}</td></tr></tbody>"
    )


def _numbers(effect: Effect) -> str:
    name = f"<strong>{escape(_name(effect.comparison))}</strong>"
    return f"{name}: {percent(effect.over)} over the run, {percent(effect.end)} at the end"


def percent(effect: Interval) -> str:
    """An interval in hundredths of the optimum."""
    centre, low, high = (_signed(100 * float(x)) for x in effect)
    return f"{centre}% ({low} to {high})"


def _signed(value: float) -> str:
    text = f"{value:+.1f}"
    return "0.0" if float(text) == 0 else text.replace("-", MINUS)


def linked(text: str) -> str:
    """Text as HTML, with ``[page#target|words]`` as links."""
    return LINK.sub(r"<a href='\1'>\2</a>", escape(text, quote=False))


def expectations_table(effects: Mapping[str, Sequence[Effect]]) -> str:
    """What was expected of each effect that had not been seen before, and what came, as HTML."""
    rows = [
        [f"{what}: {_name(one.comparison)}", one.comparison.expected, one.outcome]
        for what, each in effects.items()
        for one in each
        if one.comparison.expected
    ]
    return html_table(["deviation", "expected", "came"], rows)


def changes_table() -> str:
    """What each stored algorithm has otherwise than its twin in the rooms evaluation, as HTML."""
    rows = []
    for label, algorithm in ROOMS_DEVIATIONS.algorithms.items():
        twin = "GVT" if label.startswith("GVT") else "1-MGVT"
        base = asdict(DeviatingSettings(**asdict(ROOMS_EVALUATION.algorithms[twin])))
        changed = {k: v for k, v in asdict(algorithm).items() if v != base[k]}
        rows.append([label, ", ".join(f"{k} = {v}" for k, v in changed.items())])
    return html_table(["stored result", "parameters that differ"], rows)


def _name(one: Comparison) -> str:
    return f"{one.algorithm}, {one.note}" if one.note else one.algorithm


def effects_figure(effects: Mapping[str, Sequence[Effect]]) -> Figure:
    """Every effect with its interval, a row for each deviation, over the run and at its end."""
    with look():
        figure = BookFigure(figsize=(7.6, 0.42 * len(effects) + 1.3))
        axes = figure.subplots(1, len(PANELS), sharex=True, sharey=True)
        for ax, (title, kind) in zip(axes, PANELS.items(), strict=True):
            ax.axvspan(-COUNTS, COUNTS, color="#e9e9e9", lw=0)
            ax.axvline(0, color="#1a1a1a", lw=0.9)
            ax.axhline(len(PUBLISHED) - 0.5, color="#8a8a8a", lw=0.8, ls=":")
            for row, each in enumerate(effects.values()):
                for place, effect in zip(_places(len(each)), each, strict=True):
                    _draw(ax, row + place, effect.comparison, getattr(effect, kind))
            ax.set_title(title)
            ax.set(xlabel="difference, share of the optimum", xlim=LIMITS, xticks=TICKS)
            ax.xaxis.set_major_formatter(lambda x, _: f"{x:g}".replace("-", MINUS))
            ax.grid(False, axis="y")
        axes[0].set_yticks(range(len(effects)), list(effects))
        axes[0].set_ylim(len(effects) - 0.4, -0.6)
        handles, labels = axes[0].get_legend_handles_labels()
        found = dict(zip(labels, handles, strict=True))
        shown = [found[label] for label in MARKERS if label in found]
        figure.legend(handles=shown, loc="outside lower center", ncols=len(shown))
    return figure


def _places(count: int) -> list[float]:
    return [0.3 * (at - (count - 1) / 2) for at in range(count)]


def _draw(ax: Axes, y: float, one: Comparison, effect: Interval) -> None:
    centre, low, high = map(float, effect)
    ax.errorbar(
        centre,
        y,
        xerr=[[centre - low], [high - centre]],
        color=COLOURS[one.algorithm],
        marker=MARKERS[one.algorithm],
        ms=4.5,
        lw=1.4,
        label=one.algorithm,
    )
    if one.note:
        ax.annotate(
            one.note, (low, y), (-4, 0), textcoords="offset points", ha="right", va="center", size=8
        )


@dataclass(frozen=True)
class SourceCounts:
    """Of a pool's sources: how many there are, were ever rewarded, and passed their check."""

    count: int
    rewarded: int
    solved: int


def source_counts(sources: Arrays, by: int) -> SourceCounts:
    """What had become of a pool's sources by an iteration.

    Weights start at zero and stay there until the first reward, for without one every TD error is
    zero.
    """
    rewarded = np.any(sources["weights"] != 0, axis=1)
    in_time = sources["solved"] & (sources["iterations"] <= by)
    return SourceCounts(len(rewarded), int(rewarded.sum()), int(in_time.sum()))
