"""Recomputed heads against stored ones, here and elsewhere."""

import numpy as np
import pytest
import torch

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.rooms import ROOMS_EVALUATION, THREE_ROOMS
from vtlab import heads, run, schedule, sources, store
from vtlab.envs.rooms import Rooms
from vtlab.heads import check_heads, live_check
from vtlab.native.runs import NativeRun
from vtlib import rng, transfer
from vtlib.priors import MixturePrior
from vtlib.training import Curves

CART, ROOMS = CARTPOLE.published, ROOMS_EVALUATION.published
STORED, NOTE = store.stored(CART, "DDQN")


def with_differing(monkeypatch, differ, processor="of another kind", start=1, sensitive=()):
    """Let some heads differ from the fingerprint ``start`` on; which runs were computed.

    sensitive: those that go elsewhere once their sources are not exactly what is stored.
    """
    asked, given = [], store.weights(CART.pool)

    def head(experiment, label, runs, weights):
        asked.extend(runs)
        prints = STORED["fingerprints"][runs]
        prints[[one in differ for one in runs], start:] *= 1.01
        if not np.array_equal(weights, given):
            prints[[one in sensitive for one in runs], start:] *= 1.01
        return prints

    monkeypatch.setattr(run, "head", head)
    monkeypatch.setattr(store, "machine", lambda: {"processor": processor})
    return asked


def test_on_the_same_processor_every_run_counts(monkeypatch):
    asked = with_differing(monkeypatch, {3, 5}, NOTE["machine"]["processor"])
    assert list(check_heads(CART, "DDQN").wrong) == [3, 5]
    assert list(check_heads(CART, "DDQN", members=[3, 19]).wrong) == [3]
    # what differs is looked at again in the batch in which it was stored
    assert asked == [*range(20), 2, 3, 4, 5, 3, 19, 2, 3]


def test_a_run_is_looked_at_in_its_batch_where_another_rounds_otherwise(monkeypatch):
    def head(experiment, label, runs, weights):
        return STORED["fingerprints"][runs] * (1 if len(runs) == schedule.BATCH else 1.01)

    monkeypatch.setattr(run, "head", head)
    monkeypatch.setattr(store, "machine", lambda: NOTE["machine"])
    assert check_heads(CART, "DDQN", members=[3, 4, 5]) == ([3, 4, 5], {}, {})


@pytest.mark.parametrize(
    ("differ", "members", "wrong", "parted"),
    [
        ({3, 5}, None, [], [3, 5]),
        (set(range(6)), None, [], list(range(6))),
        (set(range(13)), None, list(range(13)), []),
        ({3, 0, 1}, [3], [], [3]),
        ({3, 0, 1, 2, 4, 5, 6}, [3], [3], []),
        (set(range(20)), [3, 4], [3, 4], []),
        ({0, 1, 2, 5}, [3, 4], [], []),
    ],
)
def test_on_another_processor_a_few_among_many_are_rounding(
    monkeypatch, differ, members, wrong, parted
):
    asked = with_differing(monkeypatch, differ)
    found = check_heads(CART, "DDQN", members=members)
    assert (list(found.wrong), found.parted) == (wrong, dict.fromkeys(parted, 48))
    differ = differ & set(range(20) if members is None else members)
    assert len(set(asked)) == (20 if members is None else 10 if differ else len(members))


@pytest.mark.parametrize(("sensitive", "wrong"), [(13, 0), (7, 0), (0, 13)])
def test_runs_that_any_rounding_sends_elsewhere_do_not_count(monkeypatch, sensitive, wrong):
    with_differing(monkeypatch, set(range(13)), sensitive=set(range(sensitive)))
    found = check_heads(CART, "DDQN")
    assert (list(found.wrong), len(found.parted)) == (list(range(wrong)), 13 - wrong)


def test_what_is_compared_is_computed_with_one_thread(monkeypatch):
    nothing = np.zeros(0)

    def counted(*_):
        return Curves(nothing, nothing, nothing, np.array(torch.get_num_threads()))

    monkeypatch.setattr(run, "train", counted)
    unit = next(one for one in schedule.units_of(CART) if one.label == "DDQN")
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        assert run.head(CART, "DDQN", [3], store.weights(CART.pool)) == 1
        monkeypatch.setattr(run, "run_batch", lambda *_: {"threads": torch.get_num_threads()})
        assert schedule.compute(unit, np.zeros(0))[0] == {"threads": 1}
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_where_more_are_parted_the_whole_runs_tell(monkeypatch):
    for asked, differ in ((None, set(range(7))), ([3], {3, 0, 1, 2, 4, 5})):
        with_differing(monkeypatch, differ)
        monkeypatch.setattr(heads, "check_runs", lambda *given: given)
        assert check_heads(CART, "DDQN", members=asked) == (CART, "DDQN", asked, None)


def test_the_live_check_says_what_was_found(monkeypatch):
    with_differing(monkeypatch, {3}, start=0)
    assert "does NOT have" in live_check(CART, "DDQN", 3)
    assert live_check(CART, "DDQN", 4).endswith("has the stored fingerprints.")
    with_differing(monkeypatch, {3})
    assert "has the stored fingerprints until rounding" in live_check(CART, "DDQN", 3)


# What stands in for a function, which is given first.
FAULTS = {
    "sign of the gradient": (transfer, "td_gradients", lambda real, *given: -real(*given)),
    "psi": (
        transfer,
        "td_gradients",
        lambda real, *given: real(*given[:3], 0.5 * given[3], *given[4:]),
    ),
    "weight of the KL": (MixturePrior, "pull", lambda real, *given: 2 * real(*given)),
    "walls": (Rooms, "_blocked", lambda real, *given: torch.zeros_like(real(*given))),
    "seed": (rng, "generator", lambda real, name, one, role: real(name, one + 1, role)),
    "order in the kernels": (NativeRun, "_numbers", lambda real, *given: real(*given)[::-1].copy()),
    "seed of sources": (sources, "AttemptRng", lambda real, name, *rest: real(name + "x", *rest)),
}


@pytest.mark.parametrize(("place", "name", "otherwise"), FAULTS.values(), ids=FAULTS)
def test_a_fault_is_caught(place, name, otherwise, monkeypatch):
    if place is not NativeRun:  # the engine leaves what the kernels have left
        monkeypatch.setattr(run, "prepare_natively", lambda *_: None)
    result = (THREE_ROOMS, "sources") if place is sources else (ROOMS, "1-MGVT")
    assert not check_heads(*result, members=[7]).wrong
    real = getattr(place, name)
    monkeypatch.setattr(place, name, lambda *given: otherwise(real, *given))
    assert list(check_heads(*result, members=[7]).wrong) == [7]
