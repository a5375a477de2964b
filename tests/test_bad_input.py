"""Bad input to algorithms: one line with the name and the value; and all else can be learned with.

What a check refuses is tested beside the checks, and what tasks, results and the command line
refuse beside those.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import attrs
import pytest
import torch
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st

from vtbook.neighbours import (
    HeadsSettings,
    HierarchicalSettings,
    IVONSettings,
    LangevinSettings,
    RegressionSettings,
)
from vtlib.baselines import DDQNSettings, LearnerSettings, MellowTDSettings
from vtlib.checks import LARGEST, shown
from vtlib.qfunctions import MLP, ModuleQ, RBFLinear
from vtlib.replay import ReplayBuffer, Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings

PROPERTY = settings(deadline=None, derandomize=True, max_examples=25)
Q = MLP((2, 3, 2))

NO_NUMBER = [None, "3", True, math.nan, math.inf, -math.inf, 1e300, torch.ones(1), [1]]
COUNT = [*NO_NUMBER, 0, -1, 1.0, 2.5, LARGEST + 1]
POSITIVE = [*NO_NUMBER, 0, 0.0, -1e-6, 1e-38]
NEGATIVE = [*NO_NUMBER, -1e-6]
SHARE = [*NO_NUMBER, -0.1, 1.1]
WORD = [None, 3, "", "exact ", "student", ["full"]]
LEARNER = {
    "epsilon_steps": COUNT,
    "epsilon_start": SHARE,
    "epsilon_end": SHARE,
    "gamma": [*SHARE, 1],
    "minibatch": COUNT,
    "buffer": COUNT,
    "alpha": POSITIVE,
}
TD = {
    **dict.fromkeys(("minibatch", "buffer"), COUNT),
    "psi": SHARE,
    "kappa": POSITIVE,
    "gamma": [*SHARE, 1],
}
TRANSFER = {
    **dict.fromkeys(("components", "minibatch", "buffer", "n_samples"), COUNT),
    **dict.fromkeys(("kappa", "alpha_mu", "alpha_L", "sigma_p2", "sigma_min", "jitter"), POSITIVE),
    **dict.fromkeys(("family", "init", "act", "covariance", "kl", "responsibilities"), WORD),
    "lambda_": NEGATIVE,
    "psi": SHARE,
    "gamma": [*SHARE, 1],
    "patience": [*COUNT[: len(NO_NUMBER)], -1, 0.0],
    "ddof": [*NO_NUMBER, -1, 2, 0.5],
    "clip": POSITIVE[1:],
    "kl_clip": POSITIVE[1:],
}
CONFIGURATIONS: list[tuple[Any, dict[str, list[Any]]]] = [
    (Settings(), TRANSFER),
    (LearnerSettings(100), LEARNER),
    (MellowTDSettings(100), {**LEARNER, "psi": SHARE, "kappa": POSITIVE}),
    (DDQNSettings(100), {**LEARNER, "target_every": COUNT}),
    (HeadsSettings(), {**TD, "heads": COUNT, "prior_scale": NEGATIVE, "alpha": POSITIVE}),
    (
        LangevinSettings(),
        {
            **TD,
            "lambda_": NEGATIVE,
            "bias": NEGATIVE,
            **dict.fromkeys(("alpha", "jitter", "sigma_p2"), POSITIVE),
            "prior": WORD,
        },
    ),
    (
        IVONSettings(),
        {
            **TD,
            **dict.fromkeys(("lambda_", "alpha", "h0", "clip", "jitter"), POSITIVE),
            "beta1": [*SHARE, 1],
            "beta2": [*SHARE, 1],
            "n_samples": COUNT,
        },
    ),
    (
        RegressionSettings(),
        {
            **TD,
            **dict.fromkeys(("noise", "jitter"), POSITIVE),
            **dict.fromkeys(("every", "recent"), COUNT),
            "alpha": SHARE,
        },
    ),
    (
        HierarchicalSettings(family="gaussian"),
        TRANSFER,
    ),
]


def refused(call: Callable[..., Any], *arguments: Any, **named: Any) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(ValueError) as caught:
        call(*arguments, **named)
    message = str(caught.value)
    assert message.isprintable()
    assert 0 < len(message) < 500
    return message


@pytest.mark.parametrize(("config", "bad"), CONFIGURATIONS)
def test_every_field_refuses_what_it_cannot_be(config, bad):
    # a field that joins a configuration has to join its checks, too
    assert {field.name for field in attrs.fields(type(config))} == bad.keys()
    for name, values in bad.items():
        for value in values:
            message = refused(evolve, config, **{name: value})
            assert message.startswith(f"{name} must ")
            assert message.endswith(f"got {shown(value)}")


@pytest.mark.parametrize(
    ("values", "name", "seen"),
    [
        ({"family": "gaussian", "components": 2}, "components", "2"),
        ({"family": "gaussian", "init": "mean"}, "init", "'mean'"),
        ({"family": "mixture", "init": "span"}, "init", "'span'"),
        ({"family": "gaussian", "covariance": "diagonal", "init": "span"}, "init", "'span'"),
    ],
)
def test_parts_of_a_setting_that_do_not_go_together_are_refused(values, name, seen):
    message = refused(Settings, **values)
    assert message.startswith(f"{name} must ")
    assert seen in message


# --- what is accepted can be learned with --------------------------------------------------------


def steps(agent: Any) -> None:
    """Three steps of an agent of two runs."""
    obs = torch.tensor([[1.0, 2.0], [-3.0, 0.5]])
    for t in range(3):
        action = agent.act(obs, torch.ones(2, dtype=torch.bool))
        agent.learn(Transition(obs, action, torch.ones(2), obs + t, torch.tensor([True, False])))


SIZES = st.sampled_from([1e-37, 1e-9, 1.0, 1e9, 1e38]) | st.floats(1e-37, 1e38)
SHARES = st.sampled_from([0, 1, 0.0, 1.0]) | st.floats(0, 1)
FEW = st.integers(1, 4)
VALUES = {
    **dict.fromkeys(("kappa", "alpha_mu", "alpha_L", "sigma_p2", "sigma_min", "alpha"), SIZES),
    **dict.fromkeys(("minibatch", "buffer", "n_samples", "target_every", "epsilon_steps"), FEW),
    "lambda_": st.just(0) | SIZES,
    "clip": st.none() | SIZES,
    "patience": st.integers(0, 3),
    "gamma": SHARES.filter(lambda value: value < 1),
    "psi": SHARES,
    "epsilon_end": SHARES,
}


@pytest.mark.parametrize(
    "config",
    [
        Settings("gaussian"),
        Settings("gaussian", covariance="dense"),
        Settings("gaussian", init="span", kl="diagonal"),
        Settings("gaussian", covariance="diagonal"),
        Settings(components=3, act="episode"),
        Settings(components=2, init="mean", responsibilities="equal"),
        Settings(covariance="diagonal"),
        MellowTDSettings(1),
        DDQNSettings(1),
    ],
)
def test_values_that_are_accepted_can_be_learned_with(config):
    names = [field.name for field in attrs.fields(type(config)) if field.name in VALUES]

    @PROPERTY
    @given(st.fixed_dictionaries({name: VALUES[name] for name in names}))
    def check(values):
        weights = torch.linspace(-1, 1, 2 * 3 * Q.d).view(2, 3, Q.d)
        given_ = weights if config.transfers else weights[:, 0]
        steps(evolve(config, **values).agent(Q, given_, 2, Rng("bad input", [0, 1])))

    check()


# --- weights and the rest ------------------------------------------------------------------------

AGENTS = [Settings("gaussian"), Settings(components=2), MellowTDSettings(5), DDQNSettings(5)]


@pytest.mark.parametrize("config", AGENTS)
def test_weights_that_are_none_are_refused(config):
    good = torch.ones((2, 3, Q.d) if config.transfers else (2, Q.d))
    bad = [good[:0], good[..., 1:], good[0], good[None], good[:1], good.double(), good * math.nan]
    name = "sources" if config.transfers else "weights"
    for w in [*bad, None, good.tolist(), good.numpy(), *([good[:, :0]] * config.transfers)]:
        message = refused(config.agent, Q, w, 2, Rng("t", [0, 1]))
        assert message.startswith((f"{name} must ", "there must be weights for each of 2 runs"))


def test_settings_of_another_algorithm_are_refused():
    for config in AGENTS:
        w = torch.ones(2, 3, Q.d) if config.transfers else torch.ones(2, Q.d)
        made = type(config.agent(Q, w, 2, Rng("t", [0, 1])))
        for wrong in (*(o for o in AGENTS if type(o) is not type(config)), None, "gaussian"):
            message = refused(made, Q, w, 2, wrong, Rng("t", [0, 1]))
            assert message.startswith(f"settings must be of type {type(config).__name__}, got ")


@pytest.mark.parametrize("change", [{}, {"init": "span"}, {"covariance": "diagonal"}])
def test_sources_are_used_or_too_far_apart(change):
    for apart in (1e3, 1e8, 1e30, 3e38):
        sources = apart * torch.cat([torch.eye(Q.d), -torch.eye(Q.d)]).unsqueeze(0)
        sources[0, -1] = apart
        try:
            agent = Settings("gaussian", **change).agent(Q, sources, 2, Rng("t", [0]))
        except ValueError as error:
            assert str(error).startswith("sources must lie closer to their mean")  # noqa: PT017
            assert apart > 1e3 or change == {"covariance": "diagonal"}
        else:
            assert torch.isfinite(agent.scale_tril).all()


def test_what_does_not_fit_a_q_function_or_a_buffer_is_refused():
    for sizes in (None, 3, (), (4,), "44", (4, 0), (4, 2.0), (4, None), (4, True), torch.ones(3)):
        assert refused(MLP, sizes).startswith("sizes must list at least two positive layer sizes")
    for count in COUNT:
        assert "n_actions must be" in refused(ModuleQ, torch.nn.Linear(2, 2), count)
        assert "n_actions must be" in refused(RBFLinear, torch.arange(3.0), 1.0, count)
        assert "capacity must be" in refused(ReplayBuffer, 1, count, 1)
    for variance in POSITIVE:
        assert "variance must be positive" in refused(RBFLinear, torch.arange(3.0), variance, 2)
    # the bases would look at the first two numbers and not notice the others
    for q in (RBFLinear(torch.arange(3.0), 1.0, 2), Q):
        assert "must have 2 numbers" in refused(q.prepare, torch.zeros(1, 1, 4))
