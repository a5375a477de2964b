"""The cartpole experiments (section 6.2.1) with the parameters of appendix A.2.1."""

from __future__ import annotations

from typing import Any

from attrs import evolve

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.cartpole import CartpoleFamily
from vtlib.experiments.experiment import ITERATIONS, Experiment, Pool, sliders_of
from vtlib.transfer import Settings

CARTPOLE_DDQN = DDQNSettings(epsilon_steps=int(0.35 * ITERATIONS), minibatch=150)
CARTPOLE_GVT = Settings(family="gaussian", lambda_=1e-3, minibatch=500, n_samples=5, alpha_L=1e-4)
CARTPOLE_MGVT = evolve(CARTPOLE_GVT, family="mixture")

CARTPOLES = Pool(
    "cartpole-sources",
    CartpoleFamily(),
    count=100,
    iterations=10_000,
    episodes=100,
    required=0.95,
    # section 6.2.1 refers to section 5.1.4: sources by mellow TD, its exploration as in the rooms
    settings=MellowTDSettings(epsilon_steps=7_000, minibatch=150),
)
CARTPOLE = Experiment(
    name="cartpole",
    pool=CARTPOLES,
    family=CartpoleFamily(),
    algorithms={
        "3-MGVT": evolve(CARTPOLE_MGVT, components=3),
        "GVT": CARTPOLE_GVT,
        "1-MGVT": CARTPOLE_MGVT,
        "DDQN": CARTPOLE_DDQN,
    },
)
CARTPOLE_SLIDERS = sliders_of(CARTPOLE, "cartpole-sliders", 10, 1_000)

# The same cartpoles solved otherwise: by another algorithm, or each from weights of its own.
SOURCES_DDQN = evolve(CARTPOLE_DDQN, epsilon_steps=int(0.35 * CARTPOLES.iterations))
OTHER_CARTPOLES = {
    "mellow-separate": evolve(CARTPOLES, common=False),
    "ddqn-common": evolve(CARTPOLES, settings=SOURCES_DDQN),
    # some of these never balance often enough; they count as they are
    "ddqn-separate": evolve(CARTPOLES, settings=SOURCES_DDQN, common=False, limit=20_000),
}
CARTPOLE_OTHER_SOURCES = {
    key: evolve(
        CARTPOLE,
        name=f"cartpole-{key}",
        pool=evolve(pool, name=f"cartpole-sources-{key}"),
        algorithms={"GVT": CARTPOLE_GVT, "1-MGVT": CARTPOLE_MGVT},
        iterations=2_000,
    )
    for key, pool in OTHER_CARTPOLES.items()
}

# What may be behind the collapse with DDQN's sources, one suspect at a time.
CARTPOLE_COLLAPSE = evolve(
    CARTPOLE_OTHER_SOURCES["ddqn-common"],
    name="cartpole-collapse",
    algorithms={
        "hard maximum": evolve(CARTPOLE_MGVT, kappa=1e4),
        "semi-gradient": evolve(CARTPOLE_MGVT, psi=0.0),
        "full gradient": evolve(CARTPOLE_MGVT, psi=1.0),
        "small steps": evolve(CARTPOLE_MGVT, alpha_mu=1e-4),
        "buffer filled first": evolve(CARTPOLE_MGVT, patience=500),
    },
)

# Why transfer falls late: as in the figure, and with what should spare it (vtlib.stability).
LATE_VARIANTS: dict[str, dict[str, Any]] = {
    "as in the thesis": {},
    "full gradient": {"psi": 1.0},
    "smaller steps on L": {"alpha_L": 1e-5},
    "more samples": {"n_samples": 10},
}
CARTPOLE_LATE = evolve(
    CARTPOLE,
    name="cartpole-late",
    algorithms={
        f"{label}, {name}": evolve(base, **changes)
        for name, changes in reversed(LATE_VARIANTS.items())
        for label, base in (("GVT", CARTPOLE_GVT), ("1-MGVT", CARTPOLE_MGVT))
    },
    runs=10,
    every=200,
    probes=500,
)
# What these runs suggested, put to the test on others.
CARTPOLE_LATE_AGAIN = evolve(
    CARTPOLE_LATE, name="cartpole-late-again", stream="cartpole-late-again"
)

EXPERIMENTS = (
    CARTPOLE,
    CARTPOLE_SLIDERS,
    *CARTPOLE_OTHER_SOURCES.values(),
    CARTPOLE_COLLAPSE,
    CARTPOLE_LATE,
    CARTPOLE_LATE_AGAIN,
)
