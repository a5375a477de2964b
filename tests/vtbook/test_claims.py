"""Claims: verdicts at their bounds, and each measure of stored runs and of published curves."""

from types import SimpleNamespace

import numpy as np
import pytest
from xarray import Dataset

from vtbook import claims
from vtbook.claims import NOT, REPRODUCED, STRONGER, UNDECIDED, Claim, Figure, Printed, Runs
from vtbook.published import PublishedCurve
from vtlab.stats import Interval, mean_interval

WAVE = np.array([1.0, -1, 1, -1, 1, -1, 1, -1])  # without a mean
HALF = float(mean_interval(WAVE).high)
TIMES = np.array([500, 1_000, 1_500])


@pytest.mark.parametrize(
    ("low", "high", "plain"),
    [
        (0.2, 0.8, REPRODUCED),  # the bounds themselves are inside
        (0.1, 0.199, NOT),
        (0.801, 0.9, NOT),
        (0.1, 0.2, UNDECIDED),
        (0.8, 0.9, UNDECIDED),
        (0.1, 0.9, UNDECIDED),
    ],
)
@pytest.mark.parametrize("stronger", ["", "low", "high"])
def test_a_claim_is_decided_by_where_its_whole_interval_lies(low, high, plain, stronger):
    found = Interval((low + high) / 2, low, high)
    claim = Claim("", "", found, None, 0.2, 0.8, stronger)
    beyond = {"low": high < 0.2, "high": low > 0.8, "": False}[stronger]
    assert claim.verdict == (STRONGER if beyond else plain)
    assert claim.bounds == "0.2 to 0.8"
    assert Claim("", "", found, None, low=-0.15).bounds == "at least −0.15"


@pytest.mark.parametrize(
    ("low", "high", "verdict"),
    [(-0.1, 0.1, REPRODUCED), (0.0, 0.1, REPRODUCED), (0.001, 0.1, NOT), (-0.1, -0.001, NOT)],
)
def test_a_claim_of_no_difference_holds_where_the_interval_contains_none(low, high, verdict):
    claim = Claim("", "", Interval(0.0, low, high), None, 0.0, 0.0)
    assert claim.verdict == verdict
    assert claim.bounds == "the interval contains 0"


def runs(learning, greedy=None, optimum=1.0, spread=1.0, floor=0.0):
    """Eight runs with these mean returns at 500, 1,000 and 1,500 iterations."""
    data = {
        kind: (("run", "iteration"), np.add.outer(spread * WAVE, np.array(means, float)))
        for kind, means in (("learning", learning), ("greedy", greedy or learning))
    }
    data["optimum"] = "run", np.broadcast_to(optimum, 8).astype(float)
    return Runs(Dataset(data, {"iteration": TIMES}), floor)


def printed(learning, half, greedy=None, scale=1.0, floor=0.0):
    """Curves with these means, and the same half width everywhere."""
    means = np.array([learning, greedy or learning], float)
    bands = zip(means, means - half, means + half, strict=True)
    return Printed(*(PublishedCurve(TIMES, *band) for band in bands), scale, floor)


def near(found, centre, half=0.0):
    expected = centre, centre - half, centre + half
    return tuple(map(float, found)) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_shares_are_of_the_way_from_the_floor_to_the_mean_optimum():
    # a mean optimum of -40 lies 50 above a floor of -90
    far = runs([-65, -40, -90], [-50, -60, -70], np.repeat([-30.0, -50.0], 4), 5.0, -90.0)
    assert near(far.share(500), 0.5, 0.1 * HALF)
    assert near(far.share(1_500, "greedy"), 0.4, 0.1 * HALF)
    seen = printed([-65, -40, -90], 5.0, [-50, -60, -70], 50.0, -90.0)
    assert near(seen.share(500), 0.5, 0.1)
    assert near(seen.share(1_500, "greedy"), 0.4, 0.1)
    assert near(seen.share(1_499), 1.0, 0.1)  # published curves hold their value


def test_gains_are_paired_by_run_and_those_of_published_curves_cannot_be():
    # each run shares its luck, of which one algorithm makes three times as much
    a, b = runs([2, 4, 6], None, 4.0, 3.0), runs([0, 1, 2], None, 4.0, 1.0)
    assert near(a.gain(b, 500), 0.5, HALF / 2)
    assert near(a.gain_until(b, 1_499), 2.5 / 4, HALF / 2)
    assert near(a.gain_until(b, 1_500), 0.75, HALF / 2)
    c, d = printed([2, 4, 6], 3.0, scale=4.0), printed([0, 1, 2], 4.0, scale=4.0)
    # 3-4-5: errors of independent means
    assert near(c.gain(d, 500), 0.5, 5 / 4)
    assert near(c.gain_until(d, 1_000), 2.5 / 4, 5 / 4)
    # a lead of two grows to four, and luck that stays cancels
    assert near(a.growth(b, 500, 1_500), 0.5)
    assert near(c.growth(d, 500, 1_500), 0.5, 2**0.5 * 5 / 4)


def test_spreads_and_ratios_compare_with_the_other_algorithm():
    a, b = runs([5, 6, 7], spread=1.5), runs([2, 2, 2], spread=0.5)
    assert near(a.spread(b, 1_000), 3)  # of whole pairs: each resample keeps the ratio
    assert float(a.ratio(b, 500).centre) == 2.5
    assert near(printed([5, 6, 7], 3.0).spread(printed([1, 1, 1], 2.0), 500), 1.5)
    # relative errors of 3/5 and 4/10, of independent means
    assert near(printed([5] * 3, 3.0).ratio(printed([10] * 3, 4.0), 500), 0.5, 0.13**0.5)


def test_runs_that_miss_their_own_optimum_by_a_tenth_are_solved_with_wilsons_interval():
    own = np.array([-10.0, -10, -10, -10, -60, -60, -60, -60])
    # floor -110: nine tenths of the way lie at -20 and at -65
    some = runs([0] * 3, [0] * 3, own, 0.0, -110.0)
    mean = np.array([-20, -20.1, -19, -65, -65, -65.1, -64, -60])
    some.stored.greedy[:] = np.add.outer(mean, [-4, 8, -4])  # of all evaluations, there being few
    np.testing.assert_array_equal(some.optimal(1_000), [1, 0, 1, 0, 1, 0, 1, 1])
    # of five in eight
    assert tuple(some.solved(1_000)) == pytest.approx((0.625, 0.305742, 0.863156), rel=1e-5)


def test_runs_that_end_below_nine_tenths_of_their_own_optimum_have_fallen():
    own = np.array([-10.0, -10, -10, -10, -60, -60, -60, -60])
    some = runs([0] * 3, None, own, 0.0, -110.0)
    some.stored.learning[:, -1] = [-20, -20.1, -19, -65, -65, -65.1, -64, -60]
    assert some.fallen == 3


@pytest.fixture
def figure(monkeypatch):
    """A figure of an experiment of two algorithms."""

    def returns(experiment, label):
        return runs([experiment.algorithms[label]] * 3, [0, 1, 2], 4.0, 0.5).stored

    def curves(name, kind):
        assert name == "some-figure"
        return dict.fromkeys("AB", getattr(printed([1, 1, 9], 0.25, [0, 8, 2]), kind))

    monkeypatch.setattr(claims, "returns", returns)
    monkeypatch.setattr(claims, "curves", curves)
    return Figure(SimpleNamespace(algorithms={"A": 1.0, "B": 3.0}, family=None), "some-figure")


def test_a_claim_is_measured_alike_of_our_runs_and_on_the_published_curves(figure):
    claim = figure.claim("text", "n", lambda a, b: a.gain(b, 500), "B", "A", low=0.1, ours=True)
    assert claim.number.centre == 0.5
    # the published curves are shares of the optimum of our runs
    assert near(claim.printed, 0.0, 0.25 * 2**0.5 / 4)
    assert (claim.verdict, claim.judge(claim.printed)) == (REPRODUCED, NOT)
    assert (claim.low, claim.high, claim.ours) == (0.1, np.inf, True)
    assert claim.overlap == min(figure.overlap(x, "learning") for x in "AB")
    alone = "", "", lambda a: a.share(500), "A"
    assert figure.claim(*alone, kind="greedy").overlap == pytest.approx(2 / 3)
    assert figure.claim(*alone, printed=False).printed is None
    assert Figure(figure.experiment).claim(*alone).printed is None


def test_rows_of_one_sentence_are_of_one_fact(figure):
    earns, ahead = "{} does well.", "{} is ahead of {}."
    rows = figure.earns(earns, "AB", 500) + figure.ahead(ahead, "A", "AB", 1_500)
    assert [row.text for row in rows[1:3]] == ["B does well.", "A is ahead of A."]
    assert [row.fact for row in rows] == [earns, earns, ahead, ahead]


def test_curves_overlap_where_both_were_recorded_and_their_intervals_meet(figure, monkeypatch):
    # ours 1 +- 0.5 half widths of the mean at 500 and 1,000, published 1 +- 0.25; apart at 1,500
    assert figure.overlap("A", "learning") == pytest.approx(2 / 3)
    assert figure.overlap("B", "learning") == 0
    # greedy: 0 and 2 meet, 1 and 8 do not
    assert figure.overlap("A", "greedy") == pytest.approx(2 / 3)
    seen = figure.printed["A"].learning
    later = PublishedCurve(np.array([1_000, 1_500, 2_000]), *seen[1:])
    monkeypatch.setitem(figure.printed, "A", Printed(later, later, 4.0))
    # at 1,000 the curve's first value meets ours, at 1,500 its second one; 2,000 is not ours
    assert figure.overlap("A", "learning") == 1
