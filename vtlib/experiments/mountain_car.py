"""The mountain car experiment (section 6.2.2), as published, by appendix A.2.2."""

from __future__ import annotations

from attrs import evolve

from vtlib.baselines import DDQNSettings, FineTuning
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.experiments.experiment import Algorithm, Experiment, Pool
from vtlib.experiments.protocols import (
    FINE_TUNED,
    FINE_TUNED_GREEDY,
    FROM_MEAN,
    as_published,
)
from vtlib.transfer import Settings

ITERATIONS, SOURCE_ITERATIONS = 40_000, 50_000
FLOOR = -(1 - 0.99**200) / (1 - 0.99)  # the return of an episode that never arrives
CARS = Pool(
    "mountain-car-sources",
    MountainCarFamily(last_reward=-1.0),
    count=50,
    iterations=SOURCE_ITERATIONS,
    limit=300_000,
    check_every=10_000,
    episodes=200,
    settings=DDQNSettings(epsilon_steps=int(0.15 * SOURCE_ITERATIONS), minibatch=32),
)
GVT = Settings(family="gaussian", lambda_=1e-5, minibatch=500, alpha_L=1e-4)
MGVT = evolve(GVT, family="mixture")
PUBLISHED_GVT, PUBLISHED_MGVT = as_published(GVT), as_published(MGVT)
DDQN = DDQNSettings(epsilon_steps=int(0.15 * ITERATIONS), minibatch=32)
DDQN_GREEDY = evolve(DDQN, epsilon_start=DDQN.epsilon_end)
FINE_TUNING: dict[str, Algorithm] = {
    FINE_TUNED: FineTuning(DDQN),
    FINE_TUNED_GREEDY: FineTuning(DDQN_GREEDY),
    FROM_MEAN: FineTuning(DDQN_GREEDY, "mean"),
}


# As published: the last step is paid like any other.
CAR = Experiment(
    name="mountain-car",
    pool=CARS,
    family=CARS.family,
    algorithms={
        "3-MGVT": evolve(PUBLISHED_MGVT, components=3),
        "GVT": PUBLISHED_GVT,
        "1-MGVT": PUBLISHED_MGVT,
        "DDQN": DDQN,
        **FINE_TUNING,
    },
    iterations=ITERATIONS,
    every=200,
    each=True,
)

EXPERIMENTS = (CAR,)
