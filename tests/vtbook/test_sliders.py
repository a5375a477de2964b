"""Sliders over stored settings: the right runs beside each other, and words true of them."""

from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
from xarray import Dataset

from vtbook import claims, sliders, widgets
from vtbook.claims import Runs
from vtbook.experiments.grids import POSTERIORS, PSIS, slider_thesis, sliders_of
from vtbook.experiments.rooms import ROOMS_EVALUATION_EQUATIONS

AROUND = ROOMS_EVALUATION_EQUATIONS
LAMBDAS = (1e-6, 1e-4)
GRID = sliders_of(AROUND, "grid", 4, 300, LAMBDAS)
USUAL = (1e-6, 0.5, "1-MGVT")


def runs(level, count=4, times=3, **told):
    """Returns about a level, of runs whose optimum is 0.8."""
    noise = np.random.default_rng(0).normal(0, 0.01, (count, times))
    data = dict.fromkeys(("learning", "greedy"), (("run", "iteration"), level + noise))
    data["optimum"] = "run", [0.8] * count
    return Dataset(data, {"iteration": 100 * np.arange(1, times + 1)}, told)


def named(_, name):
    """Stored runs that tell their name, and by their level their psi."""
    return runs(0.2 if "psi-1" in name else 0.4, name=name)


@pytest.fixture
def pictures(monkeypatch):
    """What is asked for pictures, which show nothing; sliders stay in parts."""
    asked = SimpleNamespace(frame=Mock(), picture=Mock(return_value="<img>"))
    monkeypatch.setattr(claims, "returns", named)
    monkeypatch.setattr(sliders, "setting_frame", asked.frame)
    monkeypatch.setattr(sliders, "setting_picture", asked.picture)
    monkeypatch.setattr(widgets, "still_sliders", lambda axes, picture, *_: (axes, picture))
    return asked


def test_each_place_of_the_sliders_shows_its_own_runs_with_words_true_of_them(pictures):
    thesis = slider_thesis(AROUND)
    axes, picture = sliders.setting_sliders(GRID, thesis, {"NT": runs(0.1)})
    values = [tuple(value for _, value in axis.options) for axis in axes]
    assert values == [LAMBDAS, PSIS, POSTERIORS]
    assert [axis.options[axis.start][1] for axis in axes] == list(USUAL)
    words = picture(1e-4, 1.0, "3-MGVT")
    references, own = pictures.frame.call_args[0][1], pictures.picture.call_args[0][1]
    assert (list(references), own.stored.name) == (["NT"], "3-MGVT-lambda-1e-04-psi-1")
    mine, theirs = Runs(runs(0.2)), Runs(runs(0.4))
    end, gap = mine.share(300), mine.gain_until(theirs, 300)
    assert words.startswith("<img><p>λ = 10⁻⁴, ψ = 1, 3-MGVT. After")
    assert f"After 300 iterations: {end.centre:.0%} ({end.low:.0%} to {end.high:.0%})" in words
    assert f"Averaged over the run, {gap.centre:+.0%}".replace("-", "−") in words
    assert words.endswith("against the thesis' setting.</p>")
    assert "This is the thesis' setting." in picture(*USUAL)
    assert "This is the thesis' setting." in picture(1e-4, 0.5, "GVT")


def test_a_setting_stands_beside_the_same_runs_of_the_references(monkeypatch):
    figure = Mock(wraps=sliders.returns_figure)
    monkeypatch.setattr(sliders, "returns_figure", figure)
    many, first, mine = runs(0.5, count=9, times=8), Runs(runs(0.1)), Runs(runs(0.3))
    setting, given = (1e-4, 0.5, "2-MGVT"), ("2-MGVT", (0, 1))
    frame = sliders.setting_frame("a-frame", {"NT": many}, mine, *given)
    drawn = figure.call_args_list[0].args[0]
    assert list(drawn) == ["NT", "2-MGVT"]
    np.testing.assert_array_equal(drawn["NT"].greedy, many.greedy[:4, :3])
    assert drawn["2-MGVT"] is mine.stored
    # a picture is the same whatever was drawn before it in its frame
    wanted = sliders.setting_picture(frame, mine, setting)
    other = sliders.setting_picture(frame, first, setting)
    assert sliders.setting_picture(frame, mine, setting) == wanted != other
