"""Tables of how a figure was computed: settings once each, costs added up, robust numbers."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from vtlib.claims import Returns
from vtlib.experiments import EXPERIMENTS, ROOMS_EXPLORATION, ROOMS_SOURCES, protocol
from vtlib.experiments.protocol import (
    alike,
    cost_table,
    html_table,
    robust_table,
    settings_table,
    tables,
)
from vtlib.experiments.reading import provenance, returns
from vtlib.experiments.rooms import GVT, MGVT, NT, SOURCE_COUNTS
from vtlib.stats import (
    Interval,
    bootstrap_interval,
    improvement_interval,
    interquartile_mean,
    mean_interval,
)
from vtlib.streams import generator

NAME = ROOMS_EXPLORATION.name
LABELS = ["GVT", "1-MGVT", "NT"]


def rows_of(html: str) -> list[list[str]]:
    """Text of every cell, row by row, the head first."""
    rows = re.findall(r"<tr>(.*?)</tr>", html)
    return [[unescape(x) for x in re.findall(r"<t[hd]>(.*?)</t[hd]>", row)] for row in rows]


def numbers(cell: str) -> tuple[float, ...]:
    """Centre, low and high end of an interval."""
    return tuple(float(x) for x in re.fullmatch(r"(\S+) \((\S+) to (\S+)\)", cell).groups())


def shown(value: Interval) -> str:
    return f"{value.centre:.2f} ({value.low:.2f} to {value.high:.2f})"


def test_algorithms_that_differ_only_in_their_sources_are_alike():
    groups = alike(ROOMS_SOURCES)
    assert len(groups) == 5
    assert groups[GVT] == [f"GVT-from-{n}" for n in SOURCE_COUNTS]
    assert groups[replace(MGVT, components=2)] == [f"2-MGVT-from-{n}" for n in SOURCE_COUNTS]
    assert [label for labels in groups.values() for label in labels] == list(
        ROOMS_SOURCES.algorithms
    )


def test_algorithms_of_different_parameters_are_not_alike():
    algorithms = ROOMS_EXPLORATION.algorithms
    assert alike(ROOMS_EXPLORATION) == {one: [label] for label, one in algorithms.items()}
    near = replace(ROOMS_EXPLORATION, algorithms={"a": GVT, "b": replace(GVT, psi=0.51), "c": GVT})
    assert alike(near) == {GVT: ["a", "c"], replace(GVT, psi=0.51): ["b"]}


def test_the_settings_have_one_column_for_each_distinct_setting(monkeypatch):
    head, *rows = rows_of(settings_table(NAME))
    assert head == ["parameter", *ROOMS_EXPLORATION.algorithms]
    monkeypatch.setitem(EXPERIMENTS, ROOMS_SOURCES.name, ROOMS_SOURCES)
    head, *rows = rows_of(settings_table(ROOMS_SOURCES.name))
    assert head == [
        "parameter",
        *(
            f"{a}-from-2 to {a}-from-10"
            for a in ("2-MGVT", "GVT", "GVT-span", "1-MGVT", "1-MGVT-mean")
        ),
    ]
    cells = {name: values for name, *values in rows}
    assert cells["components"] == ["2", "1", "1", "1", "1"]
    assert cells["init"] == ["sources", "sources", "span", "sources", "mean"]
    assert cells["lambda_"] == ["1e-06", "0.0001", "0.0001", "1e-06", "1e-06"]


def test_a_parameter_that_an_algorithm_lacks_is_left_empty():
    head, *rows = rows_of(settings_table(NAME))
    cells = {name: dict(zip(head[1:], values, strict=True)) for name, *values in rows}
    assert cells["epsilon_steps"] == {"GVT": "", "GVT-span": "", "1-MGVT": "", "NT": "1400"}
    assert cells["lambda_"]["NT"] == ""
    assert cells["psi"]["NT"] == f"{NT.psi:g}"
    assert len(cells) == len(rows)


def test_the_cost_adds_up_what_is_alike(monkeypatch):
    notes = {note["label"]: note for note in provenance(NAME)}
    _, *rows = rows_of(cost_table(NAME))
    pool = ROOMS_EXPLORATION.pool.name
    named = {f"{pool}/sources": "sources", f"{NAME}/tasks": "tasks"}
    named |= {f"{NAME}/{label}": label for label in ROOMS_EXPLORATION.algorithms}
    assert [row[0] for row in rows] == list(named)
    for row, label in zip(rows, named.values(), strict=True):
        assert row[1] == f"{notes[label]['seconds']:.0f}"
        assert row[2] == notes[label]["machine"]["processor"]
    # were the parameters of all of them equal, they would share a row
    equal = replace(ROOMS_EXPLORATION, algorithms=dict.fromkeys(ROOMS_EXPLORATION.algorithms, GVT))
    monkeypatch.setattr(protocol, "named", lambda name: equal)
    _, *rows = rows_of(cost_table(NAME))
    assert [row[0] for row in rows[2:]] == [f"{NAME}/GVT to NT"]
    total = sum(notes[label]["seconds"] for label in ROOMS_EXPLORATION.algorithms)
    assert rows[2][1] == f"{total:.0f}"


def test_the_tables_come_one_after_the_other():
    assert tables(NAME) == settings_table(NAME) + cost_table(NAME)


def share(label: str, iteration: int) -> np.ndarray:
    stored = returns(NAME, label)
    return stored.at(iteration) / stored.optimum


def test_robust_numbers_of_stored_runs_are_those_of_the_statistics():
    head, *rows = rows_of(robust_table(NAME, LABELS, 1_000, "GVT"))
    assert head[0] == "algorithm"
    assert head[3] == "P(better than GVT)"
    assert [row[0] for row in rows] == LABELS
    for label, mean, middle, better in rows:
        values = share(label, 1_000)
        assert mean == shown(mean_interval(values))
        # seeded by the label, so that a table is the same whatever else it shows
        rng = generator(NAME, 0, f"bootstrap {label} 1000")
        assert middle == shown(bootstrap_interval(values, rng))
        assert numbers(middle)[0] == pytest.approx(interquartile_mean(values), abs=0.005)
        if label == "GVT":
            assert better == ""
            continue
        assert better == shown(improvement_interval(values, share("GVT", 1_000), rng))
        pairs = values[:, None] - share("GVT", 1_000)
        wins = (pairs > 0).mean() + 0.5 * (pairs == 0).mean()
        assert numbers(better)[0] == pytest.approx(wins, abs=0.005 + 1e-9)


def test_robust_numbers_are_those_of_the_iteration_and_the_same_each_time():
    early, late = (robust_table(NAME, ["1-MGVT"], t, "NT") for t in (500, 2_000))
    assert early != late
    assert robust_table(NAME, ["1-MGVT"], 500, "NT") == early
    assert numbers(rows_of(late)[1][1])[0] == pytest.approx(
        share("1-MGVT", 2_000).mean(), abs=0.005
    )


def test_robust_numbers_of_runs_that_share_tasks_are_taken_within_tasks(monkeypatch):
    experiment = replace(ROOMS_EXPLORATION, runs=12, runs_per_task=4)
    # tasks differ by far, their runs hardly: only resampling across tasks would see much spread
    level = np.repeat([0.1, 0.5, 0.9], 4)
    earned = {"GVT": level, "1-MGVT": level + 0.02, "NT": level + np.repeat([0.02, -0.02, 0.02], 4)}

    def made(name: str, label: str) -> Returns:
        at = earned[label][:, None] * 0.8
        return Returns(np.array([1_000]), at, at, np.full(12, 0.8))

    monkeypatch.setattr(protocol, "named", lambda name: experiment)
    monkeypatch.setattr(protocol, "returns", made)
    _, *rows = rows_of(robust_table(NAME, LABELS, 1_000, "GVT"))
    assert [row[2] for row in rows] == [
        "0.50 (0.50 to 0.50)",
        "0.52 (0.52 to 0.52)",
        shown(Interval(*[interquartile_mean(earned["NT"])] * 3)),
    ]
    assert [row[3] for row in rows] == ["", "1.00 (1.00 to 1.00)", "0.67 (0.67 to 0.67)"]
    # as if they were of one task, the same runs are all but indistinguishable
    monkeypatch.setattr(protocol, "named", lambda name: replace(experiment, runs_per_task=1))
    _, *rows = rows_of(robust_table(NAME, LABELS, 1_000, "GVT"))
    centre, low, high = numbers(rows[1][3])
    assert centre == pytest.approx(2 / 3, abs=0.01)
    assert high - low > 0.3


def test_a_table_escapes_what_it_shows():
    html = html_table(["<b>"], [["a & b", "<script>"]])
    assert "<b>" not in html
    assert "<script>" not in html
    assert rows_of(html) == [["<b>"], ["a & b", "<script>"]]
