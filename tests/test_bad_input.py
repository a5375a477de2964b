"""Bad input at every public entry: one line with the name and the value, never a traceback.

What is checked by example beside each part is fuzzed here: configurations, tasks, source weights,
mazes as text, stored files and the command line.
"""

from __future__ import annotations

import io
import json
import math
import re
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from vtlib import __main__ as cli
from vtlib import gym_runs, sources, stats, store, transfer, widgets
from vtlib.baselines import DDQN, DDQNSettings, LearnerSettings, MellowTD, MellowTDSettings
from vtlib.checks import LARGEST
from vtlib.domains import DOMAINS
from vtlib.envs import Cartpole, Mazes, MountainCar, Rooms, load_mazes, parse_maze
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.gym import CartpoleEnv, MazeEnv, MazeVectorEnv, MountainCarEnv, RoomsEnv
from vtlib.envs.maze import MazeFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.envs.rooms import RoomsFamily, even_walls
from vtlib.experiments import EXPERIMENTS, POOLS, Experiment, work
from vtlib.experiments import runs as runs_of
from vtlib.experiments.experiment import slider_lambdas, sliders_of
from vtlib.experiments.verify import check_heads
from vtlib.qfunctions import MLP, ModuleQ, RBFLinear
from vtlib.replay import ReplayBuffer, Transition
from vtlib.sources import MazePool, NetworkPool, Pool
from vtlib.streams import Stream
from vtlib.transfer import PatientSettings, Settings, VariationalTransfer, initial_posterior

PROPERTY = settings(deadline=None, derandomize=True, max_examples=40)
PACKAGE = Path(store.__file__).parent
LONG = 10**5000  # more digits than Python writes down


def refusal(call: Callable[..., Any], *arguments: Any, **named: Any) -> tuple[str, list[str]]:
    """The one line with which a call is refused by vtlib itself, and the functions it came from."""
    with pytest.raises(ValueError) as caught:
        call(*arguments, **named)
    message = str(caught.value)
    assert type(caught.value) is ValueError, message
    code = [frame.f_code for frame, _ in traceback.walk_tb(caught.value.__traceback__)]
    file = code[-1].co_filename
    assert Path(file).is_relative_to(PACKAGE), f"{message!r} comes from {file}"
    assert len(message.splitlines()) == 1, message
    assert 0 < len(message) < 1000, message
    return message, [one.co_name for one in code]


def refused(call: Callable[..., Any], *arguments: Any, **named: Any) -> str:
    """The one line with which a call is refused."""
    return refusal(call, *arguments, **named)[0]


# --- configurations ------------------------------------------------------------------------------

NO_NUMBER = st.sampled_from(
    [None, "3", "", b"1", (), [1], {}, 1j, True, False, np.float32(1), np.ones(2), torch.ones(2)]
)
HOPELESS = st.sampled_from([math.nan, math.inf, -math.inf, 1e300, -1.0, LONG, -LONG])


def no_whole(least: int = 1, most: int = LARGEST) -> st.SearchStrategy:
    """Anything but the whole numbers between two."""
    outside = st.integers(max_value=least - 1) | st.integers(min_value=most + 1)
    return NO_NUMBER | HOPELESS | st.floats() | outside


# float32 holds what is allowed
NO_POSITIVE = NO_NUMBER | HOPELESS | st.floats(max_value=0) | st.sampled_from([0, 9e-38, 1.1e38])


def not_between(low: float, high: float, below: bool = False) -> st.SearchStrategy:
    """Anything but the numbers between two."""
    above = st.floats(min_value=high, exclude_min=not below)
    return NO_NUMBER | HOPELESS | st.floats(max_value=low, exclude_max=True) | above


def no_word(*allowed: str) -> st.SearchStrategy:
    """Anything but some words."""
    return NO_NUMBER | st.just(3) | st.text(max_size=20).filter(lambda text: text not in allowed)


NO_BOOL = st.sampled_from([None, 0, 1, 1.0, "True", "", (), np.bool_(True)])
NO_NAME = st.sampled_from(
    [
        None,
        3,
        b"x",
        (),
        " ",
        ".",
        "..",
        "../x",
        "a/b",
        "a\nb",
        "a\x00",
        "\u2028",
        "\ud800",
        "\x1b[1m",
    ]
)
NO_KIND = st.sampled_from([None, 3, "rooms", (), {}, Settings, object()])


def inside(*pairs: tuple[Any, Any]) -> st.SearchStrategy:
    """Values of a field that holds others, each with the part of it that is shown."""
    return st.sampled_from([Part(*pair) for pair in pairs])


class Part:
    """A value, and what of it an error has to show."""

    def __init__(self, value: Any, seen: Any) -> None:
        self.value, self.seen = value, seen

    def __repr__(self) -> str:
        return f"{self.value!r:.300}"


LEARNER = {
    "epsilon_steps": no_whole(),
    "epsilon_end": not_between(0, 1),
    "gamma": not_between(0, 1, below=True),
    "batch": no_whole(),
    "buffer": no_whole(),
    "alpha": NO_POSITIVE,
}
TRANSFER = {
    "family": no_word("gaussian", "mixture"),
    "components": no_whole(),
    "lambda_": not_between(0, 1e38),
    "psi": not_between(0, 1),
    "kappa": NO_POSITIVE,
    "gamma": not_between(0, 1, below=True),
    "batch": no_whole(),
    "buffer": no_whole(),
    "weights": no_whole(),
    "alpha_mu": NO_POSITIVE,
    "alpha_L": NO_POSITIVE,
    "sigma_p2": NO_POSITIVE,
    "sigma_min": NO_POSITIVE,
    "init": no_word("sources", "mean"),
    "act": no_word("step", "episode"),
    "covariance": no_word("full", "diagonal"),
}
POOL_FIELDS = {
    "name": NO_NAME | st.just(""),
    "family": NO_KIND,
    "count": no_whole(),
    "iterations": no_whole(),
    "limit": no_whole(),
    "check_every": no_whole(),
    "episodes": no_whole(),
    "required": not_between(0, 1),
    "attempts": no_whole(),
    "settings": NO_KIND | st.just(Settings()),
}
NETWORKS = {**POOL_FIELDS, "common": NO_BOOL, "twin": NO_NAME}

POOL = Pool(
    "tiny-pool",
    RoomsFamily(rooms=2),
    count=3,
    iterations=200,
    limit=210,
    episodes=2,
    settings=MellowTDSettings(epsilon_steps=100, batch=5),
)
NT, GVT = MellowTDSettings(epsilon_steps=100, batch=5), Settings("gaussian", batch=5, weights=2)
TINY = Experiment(
    "tiny", POOL, RoomsFamily(rooms=2), {"NT": NT, "GVT": GVT}, runs=2, sources=2, iterations=200
)
EXPERIMENT = {
    "name": NO_NAME | st.just(""),
    "pool": NO_KIND,
    "family": NO_KIND | st.just(CartpoleFamily()),
    "algorithms": NO_KIND.filter(lambda value: value is not object)
    | inside(
        ({"NT": 3}, 3),
        ({"NT": None}, None),
        ({"NT": LearnerSettings(5)}, LearnerSettings(5)),
        ({3: NT}, 3),
        ({"": NT}, ""),
        ({"a/b": NT}, "a/b"),
        ({"a\nb": NT}, "a\nb"),
        ({"tasks": NT}, "tasks"),
    ),
    "runs": no_whole(),
    "sources": no_whole(1, 3),
    "iterations": no_whole(),
    "every": no_whole(1, 200),
    "stream": NO_NAME,
    "runs_per_task": no_whole(),
    "counts": st.sampled_from([None, 3, [], "NT"])
    | inside(
        ({"DDQN": 1}, "DDQN"),
        ({3: 1}, 3),
        ({"NT": 0}, 0),
        ({"NT": 3}, 3),
        ({"NT": 1.0}, 1.0),
        ({"NT": True}, True),
        ({"NT": LONG}, LONG),
    ),
    "visits": NO_BOOL,
    "excluded": st.sampled_from([None, 1, [1], "1", {1}])
    | inside(
        ((3,), 3), ((-1,), -1), ((1.0,), 1.0), ((True,), True), (("1",), "1"), ((None,), None)
    ),
    "probes": no_whole(0) | st.just(5),  # 5 only without NT
}
ROOMS = {
    "rooms": no_whole(2, 3),
    "fixed_lower": not_between(0.5, 9.5).filter(lambda value: value is not None),
    "normal": st.sampled_from([3, "ab", (), (5.0,), (5.0, 1.0, 1.0), [5.0, 1.0], {5.0: 1.0}])
    | inside(
        ((0.0, 1.0), 0.0),
        ((math.nan, 1.0), math.nan),
        ((None, 1.0), None),
        (("5", 1.0), "5"),
        ((5.0, 0.0), 0.0),
        ((5.0, math.inf), math.inf),
        ((5.0, math.nan), math.nan),
        ((5.0, None), None),
        ((5.0, True), True),
    ),
}
MAZE = {
    "names": st.sampled_from([None, 3, (), [], "north-east 1", ["north-east 1"], {}])
    | inside(
        (("north 1",), "north 1"),
        (("north-east 1", 3), 3),
        (("north-east 1", None), None),
        (("a\nb",), "a\nb"),
        (([],), []),
    ),
}
CONFIGURATIONS = [
    (Settings(), TRANSFER),
    (PatientSettings(), {**TRANSFER, "patience": no_whole(0)}),
    (LearnerSettings(100), LEARNER),
    (MellowTDSettings(100), {**LEARNER, "psi": not_between(0, 1), "kappa": NO_POSITIVE}),
    (DDQNSettings(100), {**LEARNER, "target_every": no_whole()}),
    (POOL, POOL_FIELDS),
    (NetworkPool("carts", CartpoleFamily()), NETWORKS),
    (
        MazePool("mazes", MazeFamily(), count=20),
        {**NETWORKS, "family": NO_KIND | st.just(RoomsFamily()), "count": no_whole(20, 20)},
    ),
    (TINY, EXPERIMENT),
    (RoomsFamily(), ROOMS),
    (MazeFamily(), MAZE),
    (CartpoleFamily(), {}),
    (MountainCarFamily(), {}),
]
FIELDS = [(config, name) for config, bad in CONFIGURATIONS for name in bad]


@pytest.mark.parametrize(
    ("config", "bad"), CONFIGURATIONS, ids=[type(config).__name__ for config, _ in CONFIGURATIONS]
)
def test_every_field_of_a_configuration_is_fuzzed(config, bad):
    # a field that joins a configuration has to join its checks, too
    assert [field.name for field in fields(config)] == list(bad)


@pytest.mark.parametrize(
    ("config", "name"), FIELDS, ids=[f"{type(config).__name__}-{name}" for config, name in FIELDS]
)
def test_a_bad_value_is_refused_by_the_name_of_its_field(config, name):
    bad = next(bad for other, bad in CONFIGURATIONS if other is config)[name]

    @settings(PROPERTY, max_examples=15)
    @given(bad)
    def check(value):
        whole, seen = (value.value, value.seen) if isinstance(value, Part) else (value, value)
        message, path = refusal(replace, config, **{name: whole})
        assert "__post_init__" in path
        assert name in message
        long = type(seen) is int and abs(seen) == LONG  # Python does not write it down
        expected = "a value of type int" if long else repr(seen)[:150]
        assert f"got {expected}" in message

    check()


SMALL = MLP((2, 3, 2))
POSITIVE = st.sampled_from([1e-37, 1e-9, 1e-3, 1.0, 1e3, 1e9, 1e38]) | st.floats(1e-37, 1e38)
SHARE = st.sampled_from([0, 1, 0.0, 1.0]) | st.floats(0, 1)
COUNT = st.integers(1, 4)


def steps(agent: Any) -> None:
    """Three steps of an agent of two runs on transitions that never change."""
    obs = torch.tensor([[1.0, 2.0], [-3.0, 0.5]])
    for t in range(3):
        action = agent.act(obs, torch.ones(2, dtype=torch.bool))
        agent.learn(Transition(obs, action, torch.ones(2), obs + t, torch.tensor([True, False])))


def streams(*roles: str) -> list[Stream]:
    return [Stream("bad input", [0, 1], role) for role in roles]


@PROPERTY
@given(
    st.fixed_dictionaries(
        {
            "lambda_": st.just(0) | POSITIVE,
            "psi": SHARE,
            "gamma": SHARE.filter(lambda value: value < 1),
            **dict.fromkeys(("kappa", "alpha_mu", "alpha_L", "sigma_p2", "sigma_min"), POSITIVE),
            **dict.fromkeys(("batch", "buffer", "weights"), COUNT),
            "act": st.sampled_from(["step", "episode"]),
        }
    ),
    st.sampled_from(
        [
            {"family": "gaussian"},
            {"family": "gaussian", "init": "span"},
            {"components": 3},
            {"components": 2, "init": "mean"},
            {"family": "gaussian", "covariance": "diagonal"},
            {"covariance": "diagonal"},
        ]
    ),
    st.sampled_from([1000, 1]),  # from so many weights on the update of L is put off
)
def test_settings_that_are_accepted_can_be_learned_with(values, kind, large):
    weights = torch.linspace(-1, 1, 2 * 3 * SMALL.d).view(2, 3, SMALL.d)
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(transfer, "LARGE", large)
        three = streams("noise", "component", "replay")
        steps(VariationalTransfer(SMALL, weights, 2, Settings(**kind, **values), *three))


@PROPERTY
@given(
    st.fixed_dictionaries(
        {
            "epsilon_end": SHARE,
            "gamma": SHARE.filter(lambda value: value < 1),
            "alpha": POSITIVE,
            **dict.fromkeys(("epsilon_steps", "batch", "buffer"), COUNT),
        }
    ),
    st.sampled_from([(MellowTD, MellowTDSettings), (DDQN, DDQNSettings)]),
)
def test_settings_without_transfer_that_are_accepted_can_be_learned_with(values, kind):
    learner, configuration = kind
    steps(learner(SMALL, torch.ones(2, SMALL.d), 2, configuration(**values), *streams("a", "b")))


def test_settings_of_another_algorithm_are_refused():
    for learner, wrong in ((MellowTD, DDQNSettings(5)), (DDQN, NT), (DDQN, GVT), (MellowTD, None)):
        message = refused(learner, SMALL, torch.ones(2, SMALL.d), 2, wrong, *streams("a", "b"))
        assert message.startswith(f"settings must be of type {learner.needs.__name__}, got ")
    for wrong in (NT, None, "gaussian"):
        three = streams("noise", "component", "replay")
        message = refused(VariationalTransfer, SMALL, torch.ones(2, 1, 17), 2, wrong, *three)
        assert message.startswith("settings must be of type Settings, got ")


def test_parts_of_a_setting_that_do_not_go_together_are_refused():
    wrong = [
        ({"family": "gaussian", "components": 2}, "components", "2"),
        ({"family": "gaussian", "init": "mean"}, "init", "'mean'"),
        ({"family": "mixture", "init": "span"}, "init", "'span'"),
        ({"family": "gaussian", "covariance": "diagonal", "init": "span"}, "init", "'span'"),
    ]
    for values, name, seen in wrong:
        message = refused(Settings, **values)
        assert message.startswith(f"{name} must be ")
        assert f"got {seen}" in message


def test_sliders_around_what_they_cannot_show_are_refused():
    assert "lambda_" in refused(slider_lambdas, Settings(lambda_=0.0))
    assert "1-MGVT" in refused(sliders_of, TINY, "tiny-sliders", 2, 200)
    assert "lambda_ must be one of" in refused(widgets.parameter_axes, Settings(lambda_=3e-4))
    assert "psi must be one of" in refused(widgets.parameter_axes, Settings(psi=0.3))


# --- tasks and environments ----------------------------------------------------------------------

KINDS = [torch.float32, torch.float64, torch.int64, torch.bool]
TENSORS = st.one_of(
    st.sampled_from([None, 3, "x", [[5.0]], np.ones((2, 1), np.float32)]),
    st.builds(
        lambda shape, kind, value: torch.full(shape, value).to(kind),
        st.sampled_from([[2], [2, 1]]) | st.lists(st.integers(0, 3), max_size=3),
        st.sampled_from(KINDS),
        st.sampled_from([-1.0, 0.0, 1.0, 5.0, math.nan, math.inf, 1e30]),
    ),
)
GOAL = torch.tensor([[9, 9]])


def accepted_or_refused(call: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
    """What a call gives, or None when it was refused with one line."""
    try:
        return call(*arguments, **named)
    except ValueError:
        refused(call, *arguments, **named)
        return None


@pytest.mark.parametrize("name", ["cart_mass", "pole_mass", "half_length"])
def test_cartpoles_of_bad_tensors_are_refused(name):
    @PROPERTY
    @given(TENSORS)
    def check(value):
        one = dict.fromkeys(("cart_mass", "pole_mass", "half_length"), torch.ones(2))
        tasks = accepted_or_refused(Cartpole, **{**one, name: value})
        assert tasks is None or value.shape == (2,)

    check()


@PROPERTY
@given(TENSORS)
def test_cars_and_rooms_of_bad_tensors_are_refused(value):
    accepted_or_refused(MountainCar, value)
    accepted_or_refused(Rooms.from_doors, value)
    doors = accepted_or_refused(Rooms, value, even_walls(1))
    assert doors is None or doors.doors.dtype == torch.float32
    accepted_or_refused(Rooms, torch.full((2, 1), 5.0), value)


@PROPERTY
@given(TENSORS)
def test_mazes_of_bad_tensors_are_refused(value):
    refused(Mazes, value, GOAL)
    refused(Mazes, torch.zeros(1, 10, 10, dtype=torch.bool), value)


def test_an_unknown_kind_of_start_is_refused():
    assert "uniform_start" in refused(Rooms.from_doors, [5.0], "no")


NO_INDEX = st.sampled_from([None, "0", ["0"], [None], [[0], [0, 1]], [2**70], [9], {}, 0, [0.5]])


@PROPERTY
@given(NO_INDEX)
def test_a_bad_index_of_tasks_is_refused(index):
    for tasks in (Rooms.from_doors([5.0]), MountainCar(torch.ones(1)), Mazes.of(["north-east 1"])):
        assert "index must" in refused(tasks.select, index)


@pytest.mark.parametrize(
    "family", [RoomsFamily(), CartpoleFamily(), MountainCarFamily(), MazeFamily()]
)
def test_a_bad_count_of_tasks_is_refused(family):
    @PROPERTY
    @given(no_whole())
    def check(count):
        assert "count" in refused(family.sample, np.random.default_rng(0), count)

    check()


ARGUMENTS = [
    (
        CartpoleEnv,
        "cart_mass",
        (NO_NUMBER | HOPELESS).filter(lambda value: not isinstance(value, np.float32 | list)),
    ),
    (MountainCarEnv, "speed", st.sampled_from([None, "fast", [1.0, 2.0], -1.0, math.nan, 1e300])),
    (RoomsEnv, "doors", st.sampled_from([None, 5.0, "a", ["a"], [], [[1.0], [1.0, 2.0]], [99.0]])),
    (RoomsEnv, "uniform_start", NO_BOOL),
    (MazeEnv, "maze", st.sampled_from([None, 3, "north 1", ["north-east 1"], b"x"])),
    (MazeVectorEnv, "maze", st.sampled_from([None, 3, [], ["north-east 1"] * 2, [3]])),
    (MazeVectorEnv, "num_envs", no_whole()),
    (CartpoleEnv, "horizon", no_whole()),
    (CartpoleEnv, "render_mode", st.sampled_from(["human", 3, ["rgb_array"], "\n"])),
]


@pytest.mark.parametrize(
    ("env", "name", "bad"), ARGUMENTS, ids=[f"{env.__name__}-{name}" for env, name, _ in ARGUMENTS]
)
def test_a_bad_argument_of_an_environment_is_refused_by_its_name(env, name, bad):
    @settings(PROPERTY, max_examples=15)
    @given(bad)
    def check(value):
        assert name in refused(env, **{name: value})

    check()


# --- mazes as text -------------------------------------------------------------------------------

DRAWING = "\n".join(["#........G", *["#........."] * 8, ".........."])


@st.composite
def altered(draw: st.DrawFn, text: str, letters: st.SearchStrategy) -> str:
    """A text with a few pieces replaced by others, which may be empty."""
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        text = text[:start] + draw(letters) + text[end:]
    return text


LETTERS = st.text("#.G; \na", max_size=12) | st.text(max_size=3)


@settings(PROPERTY, max_examples=100)
@given(altered(DRAWING, LETTERS) | st.text(max_size=30))
def test_a_drawing_is_a_maze_that_can_be_played_or_is_refused(text):
    maze = accepted_or_refused(parse_maze, text, "mine\n")
    if maze is not None:
        tasks = Mazes.of([maze])
        assert torch.isfinite(tasks.observe(tasks.start(torch.full((1, 4), 0.5)))).all()


@settings(PROPERTY, max_examples=100)
@given(
    altered(f"; two\none\n{DRAWING}\n\ntwo\n{DRAWING}\n", LETTERS).map(
        lambda text: text.encode(errors="surrogatepass")
    )
    | st.binary(max_size=40)
)
def test_a_file_of_mazes_is_read_or_refused_and_stays(data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "my\nmazes.txt")
        path.write_bytes(data)
        accepted_or_refused(load_mazes, path)
        assert path.read_bytes() == data


@pytest.mark.parametrize("text", [None, 3, b"#", ["#"]])
def test_a_drawing_that_is_no_text_is_refused(text):
    assert refused(parse_maze, text).startswith("text must be of type str, got ")


def test_a_file_that_is_not_utf_8_is_refused_by_its_name(tmp_path):
    (tmp_path / "own.txt").write_bytes(f"one\n{DRAWING}".encode("utf-16"))
    assert refused(load_mazes, tmp_path / "own.txt").startswith("own.txt: it is not text in UTF-8")


# --- source weights ------------------------------------------------------------------------------

EDGES = [-1e38, -1e9, -1.0, 0.0, 1e-30, 1.0, 1e9, 3e38]


@st.composite
def weight_arrays(draw: st.DrawFn, *sizes: int) -> np.ndarray:
    """Arrays that are often, in all but one regard, weights of that shape."""
    shape = list(sizes)
    kind, value = "f4", draw(st.sampled_from(EDGES))
    how = draw(st.sampled_from(["shape", "axes", "kind", "value", "spread"]))
    if how == "shape":
        shape[draw(st.integers(0, len(shape) - 1))] = draw(st.integers(0, 20))
    elif how == "axes":
        shape = draw(st.sampled_from([[], shape[1:], [1, *shape], [sizes[-1]], [0]]))
    elif how == "kind":
        kind = draw(st.sampled_from(["f8", "f2", "i8", "?", "c8", ">f4"]))
    array = np.full(shape, value)
    if how == "value" and array.size:
        array.flat[draw(st.integers(0, array.size - 1))] = draw(
            st.sampled_from([math.nan, math.inf, -math.inf])
        )
    if how == "spread":
        array = array * np.linspace(-1, 1, array.size).reshape(shape)
    with np.errstate(all="ignore"):
        return array.astype(kind)


def as_tensor(array: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(array.astype(array.dtype.newbyteorder("=")))


def usable(weights: np.ndarray | torch.Tensor, *shape: int | None) -> bool:
    """Whether weights are what the documentation asks for, None standing for any size."""
    sizes = tuple(weights.shape)
    fits = len(sizes) == len(shape) and all(
        n == m or (m is None and n > 0) for n, m in zip(sizes, shape, strict=True)
    )
    kind = str(weights.dtype).removeprefix("torch.")
    return fits and kind == "float32" and bool(np.isfinite(np.asarray(weights)).all())


@settings(PROPERTY, max_examples=100)
@given(
    weight_arrays(2, 3, SMALL.d),
    st.sampled_from(
        [
            Settings("gaussian", weights=1),
            Settings("gaussian", weights=1, init="span"),
            Settings("gaussian", weights=1, covariance="diagonal"),
            Settings(weights=1, components=2),
        ]
    ),
)
def test_sources_are_used_or_refused(array, configuration):
    weights = as_tensor(array)
    three = streams("noise", "component", "replay")
    agent = accepted_or_refused(VariationalTransfer, SMALL, weights, 2, configuration, *three)
    accepted_or_refused(initial_posterior, weights, configuration)
    if not usable(weights, 2, None, SMALL.d):
        assert agent is None
    elif agent is None:  # only a Gaussian's covariance knows of more to refuse
        assert configuration.family == "gaussian"
        assert weights.abs().max() > 1e3
    else:
        assert torch.isfinite(agent.L).all()


@pytest.mark.parametrize("weights", [None, 3, "x", [[[0.0] * 17]], np.zeros((1, 1, 17), "f4")])
def test_sources_that_are_no_tensor_are_refused(weights):
    three = streams("noise", "component", "replay")
    message = refused(VariationalTransfer, SMALL, weights, 2, Settings(), *three)
    assert message.startswith("sources must be of type Tensor, got ")
    assert refused(initial_posterior, weights, Settings()).startswith("sources must be ")
    assert refused(gym_runs.transfer, [], SMALL, weights, 1).startswith("sources must be ")


@pytest.mark.parametrize("spread", [1e3, 1e30])
@pytest.mark.parametrize("change", [{}, {"init": "span"}, {"covariance": "diagonal"}])
def test_sources_too_far_apart_for_a_covariance_are_refused_or_used(spread, change):
    # as many as weights, in all directions: rounding leaves no variance of a weight by itself
    corners = spread * torch.cat([torch.eye(SMALL.d), -torch.eye(SMALL.d)]).unsqueeze(0)
    start = accepted_or_refused(initial_posterior, corners, Settings("gaussian", **change))
    if start is None:
        assert "closer to their mean" in refused(
            initial_posterior, corners, Settings("gaussian", **change)
        )
    else:
        assert torch.isfinite(start[0].L).all()


def test_sources_that_belong_to_a_module_are_taken_without_their_gradients():
    weights = torch.ones(2, 1, SMALL.d, requires_grad=True)
    three = streams("noise", "component", "replay")
    steps(VariationalTransfer(SMALL, weights, 2, Settings(batch=2, weights=2), *three))
    assert weights.grad is None


@settings(PROPERTY, max_examples=60)
@given(weight_arrays(3, 484))
def test_a_pool_of_weights_is_used_or_refused(weights):
    batch = accepted_or_refused(runs_of.prepare, TINY, "GVT", GVT, [0, 1], weights)
    if not usable(weights, 3, 484):
        assert batch is None
        assert "weights of tiny-pool must" in refused(runs_of.run_batch, TINY, "GVT", [0], weights)


@settings(PROPERTY, max_examples=60)
@given(weight_arrays(2, SMALL.d))
def test_first_weights_are_used_or_refused(array):
    weights = as_tensor(array)
    agent = accepted_or_refused(MellowTD, SMALL, weights, 2, NT, *streams("a", "b"))
    assert (agent is not None) == usable(weights, 2, SMALL.d)


CART = gym.make("CartPole-v1", disable_env_checker=True)


@settings(PROPERTY, max_examples=60)
@given(weight_arrays(2, 14))
def test_sources_of_gym_environments_are_used_or_refused(array):
    weights, q = as_tensor(array), MLP((4, 2, 2))
    learned = accepted_or_refused(
        gym_runs.transfer, [CART], q, weights, 1, Settings(batch=2, weights=1)
    )
    assert (learned is not None) == usable(weights, None, q.d)
    if learned is None and weights.ndim != 2:
        # the shape that was given, not one with an axis for the runs
        message = refused(gym_runs.transfer, [CART], q, weights, 1)
        assert message.endswith(f"got {tuple(weights.shape)}")


@pytest.mark.parametrize("call", ["solve", "transfer"])
def test_what_does_not_fit_gym_environments_is_refused(call):
    def run(
        envs: Any = (CART,), sizes: tuple = (4, 2, 2), iterations: Any = 1, **named: Any
    ) -> str:
        q = MLP(sizes)
        given_ = (torch.ones(1, q.d),) if call == "transfer" else ()
        return refused(getattr(gym_runs, call), envs, q, *given_, iterations, **named)

    assert run(envs=()) == "there must be at least one environment"
    assert "envs must be of type Sequence" in run(envs=CART)
    assert "environment must be of type Env" in run(envs=["CartPole-v1"])
    assert "environments' 2 actions, got 3" in run(sizes=(4, 2, 3))
    assert "observations must have 3 numbers for this Q-function, got 4" in run(sizes=(3, 2, 2))
    assert "settings must be of type" in run(settings=DDQNSettings(5))
    for value in (0, -1, 1.5, None, "1", True, LONG):
        assert "iterations must be a whole number" in run(iterations=value)


def test_what_does_not_fit_a_q_function_is_refused():
    for sizes in (None, 3, (), (4,), "44", (4, 0), (4, 2.0), (4, None), (4, True), np.ones(3)):
        assert "sizes must list" in refused(MLP, sizes)
    assert "n_actions" in refused(ModuleQ, torch.nn.Linear(2, 2), 0)
    for bad in (0.0, math.nan, math.inf, None, "1"):
        assert "variance must be positive" in refused(RBFLinear, torch.arange(3.0), bad, 2)
    # the bases would look at the first two numbers and not notice the others
    rooms = RBFLinear(torch.arange(3.0), 1.0, 2)
    assert "observations must have 2 numbers" in refused(rooms.prepare, torch.zeros(1, 1, 4))
    assert "capacity" in refused(ReplayBuffer, 1, 2.5, 1)


def test_a_live_panel_says_what_is_wrong_and_can_be_run_again(monkeypatch):
    def refuse(*_: Any, **__: Any) -> None:
        raise ValueError("counts must fit")

    curve = {"learning return": []}
    monkeypatch.setattr(widgets.LivePanel, "_draw", lambda *_: None)
    base = Settings(weights=1, batch=2)
    panel = widgets.LivePanel(TINY, base, np.ones((3, 484), "f4"), curve, 1.0, 2, 200)
    monkeypatch.setattr(widgets, "replace", refuse)
    panel.run()
    panel.wait()
    assert panel.message == "counts must fit"
    assert not panel._run.disabled


# --- statistics ----------------------------------------------------------------------------------

VALUES = st.lists(st.sampled_from([0.0, 1.0, 2.0, math.nan, math.inf]), max_size=4).map(np.array)


@PROPERTY
@given(VALUES, VALUES, st.none() | VALUES, st.sampled_from([5, 0, -1, 2.5, None]))
def test_statistics_of_bad_runs_are_refused(a, b, strata, draws):
    rng = np.random.default_rng(0)
    for call, arguments in (
        (stats.mean_interval, (a,)),
        (stats.difference_interval, (a, b)),
        (stats.slope_interval, (a, b)),
        (stats.improvement_interval, (a, b, rng, strata, draws)),
        (stats.bootstrap_interval, (a, rng, stats.interquartile_mean, strata, draws)),
    ):
        interval = accepted_or_refused(call, *arguments)
        assert interval is None or np.isfinite(interval).all()


@pytest.mark.parametrize("count", [0, 2, 4])
def test_strata_of_another_count_are_refused(count):
    runs, strata, rng = np.arange(3.0), np.arange(count), np.random.default_rng(0)
    for call in (
        lambda: stats.improvement_interval(runs, runs, rng, strata),
        lambda: stats.bootstrap_interval(runs, rng, strata=strata),
    ):
        assert refused(call) == f"3 runs need as many strata, got shape ({count},)"


# --- stored files --------------------------------------------------------------------------------


def prints(members: Any) -> np.ndarray:
    """Fingerprints of what was never computed."""
    return np.arange(12.0).reshape(3, 4) + np.array(list(members)).reshape(-1, 1, 1)


def arrays_of(owner: str, label: str) -> store.Arrays:
    """What is stored of the small experiment, made up."""
    if label == "sources":
        weights = np.linspace(-1, 1, 3 * 484, dtype=np.float32).reshape(3, 484)
        return {"index": np.arange(3), "weights": weights, "fingerprints": prints(range(3))}
    if label == "tasks":
        return runs_of.task_table(TINY)
    flat = np.ones((2, 2), np.float32)
    return {
        "run": np.arange(2),
        "iterations": np.array([100, 200]),
        "learning": flat,
        "greedy": flat,
        "fingerprints": prints(range(2)),
    }


@pytest.fixture(scope="module")
def complete() -> Iterator[Path]:
    """Results of the small experiment, and what lets them verify without any training."""
    with pytest.MonkeyPatch.context() as monkeypatch, tempfile.TemporaryDirectory() as folder:
        for name in list(EXPERIMENTS):
            monkeypatch.delitem(EXPERIMENTS, name)
        monkeypatch.setitem(EXPERIMENTS, TINY.name, TINY)
        monkeypatch.setitem(POOLS, POOL.name, POOL)
        planned = replace(DOMAINS[RoomsFamily], optimum=lambda tasks: torch.ones(len(tasks)))
        monkeypatch.setitem(DOMAINS, RoomsFamily, planned)
        monkeypatch.setattr(sources, "head", lambda pool, members: prints(members))
        monkeypatch.setattr(runs_of, "head", lambda e, label, members, pool: prints(members))
        for owner, label in work.results_of(TINY):
            note = {"config": work.config_of(owner, label), "seconds": 1.0}
            store.save(Path(folder, owner.name, label), arrays_of(owner.name, label), note)
        yield Path(folder)


COMMANDS = {
    "run": ["run", "tiny", "--jobs", "1", "--results"],
    "verify": ["verify", "tiny", "--results"],
    "reproduce": ["reproduce", "--only", "tiny", "--jobs", "1", "--fresh"],
}


def command(name: str, root: Path) -> tuple[int, str]:
    """Exit code of a command on a folder of results, and what it says on stderr."""
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = cli.main([*COMMANDS[name], str(root)])
    return code, err.getvalue()


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def assert_one_line_at_most(name: str, root: Path) -> int:
    """Run a command; it succeeds in silence or says one line, and leaves every file as it is."""
    before = contents(root)
    code, error = command(name, root)
    assert contents(root) == before
    if code == 0:
        assert error == ""
    else:
        assert code == 2
        assert error.startswith("vtlib: ")
        assert len(error.splitlines()) == 1, error
    return code


@pytest.mark.parametrize("name", COMMANDS)
def test_results_that_nobody_touched_are_accepted(complete, name):
    assert assert_one_line_at_most(name, complete) == 0


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """Bytes with some flipped, removed or put in."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, max(0, len(data) - 1)))
        how = draw(st.sampled_from(["flip", "remove", "insert", "cut"]))
        if how == "flip" and data:
            data = data[:at] + bytes([data[at] ^ draw(st.integers(1, 255))]) + data[at + 1 :]
        elif how == "remove":
            data = data[:at] + data[at + draw(st.integers(1, 20)) :]
        elif how == "insert":
            data = data[:at] + draw(st.binary(min_size=1, max_size=8)) + data[at:]
        else:
            data = data[:at]
    return data


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("ending", ["npz", "json"])
def test_damaged_bytes_are_one_line(complete, name, ending):
    @PROPERTY
    @given(st.data())
    def check(data):
        result = data.draw(st.sampled_from(["tiny-pool/sources", "tiny/tasks", "tiny/GVT"]))
        whole = (complete / f"{result}.{ending}").read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            root = Path(shutil.copytree(complete, Path(folder, "results")))
            path = root / f"{result}.{ending}"
            path.write_bytes(data.draw(damaged(whole)))
            code = assert_one_line_at_most(name, root)
            if ending == "npz" and path.read_bytes() != whole:
                assert code == 2
            if code == 0:
                assert store.same_arrays(
                    store.load(root / result)[0], arrays_of(*result.split("/"))
                )

    check()


def loaded_or_torn(root: Path, result: str) -> store.Arrays | None:
    """What is loaded, or None where one line says why not; the files stay as they are."""
    before = contents(root)
    try:
        arrays, _ = store.load(root / result)
    except (store.TornResult, FileNotFoundError) as error:
        arrays, said = None, str(error)
    else:
        said = "nothing"
    assert len(said.splitlines()) == 1, said
    assert contents(root) == before
    return arrays


@settings(PROPERTY, max_examples=50)
@given(st.data())
def test_damaged_bytes_are_torn_or_load_as_they_were(data):
    arrays = {"a": np.arange(5), "b": np.linspace(0, 1, 6, dtype=np.float32).reshape(2, 3)}
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        store.save(root / "x", arrays, {"seconds": 1.0, "config": {"name": "λ"}})
        for ending in data.draw(st.sampled_from([["npz"], ["json"], ["npz", "json"]])):
            path = root / f"x.{ending}"
            path.write_bytes(data.draw(damaged(path.read_bytes())))
        loaded = loaded_or_torn(root, "x")
        assert loaded is None or store.same_arrays(loaded, arrays)


def provenance(complete: Path, result: str, **change: Any) -> dict[str, Any]:
    return {**json.loads((complete / f"{result}.json").read_text()), **change}


@settings(PROPERTY, max_examples=50)
@given(JSON)
def test_json_that_is_no_provenance_is_torn(value):
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        store.save(root / "x", {"a": np.arange(3)}, {})
        for other in (value, {"sha256": value}):
            (root / "x.json").write_text(json.dumps(other))
            assert loaded_or_torn(root, "x") is None
            if not isinstance(value, str):
                with pytest.raises(store.TornResult, match=r"x\.json is no provenance: it must be"):
                    store.load(root / "x")


@pytest.mark.parametrize("name", COMMANDS)
def test_another_configuration_is_one_line_whatever_it_is(complete, name):
    @settings(PROPERTY, max_examples=25)
    @given(JSON | st.sampled_from(["\n", {"\n": "\u2028"}]))
    def check(value):
        with tempfile.TemporaryDirectory() as folder:
            root = Path(shutil.copytree(complete, Path(folder, "results")))
            note = provenance(complete, "tiny/GVT", config=value)
            (root / "tiny/GVT.json").write_text(json.dumps(note))
            assert assert_one_line_at_most(name, root) == 2
            with pytest.raises(store.TornResult) as caught:
                work.load_result("tiny", "GVT", root)
            assert len(str(caught.value).splitlines()) == 1

    check()


@pytest.mark.parametrize("depth", [10, 300, *range(860, 1000, 7), 100_000])
def test_json_nested_deeply_is_one_line(complete, tmp_path, depth):
    root = Path(shutil.copytree(complete, tmp_path / "results"))
    note = json.dumps(provenance(complete, "tiny/GVT", config=0))
    nested = "[" * depth + "]" * depth
    (root / "tiny/GVT.json").write_text(note.replace('"config": 0', f'"config": {nested}'))
    assert assert_one_line_at_most("verify", root) == 2


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("ending", ["npz", "json"])
def test_an_empty_file_is_one_line(complete, tmp_path, name, ending):
    root = Path(shutil.copytree(complete, tmp_path / "results"))
    (root / f"tiny/GVT.{ending}").write_bytes(b"")
    assert assert_one_line_at_most(name, root) == 2


def test_a_damaged_result_is_not_replaced_by_saving_again(tmp_path):
    store.save(tmp_path / "x", {"a": np.arange(3)}, {})
    (tmp_path / "x.npz").write_bytes(b"")
    before = contents(tmp_path)
    with pytest.raises(store.TornResult, match="digest differs"):
        store.save(tmp_path / "x", {"a": np.arange(3)}, {})
    assert contents(tmp_path) == before


def stored_anew(root: Path, result: str, **change: np.ndarray | None) -> None:
    """Replace or leave out arrays of a result, as somebody would who knows its digest."""
    arrays, note = store.load(root / result)
    store.remove(root / result)
    kept = {key: array for key, array in {**arrays, **change}.items() if array is not None}
    store.save(root / result, kept, note)


@pytest.mark.parametrize(
    "wrong",
    [
        None, np.zeros(0), np.zeros((3, 484)), np.zeros((2, 484), "f4"), np.zeros((3, 483), "f4"),
        np.full((3, 484), np.nan, "f4"), np.full((3, 484), "0"), np.float32(0),
    ],
    ids=["missing", "empty", "float64", "count", "width", "nan", "text", "number"],
)  # fmt: skip
def test_stored_sources_of_another_shape_are_one_line(complete, tmp_path, wrong):
    root = Path(shutil.copytree(complete, tmp_path / "results"))
    stored_anew(root, "tiny-pool/sources", weights=wrong)
    before = contents(root)
    code, error = command("verify", root)
    assert (code, contents(root)) == (2, before)
    assert error.startswith("vtlib: weights of tiny-pool must ")
    assert len(error.splitlines()) == 1
    assert "weights of tiny-pool must " in refused(work.pool_weights, POOL, root)


@pytest.mark.parametrize("key", ["fingerprints", "optimum", "sources", "doors"])
@pytest.mark.parametrize(
    "wrong",
    [None, np.zeros(0), np.float64(0), np.zeros((1, 3, 4)), np.zeros((2, 5)), np.full(2, "x")],
    ids=["missing", "empty", "number", "one run", "axes", "text"],
)
def test_stored_arrays_of_another_shape_never_verify(complete, tmp_path, key, wrong):
    root = Path(shutil.copytree(complete, tmp_path / "results"))
    stored_anew(root, "tiny/GVT" if key == "fingerprints" else "tiny/tasks", **{key: wrong})
    code, error = command("verify", root)
    assert code in (1, 2)
    assert error == "" or error == f"vtlib: {root / 'tiny/GVT'} does not hold 2 fingerprints\n"


@pytest.mark.parametrize("seconds", [None, "1", [1]])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_provenance_without_seconds_is_one_line(complete, tmp_path, name, seconds):
    root = Path(shutil.copytree(complete, tmp_path / "results"))
    note = provenance(complete, "tiny/GVT", seconds=seconds)
    (root / "tiny/GVT.json").write_text(json.dumps(note))
    assert assert_one_line_at_most(name, root) == 2


@pytest.mark.parametrize("member", [2, -1, 1.0, None, True])
def test_a_run_that_is_not_stored_cannot_be_verified(complete, member):
    assert "got " in refused(check_heads, "tiny", "GVT", complete, [member])


def test_a_folder_whose_name_has_lines_is_shown_in_one(complete, tmp_path):
    for name in COMMANDS:
        root = Path(shutil.copytree(complete, tmp_path / f"{name}\nresults"))
        (root / "tiny/GVT.npz").write_bytes(b"")
        assert assert_one_line_at_most(name, root) == 2


# --- the command line ----------------------------------------------------------------------------


def ended(*arguments: str) -> str:
    """The last line with which a command ends that was refused."""
    err = io.StringIO()
    with redirect_stderr(err):
        try:
            code = cli.main(list(arguments))
        except SystemExit as end:  # of argparse, which says how the command is used first
            code = end.code
    assert code == 2
    assert "Traceback" not in err.getvalue()
    return err.getvalue().splitlines()[-1]


@settings(PROPERTY, max_examples=25)
@given(st.text(max_size=20).filter(lambda text: text != "tiny" and not text.startswith("-")))
def test_an_unknown_experiment_is_one_line(complete, name):
    for command_ in (["run", name], ["verify", name], ["reproduce", "--only", name]):
        assert ended(*command_) == f"vtlib: unknown experiment {name!r}; known are tiny"


@settings(PROPERTY, max_examples=25)
@given(st.integers(max_value=0).map(str) | st.text(max_size=9).filter(lambda x: not x.isdigit()))
def test_a_bad_number_of_processes_is_named(complete, jobs):
    line = ended("run", "tiny", f"--jobs={jobs}")
    assert "argument --jobs: must be a whole number of at least 1, got " in line


@pytest.mark.parametrize("name", COMMANDS)
def test_results_that_are_a_file_are_one_line(complete, tmp_path, name):
    path = tmp_path / "results"
    path.write_text("mine")
    code, error = command(name, path)
    assert (code, len(error.splitlines())) == (2, 1)
    assert error.startswith("vtlib: ")
    assert path.read_text() == "mine"


# --- nothing that is read can run ----------------------------------------------------------------

EXECUTES = re.compile(
    r"\b(c?pickle|dill|joblib|shelve|marshal)\b|\btorch\.load\b|\byaml\.(unsafe_)?load\b"
    r"|allow_pickle=(?!False)|\bnp\.load\((?!.*allow_pickle=False)|(?<![.\w])(eval|exec)\("
)


@pytest.mark.parametrize(
    "code",
    [
        "import pickle", "torch.load(path)", "np.load(path)", "np.load(path, allow_pickle=True)",
        "yaml.load(text)", "eval(text)", "exec(text)", "x = [eval(text)]",
    ],
)  # fmt: skip
def test_code_that_could_run_what_it_reads_is_found(code):
    assert EXECUTES.search(code)


@pytest.mark.parametrize("code", ["np.load(x, allow_pickle=False)", "model.eval()", "retrieval(x)"])
def test_code_that_only_looks_so_is_left_alone(code):
    assert not EXECUTES.search(code)


def test_no_code_of_the_library_or_the_book_runs_what_it_reads():
    files = [*PACKAGE.rglob("*.py"), *(PACKAGE.parent / "book").rglob("*.py")]
    assert len(files) > 60
    for path in files:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            assert not EXECUTES.search(line), f"{path}:{number}: {line}"
