"""The mountain car experiments (section 6.2.2) with the parameters of appendix A.2.2."""

from __future__ import annotations

from attrs import evolve

from vtlib.baselines import DDQNSettings
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.experiments.experiment import ITERATIONS, Experiment, Pool, slider_lambdas, sliders_of
from vtlib.transfer import Settings

CAR_SOURCE_ITERATIONS = 50_000
CARS = Pool(
    "mountain-car-sources",
    MountainCarFamily(),
    count=50,
    iterations=CAR_SOURCE_ITERATIONS,
    limit=500_000,
    check_every=2_000,
    episodes=100,
    settings=DDQNSettings(epsilon_steps=int(0.15 * CAR_SOURCE_ITERATIONS), minibatch=32),
)
CAR_GVT = Settings(family="gaussian", lambda_=1e-5, minibatch=500, alpha_L=1e-4)
CAR_MGVT = evolve(CAR_GVT, family="mixture")
CAR = Experiment(
    name="mountain-car",
    pool=CARS,
    family=MountainCarFamily(),
    algorithms={
        "3-MGVT": evolve(CAR_MGVT, components=3),
        "GVT": CAR_GVT,
        "1-MGVT": CAR_MGVT,
        "DDQN": DDQNSettings(epsilon_steps=int(0.15 * ITERATIONS), minibatch=32),
    },
)
CAR_LAMBDAS = slider_lambdas(CAR_MGVT)[::2]  # fewer than elsewhere: these are the longest runs
CAR_SLIDERS = sliders_of(CAR, "mountain-car-sliders", 10, 2_000, CAR_LAMBDAS)

EXPERIMENTS = (CAR, CAR_SLIDERS)
