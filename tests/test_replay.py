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
    terminal = (torch.arange(RUNS) + t) % 3 == 0
    return Transition(obs, action, t + 0.1 * runs, obs + 0.5, terminal)


def filled(count: int, capacity: int) -> ReplayBuffer:
    buffer = ReplayBuffer(RUNS, capacity, obs_dim=2)
    for t in range(count):
        buffer.add(transition(t))
    return buffer


def everything(buffer: ReplayBuffer) -> Transition:
    """Each stored transition once."""
    uniforms = (torch.arange(len(buffer)) + 0.5) / len(buffer)
    return buffer.sample(uniforms.expand(RUNS, -1))


def assert_holds(buffer: ReplayBuffer, times: range) -> None:
    got = everything(buffer)
    order = got.obs[0, :, 0].argsort()
    expected = [torch.stack(parts, 1) for parts in zip(*map(transition, times), strict=True)]
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
def test_the_last_transitions_are_kept(count, capacity):
    buffer = filled(count, capacity)
    assert len(buffer) == min(count, capacity)
    assert_holds(buffer, range(max(0, count - capacity), count))


def test_every_run_samples_its_own_transitions():
    batch = filled(10, 100).sample(torch.rand(RUNS, 50, generator=torch.Generator().manual_seed(0)))
    for r in range(RUNS):
        assert (batch.obs[r, :, 1] == r).all()


def test_parts_of_a_sample_belong_together():
    batch = filled(30, 20).sample(torch.rand(RUNS, 50, generator=torch.Generator().manual_seed(0)))
    t = batch.obs[..., 0].long()
    runs = torch.arange(RUNS).unsqueeze(1)
    assert torch.equal(batch.action, (t + runs) % 5)
    assert torch.equal(batch.reward, t + 0.1 * runs)
    assert torch.equal(batch.next_obs, batch.obs + 0.5)
    assert torch.equal(batch.terminal, (t + runs) % 3 == 0)


def test_sampling_is_uniform_with_replacement():
    cells, draws = 8, 40_000
    uniforms = torch.rand(RUNS, draws, generator=torch.Generator().manual_seed(0))
    times = filled(12, cells).sample(uniforms).obs[..., 0].long()
    for r in range(RUNS):
        counts = torch.bincount(times[r] - 4, minlength=cells).double()
        # chi-squared with 7 degrees of freedom: 24.3 has probability 0.001
        assert ((counts - draws / cells).square() / (draws / cells)).sum() < 24.3


def test_the_ends_of_the_unit_interval_are_valid():
    largest = torch.tensor(1.0).nextafter(torch.tensor(0.0))
    batch = filled(7, 20).sample(torch.stack([torch.zeros(RUNS), largest.expand(RUNS)], 1))
    assert batch.obs[:, :, 0].tolist() == [[0.0, 6.0]] * RUNS


def test_a_sample_does_not_change_with_the_buffer():
    buffer = filled(4, 4)
    batch = everything(buffer)
    before = batch.obs.clone()
    buffer.add(transition(99))
    assert torch.equal(batch.obs, before)


def test_an_empty_buffer_cannot_be_sampled():
    with pytest.raises(ValueError, match="empty replay buffer"):
        ReplayBuffer(RUNS, 4, 2).sample(torch.zeros(RUNS, 1))


@pytest.mark.parametrize("capacity", [0, -1])
def test_capacity_must_be_positive(capacity):
    with pytest.raises(ValueError, match="capacity must be a whole number from 1"):
        ReplayBuffer(RUNS, capacity, 2)
