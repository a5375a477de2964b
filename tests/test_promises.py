"""The promises of sources: beliefs in closed form, invariance, regret, and a state that goes on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib.promises import LEAST, LOOKS, RECENT, WIDE, Record, beliefs, evidence

PROMISE, SPREAD = 10.0, 1.0


def played(earns, count=4, episodes=30, seed=0, scale=1.0, shift=0.0, begun=0):
    """A record after some episodes, in which arm j earns ``earns(j, rng)``."""
    rng = np.random.default_rng(seed)
    record = Record(count)
    for t in range(episodes):
        coin, normal, noise = rng.uniform(), rng.standard_normal(count), rng.spawn(1)[0]
        promise = scale * PROMISE + shift
        arm = record.choose(t >= begun, coin, normal)
        record.add(scale * earns(arm, noise) + shift, promise, scale * SPREAD)
    return record


def test_evidence_is_a_ratio_of_half_normal_laws():
    x = np.array([0.0, 1.0, 3.0])
    own, other = np.exp(-(x**2) / 2), np.exp(-((x / WIDE) ** 2) / 2) / WIDE
    np.testing.assert_allclose(evidence(x), own / other)
    assert evidence(np.array([-5.0])) == WIDE  # more than promised


@pytest.mark.parametrize("broken", [0, 1, 2, 5])  # at first half a spike at none, half uniform
def test_broken_promises_have_the_rule_of_succession_with_a_spike(broken):
    _, another = beliefs(np.zeros(broken))
    assert another == pytest.approx(1 / (broken + 2) ** 2, rel=1e-3)


@pytest.mark.parametrize("kept", [1, 3])
def test_kept_promises_refute_the_spike(kept):
    of_kind, another = beliefs(np.full(kept, 1e9))
    assert another == pytest.approx((kept + 1) / (kept + 2), rel=1e-3)
    np.testing.assert_allclose(of_kind, 1.0)


def test_sources_that_keep_their_promise_play():
    def earns(arm, rng):
        return PROMISE + rng.normal() if arm < 4 else 0.0

    record = played(earns, episodes=100, begun=1)
    learned = sum(arm == 4 for arm in record.played)
    assert learned == 2  # it is looked at in episodes 32 and 64
    assert [t + 1 for t, arm in enumerate(record.played) if arm == 4] == [LOOKS, 2 * LOOKS]


def test_sources_that_break_it_are_left():
    record = played(lambda arm, rng: 0.0 if arm < 4 else 5.0, begun=2)
    assert record.played[:2] == [0, 1]
    assert sum(arm < 4 for arm in record.played) <= 4
    assert record.trust[-1] < 0.1


def test_a_source_is_found_among_those_that_break_their_promise():
    record = played(lambda arm, rng: PROMISE if arm == 2 else 0.0, begun=6)
    assert record.played[:3] == [0, 1, 2]
    assert record.played.count(2) > 20
    assert record.best() == 2


def test_sources_that_break_it_play_where_what_is_learned_is_worse():
    record = played(lambda arm, rng: 5.0 + 0.1 * rng.normal() if arm < 4 else 0.0, begun=4)
    assert np.mean(np.array(record.played[8:]) < 4) > 0.9


def test_where_what_is_learned_earns_nothing_all_sources_are_tried_again():
    # source 3 earns something every other time, which one episode may not show
    def earns(arm, rng):
        return 2.0 * (arm == 3 and rng.uniform() < 0.5)

    record = played(earns, episodes=100, begun=2)
    sources = [arm for arm in record.played[2 * LEAST :] if arm < 4]
    assert record.tried == [0, 1, 2, 3]
    assert sources.count(3) > len(sources) / 3
    assert record.best() == 3
    assert record.source_leads


def test_what_is_learned_plays_where_it_leads():
    record = played(
        lambda arm, rng: PROMISE + 0.1 * rng.normal() + (5 if arm == 4 else 0), episodes=60
    )
    assert set(record.played[LOOKS - 1 :]) == {4}


@pytest.mark.parametrize(
    ("own", "best", "kept"),
    [
        ([3.0, 5.0, 3.0, 5.0, 4.0], [1.0, 1.0, 1.0], True),
        ([3.0, 5.0, 3.0, 5.0, 4.0], [4.0, 4.0, 4.0], False),  # a tie
        ([1.0, 9.0, 1.0, 9.0, 5.0], [4.0, 4.0, 4.0], False),  # within an error
        ([8.0, 9.0], [4.0, 4.0, 4.0], True),
        ([5.0, 6.0], [4.0, 4.0, 4.0], False),  # two episodes need three standard errors
        ([4.0, 6.0, 6.0, 4.0, 6.0], [4.0, 4.0, 4.0], True),  # five need one and a half
        ([8.0, 9.0], [4.0], True),  # a source that has played once scatters as much
        ([6.0, 6.5], [4.0], True),
        ([6.0, 7.0], [4.0], False),
        ([5.0] * 5, [4.0, 4.0, 4.0], True),
        ([4.001] * 5, [4.0, 4.0, 4.0], False),  # hardly more, where returns differ by one
        ([9.0], [4.0, 4.0, 4.0], False),
        ([], [4.0, 4.0], False),
        ([5.0] * 5, [], False),
    ],
)
def test_a_trial_keeps_what_was_learned_where_it_earns_clearly_more(own, best, kept):
    count = [1] * 4 + [0] * len(best)  # source 1 earns less
    record = Record(2, played=count, gained=[1.0, 3.0, 1.0, 1.0, *best])
    if not best:
        record.played, record.gained = [2] * 4, [1.0] * 4
    record.judge()
    record.played, record.gained = record.played + [2] * len(own), record.gained + own
    assert record.improved == kept


def test_a_trial_forgets_what_was_earned_before_it_was_learned():
    record = Record(1, played=[0, 0, *[1] * LEAST], gained=[1.0, 1.0, *[9.0] * LEAST])
    assert record.improved  # without a trial these are all that is known
    record.judge()
    record.played.append(1), record.gained.append(0.0)
    assert record.improved  # nor does one episode make a trial
    record.played.append(1), record.gained.append(0.0)
    assert not record.improved


@pytest.mark.parametrize(
    ("own", "then"),
    [
        ([0.0, 2.0, 0.0, 2.0], [1, 1, 1, 0, 1, 0]),  # once they have played as often, in turn
        ([0.0] * 2, [1, 1, 0, 0, 0, 0]),
        ([1.5, 0.0, 0.0, 1.0], [1, 1, 1, 0, 1, 0]),  # behind, but within an error
        ([2.0] * 6, [1] * 6),
    ],
)
def test_in_a_trial_both_play_until_one_is_clearly_better(own, then):
    record = Record(1, played=[0, 0, 1], gained=[1.0, 1.0, 0.0], trust=[0.0] * 3, short=[0.0] * 3)
    record.judge()
    earns = iter(own)
    for _ in range(6):
        record.add(next(earns) if record.choose(True, 0.5, np.zeros(1)) == 1 else 1.0, 1.0, 1.0)
    assert record.played[3:] == then


@settings(max_examples=30, deadline=None)
@given(
    st.sampled_from([0.125, 2.0, 64.0]), st.sampled_from([-128.0, 0.0, 32.0]), st.integers(0, 99)
)
def test_other_units_and_a_constant_change_nothing(scale, shift, seed):
    def earns(arm, rng):
        return np.round(8 * (PROMISE * rng.uniform() if arm < 4 else 4 * rng.uniform())) / 8

    plain = played(earns, episodes=50, seed=seed, begun=3)
    other = played(earns, episodes=50, seed=seed, begun=3, scale=scale, shift=shift)
    assert other.played == plain.played
    np.testing.assert_allclose(other.trust, plain.trust)


def test_the_regret_against_the_best_source_is_that_of_a_bandit():
    means, episodes = np.array([PROMISE, 9.5, 9.0, 8.5, 0.0]), 200
    regret = [
        (means[0] - means[record.played]).sum()
        for seed in range(20)
        for record in [
            played(lambda arm, rng: means[arm] + rng.normal(), episodes=episodes, seed=seed)
        ]
    ]
    gaps = means[0] - means[1:4]
    looks = 3 * PROMISE  # episodes 32, 64 and 128
    assert np.mean(regret) < looks + (8 * np.log(episodes) / gaps).sum()


def test_without_a_spread_a_promise_is_kept_to_the_letter():
    record = Record(1)
    for gained in (1.0, 0.5):
        record.choose(False, 0.0, np.zeros(1))
        record.add(gained, 1.0, 0.0)
    assert record.short == [0.0, 2 * WIDE]


def test_a_record_can_be_asked_within_the_first_episode():
    record = Record(2)
    assert record.choose(False, 0.5, np.zeros(2)) == 0
    assert record.tried == []
    assert record.best() == 0
    assert not record.source_leads


@pytest.mark.parametrize(
    ("played", "gained", "lost"),
    [
        ([], [], False),  # nothing has ended yet
        ([0, 1], [0.0, 0.0], True),  # sources that earn all the same
        ([0, 1], [0.0, 0.5], False),
        ([0, 2, 2], [0.0, 0.0, 0.0], True),
        ([0, 2, 2], [0.5, 0.0, 0.0], True),  # a source may have been lucky
        ([0, 2, 2], [0.0, 0.0, 0.5], False),
        ([0, 2, 2], [-9.0, -5.0, -5.0], False),
    ],
)
def test_what_was_learned_is_lost_where_it_earns_the_least_of_all(played, gained, lost):
    assert Record(2, played=played, gained=gained).lost == lost


def test_it_is_lost_again_when_it_has_earned_nothing_for_a_while():
    record = Record(1, played=[1] * (RECENT + 1), gained=[1.0, *[0.0] * RECENT])
    assert record.lost
    record.gained[-RECENT] = 1.0
    assert not record.lost
