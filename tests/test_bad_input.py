"""Bad input to the method: one line with the name and the value.

What tasks, results and the command line refuse is tested beside those.
"""

import math

import attrs
import gymnasium as gym
import numpy as np
import pytest
import torch
from attrs import evolve
from torch import nn

import vtlib
from vtbook import neighbours
from vtlab.bases import RBFLinear
from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import LARGEST, SHOWN, one_line, shown
from vtlib.learned import Learned
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.rng import Rng
from vtlib.transfer import Settings
from vtlib.trust import Trust

Q = MLP((2, 3, 2))

NO_NUMBER = [None, "3", True, math.nan, math.inf, -math.inf, 1e300, torch.ones(1), [1], 1j]
NO_NUMBER += [np.float32(1), np.int64(3)]
COUNT = [*(x for x in NO_NUMBER if type(x) is not np.int64), 0, -1, 1.0, 2.5, LARGEST + 1]
POSITIVE = [*NO_NUMBER, 0, 0.0, -1e-6, 9e-38, 1.1e38]
NEGATIVE = [*NO_NUMBER, -1e-6]
SHARE = [*NO_NUMBER, -1e-9, 1 + 1e-7]
WORD = [None, 3, "", "exact ", "student", ["full"]]
BY_KIND = [
    ("components minibatch buffer n_samples epsilon_steps target_every", COUNT),
    ("every recent updates trials trial episodes", COUNT),
    ("alpha alpha_mu alpha_L bandwidth sigma_p2 sigma_min jitter enough epsilon", POSITIVE),
    ("kappa", [*POSITIVE, 9e-4]),
    ("clip kl_clip", POSITIVE[1:]),
    ("lambda_ bias scale optimism strength", NEGATIVE),
    ("psi epsilon_start epsilon_end random", SHARE),
    ("gamma beta1 beta2", [*SHARE, 1]),
    ("family init act covariance kl prior start responsibilities pull", WORD),
    ("patience", [*COUNT[:-5], -1, 0.0]),
    ("ddof", [*COUNT[:-5], -1, 2, 0.5]),
    ("learner", [*WORD, Settings()]),
    ("settings", WORD),
    ("sources_play held", [*WORD, 0, 1]),
]
BAD = {name: values for names, values in BY_KIND for name in names.split()}
# what the same names mean elsewhere
OWN = {
    neighbours.VariedTrust: {"learner": WORD},
}
AGENTS = [Settings("gaussian"), Settings(components=2), MellowTDSettings(5), DDQNSettings(5)]
ALL = [*AGENTS, Trust()]
NEIGHBOURS = [getattr(neighbours, x)() for x in neighbours.__all__]


def refused(call, *arguments, **named) -> str:
    """The one line with which a call is refused."""
    with pytest.raises(ValueError) as caught:
        call(*arguments, **named)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 500
    return message


@pytest.mark.parametrize("config", [Settings(), *ALL[2:], FineTuning(AGENTS[2]), *NEIGHBOURS])
def test_every_field_refuses_what_it_cannot_be(config):
    bad = {**BAD, **OWN.get(type(config), {})}
    for name in (field.name for field in attrs.fields(type(config))):
        # a field that joins a configuration has to join its checks, too
        for value in bad[name]:
            message = refused(evolve, config, **{name: value})
            assert message.startswith(f"{name} must ")
            assert message.endswith(f", got {shown(value)}")


ENVS, CART = [gym.make("CartPole-v1")], MLP((4, 3, 2))
WEIGHTS, RUNS, NONE = torch.ones(1, 1, CART.d), torch.ones(1), torch.empty(0, dtype=torch.int64)
PARTS = WEIGHTS, NONE, torch.empty(1, 0), RUNS.long(), RUNS.bool()
LEARNED = Learned(*PARTS, q=CART, settings=Trust())
LEARNING = {"envs": ENVS, "q": CART, "iterations": 1, "seed": 0, "callback": None}
PLAYING = {"envs": ENVS, "q": CART, "weights": WEIGHTS, "episodes": 1, "gamma": 0.9, "seed": 0}
MORE = {"learned": LEARNED, "envs": ENVS, "iterations": 1, "callback": None}
FRONT_DOOR = [
    (vtlib.solve, {**LEARNING, "settings": None}),
    (vtlib.transfer, {**LEARNING, "sources": WEIGHTS[0], "settings": None, "device": "cpu"}),
    (vtlib.evaluate, PLAYING),
    (vtlib.resume, MORE),
    (LEARNED.predict, {"obs": np.zeros(4), "run": 0}),
    (ModuleQ, {"module": nn.Linear(4, 2), "n_actions": 2}),
]
ODD = [*(x for x in NO_NUMBER if type(x) is not np.int64), "a\nb", "/", b"x", -1, 2.5, [], {}, ()]
ODD += [[None], object(), len, int, Settings, np.ones((2, 3)), np.full(4, math.nan), np.array("x")]
ODD += [torch.ones(3), math.nan * WEIGHTS, WEIGHTS.double(), Q]
# what is odd elsewhere, and right here
RIGHT = {"settings": [None], "callback": [None, len, int, Settings]}


@pytest.mark.parametrize(("call", "arguments"), FRONT_DOOR)
def test_every_argument_of_the_front_door_refuses_what_it_cannot_be(call, arguments):
    for name in arguments:
        for value in ODD:
            if shown(value) not in map(shown, RIGHT.get(name, ())):
                message = refused(call, **{**arguments, name: value})
                assert name in message, value
                assert any(word in message for word in (" must ", "needs ")), message
                assert "got" in message


def test_parts_of_a_setting_that_do_not_go_together_are_refused():
    for changes in (
        {"components": 2},
        {"init": "mean"},
        {"init": "span", "family": "mixture"},
        {"init": "span", "covariance": "diagonal"},
    ):
        name, value = next(iter(changes.items()))
        message = refused(Settings, **{"family": "gaussian", **changes})
        assert message.startswith(f"{name} must ")
        assert repr(value) in message


@pytest.mark.parametrize("config", ALL)
def test_weights_that_are_none_are_refused(config):
    good, rng = torch.ones((2, 3, Q.d) if config.transfers else (2, Q.d)), Rng("t", [0, 1])
    bad = [good[:0], good[..., 1:], good[0], good[None], good.double(), good * math.nan]
    name = "sources" if config.transfers else "weights"
    for w in [*bad, None, good.tolist(), good.numpy(), *([good[:, :0]] * config.transfers)]:
        assert refused(config.agent, Q, w, 2, rng).startswith(f"{name} must ")
    assert refused(config.agent, Q, good[0], 2, rng).endswith(f"got {tuple(good[0].shape)}")
    assert "must be float32, got" in refused(config.agent, Q, good.double(), 2, rng)
    assert "must be finite, got" in refused(config.agent, Q, -math.inf * good, 2, rng)


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


def test_what_does_not_fit_a_q_function_is_refused():
    for sizes in (None, 3, (), (4,), "44", (4, 0), (4, 2.0), (4, None), (4, True), torch.ones(3)):
        assert refused(MLP, sizes).startswith(("sizes must list", "each of sizes must be a whole"))
    for layer, why in ((nn.BatchNorm1d(2), "0.r"), (nn.ReLU(), "none")):
        assert f"it has {why}" in refused(ModuleQ, nn.Sequential(layer), 2)
    for count in COUNT:
        assert "n_actions must be" in refused(ModuleQ, nn.Linear(2, 2), count)
    # the bases would look at the first two numbers and not notice the others
    for q in (RBFLinear(torch.arange(3.0), 1.0, 2), Q):
        assert "must have 2 numbers" in refused(q.prepare, torch.zeros(1, 1, 4))


def test_values_are_shown_in_one_line_that_is_not_too_long():
    assert shown("a\nb") == r"'a\nb'"
    assert shown("x" * 999) == "'" + "x" * (SHOWN - 1) + "..."
    assert one_line("a\n\u2028λ") == r"a\n\u2028λ"


def test_a_whole_number_of_numpy_becomes_one_of_python():
    settings = Settings(components=np.int64(3), patience=np.uint8(2))
    assert settings == Settings(components=3, patience=2)
    assert {type(settings.components), type(settings.patience)} == {int}
    assert FineTuning().learner == MellowTDSettings(1, minibatch=200, epsilon_start=0.02)
