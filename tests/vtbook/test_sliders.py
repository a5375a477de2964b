"""Sliders over stored settings: the right runs beside each other, and words true of them."""

from __future__ import annotations

import numpy as np
import pytest
from attrs import evolve
from xarray import Dataset

from vtbook import sliders, widgets
from vtbook.claims import Runs
from vtbook.experiments.grids import count_name, slider_thesis, sliders_of
from vtbook.experiments.rooms import GVT, MGVT
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.stats import Interval

FAMILY = RoomsFamily(rooms=2)
AROUND = Experiment(
    "tiny", Pool("tiny-pool", FAMILY, count=3), FAMILY, {"GVT": GVT, "1-MGVT": MGVT}, 6, 2
)
LAMBDAS, PSIS, POSTERIORS = (1e-6, 1e-4), (0.5, 1.0), ("GVT", "1-MGVT", "3-MGVT")
GRID = sliders_of(AROUND, "grid", 4, 300, LAMBDAS, PSIS, POSTERIORS)
USUAL = (1e-6, 0.5, "1-MGVT")


def runs(level: float, count: int = 4, times: int = 3, seed: int = 0) -> Dataset:
    """Returns about a level, of runs whose optimum is 0.8."""
    noise = np.random.default_rng(seed).normal(0, 0.01, (count, times))
    kinds = dict.fromkeys(("learning", "greedy"), (("run", "iteration"), level + noise))
    data = {**kinds, "optimum": ("run", np.full(count, 0.8))}
    return Dataset(data, {"iteration": 100 * np.arange(1, times + 1)})


@pytest.fixture
def shown(monkeypatch) -> dict[str, object]:
    """The axes and the picture that sliders are made of, over results that tell by their name."""
    made: dict[str, object] = {}
    monkeypatch.setattr(sliders, "returns", lambda grid, name: made["stored"][name])
    monkeypatch.setattr(
        widgets, "still_sliders", lambda axes, picture: made.update(axes=axes, picture=picture)
    )
    return made


def test_each_place_of_the_sliders_shows_its_own_runs(shown, monkeypatch):
    shown["stored"] = {x: runs(0.1 + 0.04 * i) for i, x in enumerate(GRID.algorithms)}
    drawn = []
    monkeypatch.setattr(sliders, "setting_picture", lambda *given: drawn.append(given) or "")
    sliders.setting_sliders(GRID, slider_thesis(AROUND), lambda: {"NT": runs(0.1)})
    grid = [[value for _, value in axis.options] for axis in shown["axes"]]
    assert grid == [list(LAMBDAS), list(PSIS), list(POSTERIORS)]
    assert [axis.options[axis.start][1] for axis in shown["axes"]] == list(USUAL)
    words = shown["picture"](1e-4, 1.0, "3-MGVT")
    assert drawn[0][1].stored is shown["stored"]["3-MGVT-lambda-1e-04-psi-1"]
    assert list(drawn[0][0]) == ["NT"]
    share = drawn[0][1].share(300)
    assert words.startswith(f"<p>After 300 iterations: {share.centre:.0%} (")
    assert "This is the thesis' setting." in shown["picture"](*USUAL)
    assert "This is the thesis' setting." in shown["picture"](1e-4, 0.5, "GVT")


def test_the_number_of_sources_is_a_slider_of_its_own(shown, monkeypatch):
    names = [count_name(x, n) for x in GRID.algorithms for n in (2, 5)]
    shown["stored"] = {x: runs(0.4) for x in names}
    drawn = []
    monkeypatch.setattr(sliders, "setting_picture", lambda *given: drawn.append(given) or "")
    counted = evolve(
        GRID,
        algorithms={x: GRID.algorithms[x.rsplit("-from-")[0]] for x in names},
    )
    thesis = slider_thesis(AROUND)
    sliders.setting_sliders(counted, thesis, lambda n: {f"NT {n}": runs(0.1)}, counts=(2, 5))
    assert [value for _, value in shown["axes"][-1].options] == [2, 5]
    assert shown["axes"][-1].start == 1
    shown["picture"](*USUAL, 2)
    assert drawn[0][1].stored is shown["stored"]["1-MGVT-lambda-1e-06-psi-0.5-from-2"]
    assert list(drawn[0][0]) == ["NT 2"]


@pytest.mark.parametrize(
    ("setting", "gap", "means"),
    [
        ((1e-4, 0.5, "GVT"), (-0.1, 0.1), "nothing that these runs could tell"),
        ((1e-4, 0.5, "GVT"), (0.1, 0.2), "better here than the thesis' choice"),
        ((1e-4, 0.5, "GVT"), (-0.2, -0.1), "held too close to its sources"),
        ((1e-8, 0.5, "GVT"), (-0.2, -0.1), "let go of its sources too soon"),
        ((1e-6, 1.0, "GVT"), (-0.2, -0.1), "more of the full gradient costs return here"),
        ((1e-6, 0.0, "GVT"), (-0.2, -0.1), "less of the full gradient costs return here"),
        ((1e-4, 0.0, "GVT"), (-0.2, -0.1), "worse, and both λ and ψ have moved"),
    ],
)
def test_a_difference_is_said_in_words(setting, gap, means):
    low, high = map(np.asarray, gap)
    assert (
        sliders.meaning(setting, (1e-6, 0.5, "GVT"), Interval((low + high) / 2, low, high)) == means
    )


def test_the_words_hold_the_share_and_the_paired_difference_from_the_thesis():
    mine, theirs = Runs(runs(0.4)), Runs(runs(0.6))
    words = sliders.setting_words((1e-4, 0.5, "1-MGVT"), USUAL, mine, theirs)
    end, gap = mine.share(300), mine.gain_until(theirs, 300)
    assert f"After 300 iterations: {end.centre:.0%} ({end.low:.0%} to {end.high:.0%})" in words
    assert f"Averaged over the run, {gap.centre:+.0%}".replace("-", "−") in words
    assert words.endswith("held too close to its sources.")


def test_a_setting_stands_beside_the_same_runs_of_the_references(monkeypatch):
    drawn, real = {}, sliders.returns_figure
    monkeypatch.setattr(
        sliders,
        "returns_figure",
        lambda shown, *a, **k: drawn.update(shown) or real(shown, *a, **k),
    )
    many, mine = runs(0.5, count=9, times=8), Runs(runs(0.3))
    html = sliders.setting_picture({"NT": many}, mine, (1e-4, 0.5, "2-MGVT"), (0, 1))
    assert list(drawn) == ["NT", "2-MGVT"]
    np.testing.assert_array_equal(drawn["NT"].greedy, many.greedy[:4, :3])
    assert drawn["2-MGVT"] is mine.stored
    end = float(mine.stored.learning[:, -1].mean())
    assert f"lambda = 1e-04, psi = 0.5, 2-MGVT; final learning return {end:.2f}." in html
