"""Ring buffers of transitions: what is kept, what is overwritten, and how it is sampled."""

from __future__ import annotations

import pytest
import torch

from vtlib.replay import ReplayBuffer, Transition

RUNS = 3


def transition(t: int) -> Transition:
    """Transition t of each run, recognisable in all its parts."""
    runs = torch.arange(RUNS, dtype=torch.float32)
    obs = torch.stack([torch.full((RUNS,), float(t)), runs], -1)
    action = (torch.arange(RUNS) + t) % 5
    return Transition(obs, action, t + 0.1 * runs, obs + 0.5, (torch.arange(RUNS) + t) % 3 == 0)


def filled(count: int, capacity: int) -> ReplayBuffer:
    buffer = ReplayBuffer(RUNS, capacity, obs_dim=2)
    for t in range(count):
        buffer.add(transition(t))
    return buffer


def assert_holds(buffer: ReplayBuffer, times: range, runs: list[int]) -> None:
    uniforms = (torch.arange(len(buffer)) + 0.5) / len(buffer)  # each stored transition once
    got = buffer.sample(uniforms.expand(len(runs), -1))
    order = got.obs[0, :, 0].argsort()
    expected = [torch.stack(parts, 1)[runs] for parts in zip(*map(transition, times), strict=True)]
    for ours, wanted in zip(got, expected, strict=True):
        assert ours.dtype == wanted.dtype
        assert torch.equal(ours[:, order], wanted)


# 1024 rows are allocated first; a buffer grows by doubling up to its capacity
@pytest.mark.parametrize(
    ("count", "capacity"),
    [
        (1, 4), (4, 4), (5, 4), (11, 4), (3, 1),
        (1024, 5000), (1025, 5000), (2049, 5000), (2600, 2500),
        (1500, 1500), (1501, 1500), (4000, 1500), (1024, 1024), (1030, 1024),
    ],
)  # fmt: skip
def test_the_last_transitions_are_kept_of_every_run_and_of_some(count, capacity):
    buffer = filled(count, capacity)
    assert len(buffer) == min(count, capacity)
    times = range(max(0, count - capacity), count)
    assert_holds(buffer, times, [0, 1, 2])
    buffer.keep([2, 0])
    assert_holds(buffer, times, [2, 0])


def test_sampling_is_uniform_with_replacement_and_never_past_the_end():
    cells, draws = 8, 40_000
    uniforms = torch.rand(RUNS, draws, generator=torch.Generator().manual_seed(0))
    times = filled(12, cells).sample(uniforms).obs[..., 0].long()
    for r in range(RUNS):
        counts = torch.bincount(times[r] - 4, minlength=cells).double()
        # chi-squared with 7 degrees of freedom: 24.3 has probability 0.001
        assert ((counts - draws / cells).square() / (draws / cells)).sum() < 24.3
    largest = torch.tensor(1.0).nextafter(torch.tensor(0.0))
    for count in (3, 7, 20):
        ends = torch.stack([torch.zeros(RUNS), largest.expand(RUNS)], 1)
        assert filled(count, 20).sample(ends).obs[:, :, 0].tolist() == [[0.0, count - 1.0]] * RUNS


def test_a_sample_does_not_change_with_the_buffer():
    buffer = filled(4, 4)
    batch = buffer.sample(torch.rand(RUNS, 9, generator=torch.Generator().manual_seed(0)))
    before = [part.clone() for part in batch]
    buffer.add(transition(99))
    assert all(torch.equal(part, was) for part, was in zip(batch, before, strict=True))


def test_an_empty_buffer_cannot_be_sampled():
    with pytest.raises(ValueError, match="empty replay buffer"):
        ReplayBuffer(RUNS, 4, 2).sample(torch.zeros(RUNS, 1))


@pytest.mark.parametrize(("added", "asked"), [(3, 5), (5, 5), (7, 4), (23, 8)])
def test_the_last_are_the_last_in_whatever_order(added, asked):
    buffer = ReplayBuffer(2, 8, 1)
    for t in range(added):
        mark = torch.full((2, 1), float(t))
        buffer.add(Transition(mark, mark[:, 0].long(), mark[:, 0], mark, mark[:, 0] < 0))
    last = buffer.last(asked)
    wanted = list(range(max(0, added - asked), added))
    assert [sorted(row) for row in last.action.tolist()] == [wanted, wanted]
    torch.testing.assert_close(last.obs[..., 0], last.reward)
