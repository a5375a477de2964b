"""The configurations have the numbers of the thesis' appendix A, and its page names them all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import pytest
from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.maze import MAIN, MAZE_TARGETS
from vtbook.experiments.mountain_car import CAR
from vtbook.experiments.protocols import Protocols
from vtbook.experiments.rooms import (
    ROOMS_CHANGE,
    ROOMS_EVALUATION,
    ROOMS_EXPLORATION,
    ROOMS_LIKELIHOOD,
    ROOMS_SOURCES,
)
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.experiments.experiment import Pool
from vtlib.transfer import Settings

PROTOCOLS = {"rooms": ROOMS_EVALUATION, "cartpole": CARTPOLE, "mountain car": CAR}
PROTOCOLS |= {"mazes": MAZE_TARGETS[MAIN]}
ENVIRONMENTS = {name: both.equations for name, both in PROTOCOLS.items()}
# Appendix A and chapter 6, entered by hand. Where the thesis says nothing, nothing is here.
TRANSFER = {
    "rooms": {
        "GVT": {"lambda_": 1e-4},
        "1-MGVT": {"lambda_": 1e-6, "sigma_p2": 1e-5},
        "3-MGVT": {"lambda_": 1e-6, "sigma_p2": 1e-5},
        "all": {"minibatch": 50, "buffer": 10_000, "n_samples": 10, "alpha_L": 0.1},
    },
    "cartpole": {
        "GVT": {},
        "1-MGVT": {"sigma_p2": 1e-5},
        "3-MGVT": {"sigma_p2": 1e-5},
        "all": {"lambda_": 1e-3, "minibatch": 500, "n_samples": 5, "alpha_L": 1e-4},
    },
    "mountain car": {
        "GVT": {},
        "1-MGVT": {"sigma_p2": 1e-5},
        "3-MGVT": {"sigma_p2": 1e-5},
        "all": {"lambda_": 1e-5, "minibatch": 500, "n_samples": 10, "alpha_L": 1e-4},
    },
    "mazes": {
        "GVT": {"alpha_L": 1e-7},
        "1-MGVT": {"alpha_L": 1e-6, "sigma_p2": 1e-5},
        "3-MGVT": {"alpha_L": 1e-6, "sigma_p2": 1e-5},
        "all": {"lambda_": 1e-6, "minibatch": 50, "buffer": 50_000, "n_samples": 10},
    },
}
EVERYWHERE = {"psi": 0.5, "gamma": 0.99, "alpha_mu": 1e-3, "sigma_min": 1e-4}
DDQN_CARTPOLE = {"minibatch": 150, "buffer": 50_000, "target_every": 500, "alpha": 1e-3}
DDQN_CAR = {"minibatch": 32, "buffer": 50_000, "target_every": 500, "alpha": 1e-3}
DDQN_MAZES = {"minibatch": 70, "buffer": 10_000, "target_every": 100, "alpha": 1e-3}
# Parameters of the thesis, and the share of the iterations over which epsilon falls.
LEARNERS = {
    ("rooms", "sources"): (
        MellowTDSettings,
        {"minibatch": 50, "buffer": 50_000, "psi": 0.5, "alpha": 1e-3, "epsilon_end": 0.02},
        0.7,
    ),
    ("cartpole", "sources"): (
        MellowTDSettings,
        {"minibatch": 150, "buffer": 50_000, "alpha": 1e-3},
        None,
    ),
    ("cartpole", "DDQN"): (DDQNSettings, DDQN_CARTPOLE, 0.35),
    ("mountain car", "sources"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mountain car", "DDQN"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mazes", "sources"): (DDQNSettings, DDQN_MAZES, 0.1),
    ("mazes", "DDQN"): (DDQNSettings, DDQN_MAZES, 0.1),
}
# One hidden layer of 32 units from 4 numbers to 2, and so on; 121 bases for each of 4 actions.
WEIGHTS = {
    "rooms": 121 * 4,
    "cartpole": 5 * 32 + 33 * 2,
    "mountain car": 3 * 64 + 65 * 3,
    "mazes": 23 * 32 + 33 * 32 + 33 * 3,
}
# What the published code does otherwise, also entered by hand.
PUBLISHED = {
    "GVT": {"init": "span", "ddof": 1, "kl_clip": 100.0},
    "1-MGVT": {"init": "mean", "responsibilities": "equal", "kl": "diagonal"},
}
PUBLISHED["3-MGVT"] = PUBLISHED["1-MGVT"]
PUBLISHED_IN_MAZES = {"GVT": {"kl": "diagonal"}}
PUBLISHED_IN_ROOMS = {"GVT": {"lambda_": 1e-3, "buffer": 50_000}, "1-MGVT": {"buffer": 50_000}}
PUBLISHED_IN_ROOMS["3-MGVT"] = PUBLISHED_IN_ROOMS["1-MGVT"]
ITERATIONS = {"rooms": 20_000, "cartpole": 10_000, "mountain car": 40_000, "mazes": 20_000}
POOLS = {"rooms": 50, "cartpole": 100, "mountain car": 50, "mazes": 20}


def with_values(thing: Any, expected: dict[str, Any]) -> dict[str, Any]:
    """What a configuration has under the names of what is expected of it."""
    return {name: getattr(thing, name) for name in expected}


@pytest.mark.parametrize("name", ENVIRONMENTS)
@pytest.mark.parametrize("label", ["GVT", "1-MGVT", "3-MGVT"])
def test_transfer_has_the_numbers_of_the_thesis(name: str, label: str) -> None:
    settings = ENVIRONMENTS[name].algorithms[label]
    expected = EVERYWHERE | TRANSFER[name]["all"] | TRANSFER[name][label]
    expected["family"] = "gaussian" if label == "GVT" else "mixture"
    expected["components"] = 3 if label == "3-MGVT" else 1
    assert with_values(settings, expected) == expected


@pytest.mark.parametrize("name", PROTOCOLS)
@pytest.mark.parametrize("label", ["GVT", "1-MGVT", "3-MGVT"])
def test_the_published_settings_differ_by_what_is_known(name: str, label: str) -> None:
    published, text = (attrs.asdict(e.algorithms[label]) for e in PROTOCOLS[name])
    changed = {key: value for key, value in published.items() if value != text[key]}
    here = {"rooms": PUBLISHED_IN_ROOMS, "mazes": PUBLISHED_IN_MAZES}.get(name, {})
    assert changed == PUBLISHED[label] | here.get(label, {})


@pytest.mark.parametrize(("name", "label"), LEARNERS)
def test_learners_have_the_numbers_of_the_thesis(name: str, label: str) -> None:
    method, expected, share = LEARNERS[name, label]
    experiment = ENVIRONMENTS[name]
    pool = experiment.pool
    learner, iterations = experiment.algorithms.get(label, pool.settings), experiment.iterations
    if label == "sources":
        iterations = pool.iterations
    assert type(learner) is method
    assert with_values(learner, expected) == expected
    assert learner.gamma == 0.99
    if share is not None:
        assert learner.epsilon_steps / iterations == pytest.approx(share)


def test_the_rooms_without_transfer_are_the_sources_settings() -> None:
    for experiment in ROOMS_EVALUATION:
        assert experiment.algorithms["NT"] == experiment.pool.settings
        assert experiment.iterations == experiment.pool.iterations


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_runs_and_pools_are_those_of_the_thesis(name: str) -> None:
    experiment = ENVIRONMENTS[name]
    assert experiment.family.q().d == WEIGHTS[name]
    assert experiment.pool.count == POOLS[name]
    expected = (20, 5 if name == "mazes" else 10, ITERATIONS[name])
    assert (experiment.runs, experiment.sources, experiment.iterations) == expected


@pytest.mark.parametrize(
    "other", [ROOMS_CHANGE, ROOMS_EXPLORATION, ROOMS_LIKELIHOOD, ROOMS_SOURCES]
)
def test_one_table_speaks_for_every_rooms_experiment(other: Protocols) -> None:
    for first, experiment in zip(ROOMS_EVALUATION, other, strict=True):
        known = {evolve(first.algorithms[x], components=1) for x in ("GVT", "1-MGVT")}
        settings = [x for x in experiment.algorithms.values() if isinstance(x, Settings)]
        assert {evolve(one, components=1) for one in settings} == known
        assert experiment.pool.settings == first.pool.settings


def test_the_page_leaves_no_parameter_out(cells_of: Callable[[str], dict[str, Any]]) -> None:
    page = cells_of("parameters")
    fields = [attrs.fields_dict(x) for x in (Settings, MellowTDSettings, DDQNSettings, Pool)]
    # a pool's tasks are in the text, and where its sources start is measured elsewhere
    elsewhere = {"family", "name", "as_targets", "stream"}
    assert {name for each in fields for name in each} - elsewhere <= set(page["MEANING"])
    for environment, group, *_ in (key.split() for key in page["OTHERWISE"]):
        assert environment in {"rooms", "cartpole", "mountain-car", "mazes"}
        assert group in {"transfer", "sources", "NT", "DDQN"}
