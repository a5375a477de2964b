"""Solving, transfer and evaluation on ordinary Gymnasium environments."""

from functools import partial

import attrs
import gymnasium as gym
import numpy as np
import pytest
import torch

from vtlib import playing
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.files import TornResult
from vtlib.gym_runs import resume, solve, transfer
from vtlib.learned import Learned
from vtlib.playing import evaluate
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.transfer import Settings
from vtlib.trust import Trust
from vtlib.units import sound

Q = MLP((4, 8, gym.spaces.Discrete(2).n))
LEARNER = MellowTDSettings(epsilon_steps=100, minibatch=20)
TRANSFER = Settings(minibatch=20, n_samples=2, alpha_L=1e-4)
SOURCES = 0.5 * torch.randn(6, Q.d, generator=torch.Generator().manual_seed(0))


class Corridor(gym.Env):
    """Action 1 pays 1 and action 0 nothing, for some steps."""

    action_space = gym.spaces.Discrete(2)

    def __init__(self, length: float = 5, space: tuple[int, ...] = (4,)) -> None:
        self.observation_space = gym.spaces.Box(-1, 1, space, np.float32)
        self._length = length

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._left = self._length
        return self.observation_space.high, {}

    def step(self, action):
        self._left -= 1
        return self.observation_space.high, float(action), False, self._left == 0, {}


def always(action: int) -> torch.Tensor:
    """Weights (d,) of a policy that always takes an action."""
    return torch.eye(Q.d)[-2 + action]


ENV, LINEAR = Corridor(), torch.nn.Linear(4, 3)
FLAT = torch.nn.Sequential(LINEAR, torch.nn.Flatten(0))
NAN = gym.wrappers.TransformReward(Corridor(), lambda _: np.nan)
BLIND = gym.wrappers.TransformObservation(Corridor(), lambda _: [0.0, np.nan, 0.0, 0.0], None)
BOTH = torch.stack([always(0), always(1)])
ENDLESS = Corridor(np.inf)
VECTOR = gym.vector.SyncVectorEnv([Corridor])
SOLVED = solve([Corridor()], Q, 1, LEARNER)


def test_a_source_that_keeps_its_promise_is_kept():
    learned = transfer([Corridor(), Corridor()], Q, BOTH, 200)
    earned = evaluate([Corridor(), Corridor()], Q, learned.weights).mean(1)
    torch.testing.assert_close(earned, torch.full((2,), sum(0.99**t for t in range(5))))
    assert not learned.improved.any()
    torch.testing.assert_close(learned.weights, always(1).expand_as(learned.weights))
    played = learned.state["played"][0].tolist()
    assert len(played) == 200 // 5  # the last ends with the last step
    assert (played[0], played[1:-8].count(1) > 28, played[-7:]) == (0, True, [2] * 7)
    told = f"run 0: 200 steps, sources played {len(played) - played.count(2)} of 40 episodes, kept"
    told += " is a source"
    assert str(learned).splitlines()[0] == told


def test_a_source_that_has_diverged_is_left_out():
    huge = 1e3 * torch.randn(1, Q.d, generator=torch.Generator().manual_seed(0))
    with pytest.warns(UserWarning, match=r"left out are sources \[1\]"):
        learned = transfer([Corridor()], Q, torch.cat([BOTH[:1], huge, BOTH[1:]]), 100)
    alone = transfer([Corridor()], Q, BOTH, 100)
    torch.testing.assert_close(learned.weights, alone.weights)
    torch.testing.assert_close(learned.state["means"], alone.state["means"])
    # of two nobody can tell which is wrong
    assert sound(torch.cat([BOTH[:1], huge])).all()


@pytest.mark.parametrize("learner", [LEARNER, DDQNSettings(100)])
def test_seeds_repeat_and_differ(learner):
    env = gym.make("CartPole-v1")
    first, again, other = (solve([env], Q, 120, learner, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(first.weights, again.weights)
    assert not torch.equal(first.weights, other.weights)


def test_a_callback_is_told_and_ends_the_learning_of_returns_known_once_an_episode_has_ended():
    calls = []

    def callback(iteration, returns, weights):
        calls.append((iteration, returns.shape, weights.shape))
        return torch.tensor(iteration < 200)

    settings, envs = attrs.evolve(LEARNER, gamma=0.5), [Corridor(), Corridor(np.inf)]
    learned = solve(envs, Q, 1000, settings, callback=callback)
    assert calls == [(100, (2,), (2, 1, Q.d)), (200, (2,), (2, 1, Q.d))]
    assert (learned.steps.tolist(), learned.iterations.tolist()) == ([200] * 2, [100, 200])
    assert ((learned.returns[0] > 0) & (learned.returns[0] <= 1.9375)).all()
    assert torch.isnan(learned.returns[1]).all()


@pytest.mark.parametrize("settings", [None, TRANSFER, FineTuning(LEARNER)])
def test_what_was_learned_is_saved_whole(settings, tmp_path):
    learned = transfer([Corridor()], Q, SOURCES[:2], 120, settings, seed=7)
    learned.save(tmp_path / "new" / "learned.npz")
    again = Learned.load(tmp_path / "new" / "learned.npz")
    parts, others = (attrs.asdict(x, recurse=False) for x in (learned, again))
    assert others.pop("q").sizes == parts.pop("q").sizes
    assert parts.pop("settings") == (settings or Trust())
    assert others.pop("settings") == (None if settings else Trust())  # which alone goes on
    torch.testing.assert_close(others, parts, rtol=0, atol=0, equal_nan=True)
    assert (learned.state is None) == (settings is not None)
    assert settings is None or learned.improved.all()


def test_a_file_that_is_not_whole_is_named(tmp_path):
    (tmp_path / "cut.npz").write_bytes(b"PK\x03\x04 cut")
    np.savez(tmp_path / "other.npz", weights=np.zeros(3))
    np.savez(tmp_path / "list.npz", about=np.array("[1]"))
    np.save(tmp_path / "array.npy", np.zeros((2, 3)))
    for path in tmp_path.iterdir():
        with pytest.raises(TornResult, match=rf"{path.name} is not what Learned\.save wrote"):
            Learned.load(path)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (partial(evaluate, [ENDLESS], Q, BOTH[:1, None]), "got 50 steps .*TimeLimit ends"),
        (partial(solve, [NAN], Q, 10), "rewards must be finite, .* gave nan"),
        (partial(evaluate, [BLIND], Q, BOTH[:1, None]), "needs 4 finite numbers to see, .* gave"),
        (partial(transfer, [ENV], Q, SOURCES, 10, device="cuda:99"), r"device .*got 'cuda:99'"),
        (partial(solve, [ENV, gym.Wrapper(ENV)], Q, 10), "got one that is given twice"),
        (partial(solve, [Corridor(space=(2, 2))], Q, 10), "FlattenObservation makes one of most"),
        (partial(solve, [gym.make("FrozenLake-v1")], Q, 10), "Box observation space, got Discrete"),
        (partial(solve, [gym.make("Pendulum-v1")], Q, 10), "a value: .*TransformAction"),
        (partial(solve, [ENV], MLP((4, 8, 3)), 10), "the environments' 2 actions, got 3"),
        (partial(solve, [ENV], ModuleQ(LINEAR, np.int64(2)), 10), "2 actions, got 2 and 3 values"),
        (partial(solve, [ENV], ModuleQ(FLAT, 2), 10), "q must value an observation"),
        (partial(transfer, [ENV], Q, SOLVED, 10), r"got Learned.*: pass .weights\[:, 0\] of it$"),
        (partial(resume, SOLVED, [ENV], 10), "settings of learned must be of type Trust, got Mel"),
        (partial(solve, VECTOR, Q, 10), "envs must be .*: pass its .envs"),
        (partial(solve, [VECTOR], Q, 10), "each of envs must be of type Env, got SyncVectorEnv"),
        (partial(solve, "CartPole-v1", Q, 10), "envs must be a list, such as .env., got 'CartPole"),
        (partial(solve, Corridor(), Q, 10), "envs must be a list, such as .env., got"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_with_what_would_help(monkeypatch, call, message):
    monkeypatch.setattr(playing, "LONGEST", 50)
    with pytest.raises(ValueError, match=message):
        call()


class Stopped(Corridor):
    """A corridor in which Ctrl-C is pressed at some step."""

    def __init__(self, at: int) -> None:
        super().__init__()
        self.steps, self.at = 0, at

    def step(self, action):
        self.steps += 1
        if self.steps == self.at:
            raise KeyboardInterrupt
        return super().step(action)


@pytest.mark.parametrize("learn", [partial(transfer, sources=BOTH), solve])
def test_an_interrupt_returns_what_was_learned(learn):
    learned = learn(envs=[Stopped(21)], q=Q, iterations=30)
    assert learned.interrupted
    assert learned.steps.tolist() == [20]


def test_evaluate_discounts_the_rewards_of_whole_episodes():
    earned = evaluate([Corridor(), Corridor(3)], Q, BOTH[[1, 1]].unsqueeze(1), 2, gamma=0.5)
    assert earned.tolist() == [[1.9375] * 2, [1.75] * 2]


def wins(share: float) -> gym.Env:
    """An environment of one step in which action 1 pays 1, and action 0 in that share of cases."""
    coin = np.random.default_rng(0)
    pay = gym.wrappers.TransformReward
    return pay(Corridor(1), lambda reward: max(reward, float(coin.random() < share)))


@pytest.mark.parametrize(("share", "kept"), [(0.0, True), (1.0, False)])
def test_a_trial_in_the_end_decides_what_is_kept_and_a_tie_keeps_the_source(share, kept):
    sources = torch.stack([always(0), always(0) + 0.1 * always(1)])
    learned = transfer([wins(share)], Q, sources, 2000)
    assert learned.improved.tolist() == [kept]
    assert evaluate([wins(0.0)], Q, learned.weights, 1).item() == kept
    assert learned.steps.tolist() == [2000]
    played = learned.state["played"][0].tolist()
    assert played[-400:].count(2) >= 200  # of which the last fifth of the steps consists
    # to go on for a few steps, which no trial fits in, loses nothing
    assert resume(learned, [wins(share)], 1).improved.tolist() == [kept]


def test_learning_goes_on_from_what_was_learned(tmp_path):
    transfer([Corridor()], Q, BOTH, 120).save(tmp_path / "learned.npz")
    learned = Learned.load(tmp_path / "learned.npz")
    more = resume(learned, [Corridor()], 100)
    assert more.iterations.tolist() == [100, 220]
    assert more.steps.tolist() == more.state["steps"].tolist() == [220]
    assert (more.weights - learned.weights).abs().max() < 0.5
    with pytest.raises(ValueError, match="envs must be 1, one for each run of learned, got 2"):
        resume(learned, [Corridor(), Corridor()], 10)
