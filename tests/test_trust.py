"""The agent that plays sources or what it learned: its neighbours, and what it shows."""

import pytest
import torch
from torch import nn

from vtlib.qfunctions import ModuleQ, greedy
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.trust import Trust
from vtlib.units import FIRST

FEATURES, ACTIONS, RUNS, SOURCES, LENGTH = 4, 2, 2, 3, 8
Q = ModuleQ(nn.Linear(FEATURES, ACTIONS, bias=False), ACTIONS)


def sources():
    return torch.randn(RUNS, SOURCES, Q.d, generator=torch.Generator().manual_seed(7))


def run(steps, rows=(0, 1), reward=1.0, weights=None, **settings):
    """An agent after so many transitions in episodes of eight, and its actions on the way."""
    g, rows = torch.Generator().manual_seed(0), list(rows)
    weights = sources()[rows] if weights is None else weights
    agent = Trust(**settings).agent(Q, weights, FEATURES, Rng("trust", rows))
    actions = []
    for t in range(steps):
        obs, after = torch.randn(2, RUNS, FEATURES, generator=g)[:, rows]
        fresh = torch.full((len(rows),), t % LENGTH == 0)
        actions.append(agent.act(obs, fresh))
        end = torch.full((len(rows),), t % LENGTH == LENGTH - 1)
        earned = torch.full((len(rows),), reward)
        agent.learn(Transition(obs, actions[-1], earned, after, end))
    return agent, torch.stack(actions)


def test_a_source_that_keeps_its_promise_acts():
    agent, actions = run(3 * LENGTH)
    record = agent.records[0]
    assert record.short == [0.0, 0.0]
    assert max(record.played) < SOURCES
    g = torch.Generator().manual_seed(0)
    obs = torch.stack([torch.randn(2, RUNS, FEATURES, generator=g)[0] for _ in range(LENGTH)])
    first = torch.stack([greedy(Q, sources()[:, :1], x) for x in obs])
    assert torch.equal(actions[:LENGTH], first)
    assert torch.equal(agent.mu[:, 0], sources()[[0, 1], [r.best() for r in agent.records]])


def test_what_was_learned_acts_where_promises_are_broken():
    agent, _ = run(FIRST + 20 * LENGTH, reward=-5.0)
    played = agent.records[0].played
    assert set(played[: FIRST // LENGTH]) == set(range(SOURCES))
    assert played.count(SOURCES) > 10
    torch.testing.assert_close(agent.mu, agent.learned.mu)
    assert len(agent.records[0].trust) == len(played)


def test_sources_that_may_not_play_leave_every_episode_to_what_was_learned():
    agent, _ = run(3 * LENGTH, reward=1e6, sources_play=False)  # they would keep any promise
    assert agent.state()["played"].tolist() == RUNS * [2 * [SOURCES]]
    # too few steps for it to leave the sources' mean, where it starts
    torch.testing.assert_close(agent.mu, sources().mean(1, keepdim=True))
    unit = sources().square().mean((1, 2)).sqrt().view(-1, 1, 1, 1)
    torch.testing.assert_close(agent.learned.scale_tril, 0.003 * unit * torch.eye(Q.d))
    assert agent.improved.all()


def test_in_a_trial_what_had_been_learned_acts_and_learning_goes_on():
    agent, _ = run(FIRST + 4 * LENGTH, reward=-1.0)
    before, still = agent.learned.mu, torch.zeros(RUNS, dtype=torch.bool)
    agent.judge()
    agent._arm[:], agent._lost[:], agent.random = SOURCES, True, 1.0
    for seed in range(20):
        obs = torch.randn(RUNS, FEATURES, generator=torch.Generator().manual_seed(seed))
        action, nothing = agent.act(obs, still), torch.zeros(RUNS)
        assert torch.equal(action, greedy(Q, before, obs))
        agent.learn(Transition(obs, action, nothing, obs, nothing.bool()))
    assert (agent.learned.mu - before).abs().max() > 1e-4
    for record, own in zip(agent.records, (9.0, -9.0), strict=True):
        record.played, record.gained = [0, 0, *[SOURCES] * 5], [0.0, 0.0, *[own] * 5]
        record.judged = 2
    assert agent.improved.tolist() == [True, False]
    torch.testing.assert_close(agent.kept, torch.stack([before[0], sources()[1, :1]]))


def test_actions_are_random_now_and_then_where_nothing_is_earned():
    agent, _ = run(FIRST + LENGTH, reward=-1.0)
    agent.random, obs = 0.25, torch.randn(RUNS, FEATURES)
    agent._arm[:], agent._lost[:] = SOURCES, torch.tensor([True, False])
    still = torch.zeros(RUNS, dtype=torch.bool)
    own = agent.learned.act(obs, still)
    strayed = torch.stack([agent.act(obs, still) != own for _ in range(400)]).float().mean(0)
    assert strayed[0] == pytest.approx(0.125, abs=0.05)  # half of random actions are its own
    assert strayed[1] < 0.02  # where draws of its weights differ


def test_a_source_that_has_learned_nothing_hides_no_broken_promise():
    alike = sources()[:, :1] * torch.tensor([1.0, 1.01, 0.99, 0.0]).view(1, 4, 1)
    agent, _ = run(FIRST + 10 * LENGTH, reward=-1.0, weights=alike)
    assert all(record.kept()[0] == [] for record in agent.records)


def test_a_run_does_not_depend_on_its_neighbours():
    (both, acts), (alone, own) = run(150, reward=-5.0), run(150, rows=[1], reward=-5.0)
    assert both.records[1] == alone.records[0]
    torch.testing.assert_close(alone.learned.mu[0], both.learned.mu[1], rtol=1e-4, atol=1e-5)
    assert (acts[:, 1:] == own).float().mean() > 0.98


def test_its_state_is_all_that_it_takes_to_go_on():
    before, _ = run(FIRST + 10 * LENGTH + 3, reward=-5.0)
    after = Trust().agent(Q, sources(), FEATURES, Rng("other", [0, 1]))
    after.restore(before.state())
    ended = len(before.records[0].gained)
    for mine, theirs in zip(after.records, before.records, strict=True):
        assert (mine.played, len(mine.trust)) == (theirs.played[:ended], ended)
        assert mine.gained == pytest.approx(theirs.gained)
        assert mine.short == pytest.approx(theirs.short)
    for agent in (before, after):  # the same random numbers from here on
        again, learner = Rng("again", [0, 1]), agent.learned
        learner._replay, learner._posterior._noise = again.stream("a"), again.stream("b")
        learner._samples = learner._posterior.sample()
    g = torch.Generator().manual_seed(9)
    for _ in range(3):
        obs, later = torch.randn(2, RUNS, FEATURES, generator=g)
        nothing = torch.zeros(RUNS)
        t = Transition(obs, nothing.long(), nothing, later, nothing.bool())
        before.learned.learn(t), after.learned.learn(t)
    torch.testing.assert_close(after.learned.mu, before.learned.mu)
