"""The configurations have the numbers of the thesis' appendix A, and its page names them all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
import pytest
from attrs import evolve

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import EXPERIMENTS
from vtlib.experiments.cartpole import CARTPOLE
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.experiments.maze import MAZE_TARGETS
from vtlib.experiments.mountain_car import CAR
from vtlib.experiments.rooms import ROOMS_DEVIATIONS, ROOMS_EVALUATION
from vtlib.transfer import Settings

ENVIRONMENTS = {
    "rooms": ROOMS_EVALUATION,
    "cartpole": CARTPOLE,
    "mountain car": CAR,
    "mazes": MAZE_TARGETS["north-east"],
}
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


@pytest.mark.parametrize(("name", "label"), LEARNERS)
def test_learners_have_the_numbers_of_the_thesis(name: str, label: str) -> None:
    method, expected, share = LEARNERS[name, label]
    experiment = ENVIRONMENTS[name]
    pool = experiment.pool
    learner, iterations = experiment.algorithms.get(label, pool.settings), experiment.iterations
    if label == "sources":
        iterations = pool.limit if pool.attempts > 1 else pool.iterations
    assert type(learner) is method
    assert with_values(learner, expected) == expected
    assert learner.gamma == 0.99
    if share is not None:
        assert learner.epsilon_steps / iterations == pytest.approx(share)


def test_the_rooms_without_transfer_are_the_sources_settings() -> None:
    sources, nt = ROOMS_EVALUATION.pool.settings, ROOMS_EVALUATION.algorithms["NT"]
    assert evolve(nt, epsilon_steps=sources.epsilon_steps) == sources
    shares = nt.epsilon_steps / ROOMS_EVALUATION.iterations, sources.epsilon_steps / 20_000
    assert shares[0] == shares[1]


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_runs_and_pools_are_those_of_the_thesis(name: str) -> None:
    experiment = ENVIRONMENTS[name]
    sources, iterations = (5, 20_000) if name == "mazes" else (10, 10_000)
    assert experiment.family.q().d == WEIGHTS[name]
    assert experiment.pool.count == POOLS[name]
    expected = (20, sources, iterations)
    assert (experiment.runs, experiment.sources, experiment.iterations) == expected


def of_rooms(experiment: Experiment) -> bool:
    """Whether an experiment is one of those that the table of the rooms speaks for."""
    other = experiment is ROOMS_DEVIATIONS or "sliders" in experiment.name
    return isinstance(experiment.family, RoomsFamily) and not other


@pytest.mark.parametrize("name", [name for name, e in EXPERIMENTS.items() if of_rooms(e)])
def test_one_table_speaks_for_every_rooms_experiment(name: str) -> None:
    known = {evolve(ROOMS_EVALUATION.algorithms[x], components=1) for x in ("GVT", "1-MGVT")}
    for label, algorithm in EXPERIMENTS[name].algorithms.items():
        if isinstance(algorithm, Settings):
            assert evolve(algorithm, components=1, init="sources") in known, label
    assert EXPERIMENTS[name].pool.settings == ROOMS_EVALUATION.pool.settings


def test_the_page_leaves_no_parameter_out(cells_of: Callable[[str], dict[str, Any]]) -> None:
    page = cells_of("parameters")
    fields = [attrs.fields_dict(x) for x in (Settings, MellowTDSettings, DDQNSettings, Pool)]
    # a pool's tasks are in the text, and where its sources start is measured elsewhere
    elsewhere = {"family", "name", "as_targets", "stream"}
    assert {name for each in fields for name in each} - elsewhere <= set(page["MEANING"])
    for environment, group, *_ in (key.split() for key in page["OTHERWISE"]):
        assert environment in {"rooms", "cartpole", "mountain-car", "mazes"}
        assert group in {"transfer", "sources", "NT", "DDQN"}
