"""The judgement of `vtlib.trust` is on tasks of its own, and says what its runs say."""

import numpy as np
import pytest

from vtbook import judgement
from vtbook.experiments.compared import ENVIRONMENTS, FOUR
from vtbook.experiments.trust import LOSS, OURS, PICKED, PLACES, picked
from vtbook.judgement import Contrast
from vtlab.stats import Interval


def test_the_best_source_is_fine_tuned_as_earned_most():
    for number, tuned in enumerate(ENVIRONMENTS):
        judged = tuned.judged()
        labels = ("fine-tuned", f"fine-tuned{FOUR}", "DDQN, fine-tuned")
        best = max(labels, key=lambda x: tuned.earned(judged, x).mean())
        assert PLACES[number].experiment.algorithms[PICKED] == picked(judged.algorithms[best])


@pytest.mark.parametrize(
    ("centre", "low", "p", "verdict"),
    [
        (0.2, 0.1, 0.01, "better"),
        (-0.2, -0.3, 0.01, "worse"),
        (0.0, -LOSS, 0.3, "as good"),
        (0.1, -0.04, 0.3, "undecided"),
    ],
)
def test_a_verdict_needs_the_test_or_the_interval(centre, low, p, verdict):
    assert Contrast("a", "b", Interval(centre, low, 2 * centre - low), p).verdict == verdict


def test_the_farthest_shortfall_is_behind_the_best_of_a_place(monkeypatch):
    told = {"a": {OURS: [0.9, 0.7], "x": [1.0], "z": [0.0]}, "b": {OURS: [0.5], "x": [0.1]}}
    places = [type("Place", (), {"title": title}) for title in told]
    monkeypatch.setattr(judgement, "PLACES", places)
    earned = {t: {k: np.array(v) for k, v in each.items()} for t, each in told.items()}
    monkeypatch.setattr(judgement, "earned", lambda place: earned[place.title])
    found = judgement.shortfalls()
    assert found == pytest.approx({OURS: 0.2, "x": 0.4, "z": 1.0})
