"""The cartpole experiments (section 6.2.1) with the parameters of appendix A.2.1."""

from __future__ import annotations

from typing import Any

from attrs import evolve

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.experiments.experiment import Algorithm, Experiment, Pool, sliders_of
from vtlib.experiments.protocols import FINE_TUNED, FINE_TUNED_GREEDY, FROM_MEAN
from vtlib.experiments.protocols import Protocols, as_published
from vtlib.transfer import Settings

ITERATIONS = 10_000
DDQN = DDQNSettings(epsilon_steps=int(0.35 * ITERATIONS), minibatch=150)
DDQN_GREEDY = evolve(DDQN, epsilon_start=DDQN.epsilon_end)
GVT = Settings(family="gaussian", lambda_=1e-3, minibatch=500, n_samples=5, alpha_L=1e-4)
MGVT = evolve(GVT, family="mixture")
# What the published code runs with when it is started without arguments.
LAUNCH_DEFAULTS: dict[str, Any] = {"lambda_": 1e-5, "n_samples": 10}
FINE_TUNING: dict[str, Algorithm] = {
    FINE_TUNED: FineTuning(DDQN),
    FINE_TUNED_GREEDY: FineTuning(DDQN_GREEDY),
    FROM_MEAN: FineTuning(DDQN_GREEDY, "mean"),
}


def _transfer(gaussian: Settings, mixture: Settings) -> dict[str, Algorithm]:
    return {"3-MGVT": evolve(mixture, components=3), "GVT": gaussian, "1-MGVT": mixture}


CARTPOLES = Pool(
    "cartpole-sources",
    CartpoleFamily(),
    count=100,
    iterations=10_000,
    episodes=200,
    required=0.95,
    # section 6.2.1 refers to section 5.1.4: sources by mellow TD, its exploration as in the rooms
    settings=MellowTDSettings(epsilon_steps=7_000, minibatch=150),
)
_PUBLISHED = Experiment(
    name="cartpole",
    pool=CARTPOLES,
    family=CARTPOLES.family,
    algorithms={
        **_transfer(as_published(GVT), as_published(MGVT)),
        "DDQN": DDQN,
        **FINE_TUNING,
    },
    iterations=ITERATIONS,
    each=True,
)
CARTPOLE = Protocols(
    _PUBLISHED,
    evolve(
        _PUBLISHED,
        name="cartpole-equations",
        algorithms={**_transfer(GVT, MGVT), "DDQN": DDQN},
        each=False,
    ),
)

EXPERIMENTS = (*CARTPOLE,)
