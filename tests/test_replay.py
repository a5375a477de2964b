"""Ring buffers of transitions: what is kept, what is overwritten, and how it is sampled."""

import pytest
import torch

from vtlib.replay import ReplayBuffer, Transition

RUNS = 3


def transition(t: int) -> Transition:
    """Transition t of each run, recognisable in all its parts."""
    runs = torch.arange(RUNS)
    obs = torch.stack([torch.full((RUNS,), float(t)), runs.float()], -1)
    return Transition(obs, (runs + t) % 5, t + 0.1 * runs, obs + 0.5, (runs + t) % 3 == 0)


def filled(count: int, capacity: int) -> ReplayBuffer:
    buffer = ReplayBuffer(RUNS, capacity, obs_dim=2)
    for t in range(count):
        buffer.add(transition(t))
    return buffer


def assert_are(batch: Transition, times: range, runs: list[int]) -> None:
    """The transitions of some times and runs, in whatever order."""
    order = batch.obs[0, :, 0].argsort()
    expected = [torch.stack(parts, 1)[runs] for parts in zip(*map(transition, times), strict=True)]
    for ours, theirs in zip(batch, expected, strict=True):
        assert ours.dtype == theirs.dtype
        assert torch.equal(ours[:, order], theirs)


# 1024 rows are allocated first; a buffer grows by doubling up to its capacity
@pytest.mark.parametrize(
    ("count", "capacity"),
    [(1, 4), (4, 4), (11, 4), (3, 1), (2049, 5000), (1300, 1200), (1024, 1024), (1030, 1024)],
)
def test_the_last_transitions_are_kept_of_every_run_and_of_some(count, capacity):
    buffer, times = filled(count, capacity), range(max(0, count - capacity), count)
    assert len(buffer) == len(times)
    uniforms = (torch.arange(len(times)) + 0.5) / len(times)  # each stored transition once
    assert_are(buffer.sample(uniforms.expand(RUNS, -1)), times, [0, 1, 2])
    buffer.keep([2, 0])
    assert_are(buffer.sample(uniforms.expand(2, -1)), times, [2, 0])


def test_sampling_reaches_both_ends_and_never_past_them():
    largest = torch.tensor(1.0).nextafter(torch.tensor(0.0))
    ends = torch.stack([torch.zeros(RUNS), largest.expand(RUNS)], 1)
    for count in (3, 7, 20):
        assert_are(filled(count, 20).sample(ends), range(0, count, count - 1), [0, 1, 2])


def test_a_sample_does_not_change_with_the_buffer():
    buffer = filled(4, 4)
    batch = buffer.sample(torch.zeros(RUNS, 1))
    buffer.add(transition(99))
    assert_are(batch, range(1), [0, 1, 2])


@pytest.mark.parametrize("count", [0, 3, 4, 11])
def test_another_buffer_goes_on_from_what_one_held(count):
    buffer, other = filled(count, 4), ReplayBuffer(RUNS, 4, obs_dim=2)
    other.fill(buffer.rows())
    for t in range(count, count + 3):
        buffer.add(transition(t)), other.add(transition(t))
    times = range(max(0, count - 1), count + 3)
    places = (torch.arange(len(times)) / len(times)).expand(RUNS, -1)
    for held in (buffer, other):
        assert_are(held.sample(places), times, list(range(RUNS)))
