"""The configurations have the numbers of the thesis' appendix A, and its page names them all."""

import attrs
import pytest
from attrs import evolve

from vtbook.experiments import cartpole, maze, mountain_car, rooms
from vtbook.experiments.protocols import transfer
from vtlib.baselines import DDQNSettings, MellowTDSettings

FILES = {"rooms": rooms, "cartpole": cartpole, "mountain car": mountain_car, "mazes": maze}
EXPERIMENTS = {
    "rooms": rooms.ROOMS_EVALUATION,
    "cartpole": cartpole.CARTPOLE,
    "mountain car": mountain_car.CAR,
    "mazes": maze.MAZE_TARGETS[maze.MAIN],
}
# Appendix A and chapter 6, entered by hand. Where the thesis says nothing, nothing is here.
EVERYWHERE = {"psi": 0.5, "gamma": 0.99, "alpha_mu": 1e-3, "sigma_min": 1e-4}
TRANSFER = {
    "rooms": {"lambda_": 1e-6, "minibatch": 50, "buffer": 10_000, "n_samples": 10, "alpha_L": 0.1},
    "cartpole": {"lambda_": 1e-3, "minibatch": 500, "n_samples": 5, "alpha_L": 1e-4},
    "mountain car": {"lambda_": 1e-5, "minibatch": 500, "n_samples": 10, "alpha_L": 1e-4},
    "mazes": {"lambda_": 1e-6, "minibatch": 50, "buffer": 50_000, "n_samples": 10, "alpha_L": 1e-6},
}
MIXTURE, GVT = {"sigma_p2": 1e-5}, {"rooms": {"lambda_": 1e-4}, "mazes": {"alpha_L": 1e-7}}
# Parameters of learners, and the share of the iterations over which epsilon falls.
ROOMS_TD = {"minibatch": 50, "buffer": 50_000, "psi": 0.5, "alpha": 1e-3, "epsilon_end": 0.02}
CARTPOLE_TD = {"minibatch": 150, "buffer": 50_000, "alpha": 1e-3}
DDQN_CAR = {"minibatch": 32, "buffer": 50_000, "target_every": 500, "alpha": 1e-3}
DDQN_MAZES = {"minibatch": 70, "buffer": 10_000, "target_every": 100, "alpha": 1e-3}
LEARNERS = {
    ("rooms", "sources"): (MellowTDSettings, ROOMS_TD, 0.7),
    ("rooms", "NT"): (MellowTDSettings, ROOMS_TD, 0.7),
    ("cartpole", "sources"): (MellowTDSettings, CARTPOLE_TD, None),
    ("cartpole", "DDQN"): (DDQNSettings, CARTPOLE_TD | {"target_every": 500}, 0.35),
    ("mountain car", "sources"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mountain car", "DDQN"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mazes", "sources"): (DDQNSettings, DDQN_MAZES, 0.1),
    ("mazes", "DDQN"): (DDQNSettings, DDQN_MAZES, 0.1),
}
# Weights, tasks in the pool, sources of each of 20 runs, and iterations. One hidden layer of 32
# units from 4 numbers to 2, and so on; 121 bases for each of 4 actions.
SIZES = {
    "rooms": (121 * 4, 50, 10, 20_000),
    "cartpole": (5 * 32 + 33 * 2, 100, 10, 10_000),
    "mountain car": (3 * 64 + 65 * 3, 50, 10, 40_000),
    "mazes": (23 * 32 + 33 * 32 + 33 * 3, 20, 5, 20_000),
}
# What the published code does otherwise, also entered by hand: everywhere, and in some places.
PUBLISHED = {"GVT": {"init": "span", "ddof": 1, "kl_clip": 100.0}}
PUBLISHED["MGVT"] = {"init": "mean", "responsibilities": "equal", "kl": "diagonal"}
PUBLISHED_THERE = {
    ("rooms", "GVT"): {"lambda_": 1e-3, "buffer": 50_000},
    ("rooms", "MGVT"): {"buffer": 50_000},
    ("mazes", "GVT"): {"kl": "diagonal"},
}


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("label", ["GVT", "1-MGVT", "3-MGVT"])
def test_transfer_has_the_numbers_of_the_thesis_and_of_the_published_code(name, label):
    published = EXPERIMENTS[name].algorithms[label]
    text = transfer(FILES[name].GVT, FILES[name].MGVT)[label]
    own = GVT.get(name, {}) if label == "GVT" else MIXTURE
    kind = ("gaussian", 1) if label == "GVT" else ("mixture", int(label[0]))
    assert (text.family, text.components) == kind
    expected = EVERYWHERE | TRANSFER[name] | own
    assert expected.items() <= attrs.asdict(text).items()
    method = label.split("-")[-1]
    otherwise = PUBLISHED[method] | PUBLISHED_THERE.get((name, method), {})
    assert all(getattr(text, x) != value for x, value in otherwise.items())
    assert published == evolve(text, **otherwise)


@pytest.mark.parametrize(("name", "label"), LEARNERS)
def test_learners_have_the_numbers_of_the_thesis(name, label):
    method, expected, share = LEARNERS[name, label]
    # its sources are those of the text
    experiment = cartpole.CARTPOLE_EQUATIONS if name == "cartpole" else EXPERIMENTS[name]
    owner = experiment.pool if label == "sources" else experiment
    learner = owner.settings if label == "sources" else experiment.algorithms[label]
    assert type(learner) is method
    assert (expected | {"gamma": 0.99}).items() <= attrs.asdict(learner).items()
    assert share is None or learner.epsilon_steps / owner.iterations == pytest.approx(share)


@pytest.mark.parametrize("name", SIZES)
def test_runs_and_pools_are_those_of_the_thesis(name):
    e = EXPERIMENTS[name]
    assert (e.family.q().d, e.pool.count, e.sources, e.iterations) == SIZES[name]
    assert e.runs == 20
