"""What a recomputed head must share with the stored one, on the same processor and on another."""

from __future__ import annotations

import numpy as np
import pytest

from vtlib import store
from vtlib.experiments import verify
from vtlib.experiments.reading import live_check
from vtlib.experiments.verify import check_heads
from vtlib.experiments.work import load_result
from vtlib.store import results_folder

ROOT = results_folder()
STORED, NOTE = load_result("cartpole", "DDQN", ROOT)


def with_differing(
    monkeypatch, differing: set[int], processor: str, start: int = 1
) -> list[list[int]]:
    """Let some heads differ from the fingerprint ``start`` on; which runs were computed."""
    asked = []

    def head(experiment, label, runs, pool):
        asked.append(list(runs))
        prints = STORED["fingerprints"][list(runs)].copy()
        prints[[run in differing for run in runs], start:] *= 1.01
        return prints

    monkeypatch.setattr(verify.runs_of, "head", head)
    monkeypatch.setattr(store, "machine", lambda: {"processor": processor})
    return asked


@pytest.mark.parametrize("differing", [{3}, {3, 5}, set(range(20))])
def test_on_the_same_processor_every_run_counts(monkeypatch, differing):
    asked = with_differing(monkeypatch, differing, NOTE["machine"]["processor"])
    assert check_heads("cartpole", "DDQN", ROOT) == (sorted(differing), [])
    assert check_heads("cartpole", "DDQN", ROOT, [3, 19]) == (sorted(differing & {3, 19}), [])
    assert asked == [list(range(20)), [3, 19]]


@pytest.mark.parametrize("machine", [None, "a text", {}, {"processor": None}])
def test_a_provenance_that_names_no_processor_excuses_nothing(monkeypatch, machine):
    with_differing(monkeypatch, {3}, "of another kind")
    monkeypatch.setattr(verify, "load_result", lambda *_: (STORED, {**NOTE, "machine": machine}))
    assert check_heads("cartpole", "DDQN", ROOT) == ([3], [])


@pytest.mark.parametrize(
    ("differing", "members", "wrong", "parted"),
    [
        ({3, 5}, None, [], [3, 5]),
        (set(range(6)), None, [], list(range(6))),
        (set(range(7)), None, list(range(7)), []),
        ({3}, [3], [], [3]),
        ({3, 0, 1}, [3], [], [3]),
        ({3, 0, 1, 2}, [3], [3], []),
        (set(range(20)), [3, 4], [3, 4], []),
        ({0, 1, 2, 5}, [3, 4], [], []),
    ],
)
def test_on_another_processor_a_few_among_many_are_rounding(
    monkeypatch, differing, members, wrong, parted
):
    asked = with_differing(monkeypatch, differing, "of another kind")
    assert check_heads("cartpole", "DDQN", ROOT, members) == (wrong, parted)
    looked_at = [run for runs in asked for run in runs]
    assert len(looked_at) == len(np.unique(looked_at))
    differ = differing & set(members if members is not None else range(20))
    assert len(looked_at) == (20 if members is None else 10 if differ else len(members))


@pytest.mark.parametrize("members", [None, [3], [3, 4]])
def test_a_first_iteration_that_differs_is_no_rounding(monkeypatch, members):
    with_differing(monkeypatch, {3}, "of another kind", start=0)
    assert check_heads("cartpole", "DDQN", ROOT, members) == ([3], [])


def test_on_another_processor_the_page_names_what_rounding_parted(monkeypatch):
    with_differing(monkeypatch, {3}, "of another kind")
    assert live_check("cartpole", "DDQN", 3, ROOT).endswith(
        "has the stored fingerprints until rounding, which is not this processor's, "
        "sends it elsewhere."
    )
    assert live_check("cartpole", "DDQN", 4, ROOT).endswith("has the stored fingerprints.")
    with_differing(monkeypatch, {3}, "of another kind", start=0)
    assert "does NOT have" in live_check("cartpole", "DDQN", 3, ROOT)
