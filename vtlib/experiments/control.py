"""The classic control experiments (section 6.2) with the parameters of appendix A.2."""

from __future__ import annotations

from dataclasses import replace

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.envs.mountain_car import MountainCarFamily
from vtlib.experiments.experiment import ITERATIONS, Experiment
from vtlib.sources import NetworkPool
from vtlib.transfer import Settings

CARTPOLE_DDQN = DDQNSettings(epsilon_steps=int(0.35 * ITERATIONS), batch=150)
CARTPOLE_GVT = Settings(family="gaussian", lambda_=1e-3, batch=500, weights=5, alpha_L=1e-4)
CARTPOLE_MGVT = replace(CARTPOLE_GVT, family="mixture")

CARTPOLES = NetworkPool(
    "cartpole-sources",
    CartpoleFamily(),
    count=100,
    iterations=10_000,
    episodes=100,
    required=0.95,
    # section 6.2.1 refers to section 5.1.4: sources by mellow TD, its exploration as in the rooms
    settings=MellowTDSettings(epsilon_steps=7_000, batch=150),
)
CARTPOLE = Experiment(
    name="cartpole",
    pool=CARTPOLES,
    family=CartpoleFamily(),
    algorithms={
        "3-MGVT": replace(CARTPOLE_MGVT, components=3),
        "GVT": CARTPOLE_GVT,
        "1-MGVT": CARTPOLE_MGVT,
        "DDQN": CARTPOLE_DDQN,
    },
)

CAR_SOURCE_ITERATIONS = 50_000
CARS = NetworkPool(
    "mountain-car-sources",
    MountainCarFamily(),
    count=50,
    iterations=CAR_SOURCE_ITERATIONS,
    limit=500_000,
    check_every=2_000,
    episodes=100,
    settings=DDQNSettings(epsilon_steps=int(0.15 * CAR_SOURCE_ITERATIONS), batch=32),
)
CAR_GVT = Settings(family="gaussian", lambda_=1e-5, batch=500, alpha_L=1e-4)
CAR_MGVT = replace(CAR_GVT, family="mixture")
CAR = Experiment(
    name="mountain-car",
    pool=CARS,
    family=MountainCarFamily(),
    algorithms={
        "3-MGVT": replace(CAR_MGVT, components=3),
        "GVT": CAR_GVT,
        "1-MGVT": CAR_MGVT,
        "DDQN": DDQNSettings(epsilon_steps=int(0.15 * ITERATIONS), batch=32),
    },
)
