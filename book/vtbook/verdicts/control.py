"""The claims of section 6.2, of the classic tasks."""

from __future__ import annotations

import numpy as np

from vtbook.claims import EARLY, MIXTURES, OPTIMAL, TRANSFER, Claim, Figure
from vtbook.experiments.cartpole import CARTPOLE
from vtbook.experiments.mountain_car import CAR, FLOOR
from vtbook.stored import load
from vtbook.zero_shot import zero_shot
from vtlab.experiment import Pool
from vtlab.store import weights
from vtlib.rng import generator
from vtlib.stats import Interval, mean_interval

CONSTANT = 1e-3  # of a scale: returns that deviate less are the same for all tasks
START = 600  # iterations of mountain car: every run has ended an episode


def cartpole() -> list[Claim]:
    """Section 6.2.1, Figure 6.8."""
    figure, end = Figure(CARTPOLE._asdict(), "cartpole"), 8_900
    return [
        *(
            figure.claim(
                f"{x} starts near the optimum.",
                f"learning return at {EARLY}, of the optimum",
                lambda a: a.share(EARLY),
                x,
                low=OPTIMAL,
            )
            for x in TRANSFER
        ),
        figure.claim(
            "1-MGVT starts ahead of DDQN.",
            f"1-MGVT minus DDQN at {EARLY}, of the optimum",
            lambda a, b: a.gain(b, EARLY),
            "1-MGVT",
            "DDQN",
            low=0.0,
        ),
        Claim(
            "The mean of the prior is near the optimum.",
            "greedy return of the sources' mean before learning, of the optimum",
            {
                protocol: mean_interval(
                    zero_shot(e, weights(e.pool), 50, of_mean=True)
                    / figure.runs[protocol]["GVT"].scale
                )
                for protocol, e in CARTPOLE._asdict().items()
            },
            figure.printed["GVT"].share(0, "greedy"),
            low=OPTIMAL,
        ),
        *(
            figure.claim(
                f"{x} converges quickly.",
                "learning return at 2,000, of the optimum",
                lambda a: a.share(2_000),
                x,
                low=OPTIMAL,
            )
            for x in TRANSFER
        ),
        *(
            figure.ahead(
                f"Averaged over the run, {x} is not behind DDQN: no negative transfer.",
                x,
                "DDQN",
                end,
                low=0.0,
            )
            for x in TRANSFER
        ),
        *(
            figure.claim(
                f"{x} keeps what it has.",
                f"learning return at {end:,}, of the optimum",
                lambda a: a.share(end),
                x,
                low=OPTIMAL,
                ours=True,
            )
            for x in TRANSFER
        ),
    ]


def variation(pool: Pool, scale: float) -> Interval:
    """How far optimal returns of the sources' tasks deviate, of a scale; interval: bootstrap."""
    best = load(pool, "sources").optimum.values / scale
    rng = generator("claims", 0, "variation")
    drawn = rng.choice(best, (2_000, len(best))).std(1, ddof=1)
    return Interval(best.std(ddof=1), *np.quantile(drawn, [0.025, 0.975]))


def mountain_car() -> list[Claim]:
    """Section 6.2.2, Figure 6.10; shares are of the way from never arriving to the optimum."""
    figure, end = Figure(CAR._asdict(), "mountain-car", FLOOR), 39_600
    return [
        figure.ahead(
            "GVT has no significant advantage over DDQN.",
            "GVT",
            "DDQN",
            end,
            high=0.25,
        ),
        *(
            figure.ahead(
                f"{x} learns faster than {other}.",
                x,
                other,
                end,
                low=0.0,
            )
            for x in MIXTURES
            for other in ("GVT", "DDQN")
        ),
        *(
            figure.claim(
                f"{x} converges to the optimum.",
                f"learning return at {end:,}, of the way to the optimum",
                lambda a: a.share(end),
                x,
                low=OPTIMAL,
            )
            for x in MIXTURES
        ),
        *(
            figure.claim(
                f"The jump-start of {x} is not great.",
                f"learning return at {START}, of the way to the optimum",
                lambda a: a.share(START),
                x,
                high=0.6,
            )
            for x in MIXTURES
        ),
        figure.claim(
            "1-MGVT starts ahead of DDQN.",
            f"1-MGVT minus DDQN at {START}, of the way to the optimum",
            lambda a, b: a.gain(b, START),
            "1-MGVT",
            "DDQN",
            low=0.0,
        ),
        figure.ahead(
            "Nor is there negative transfer by GVT.",
            "GVT",
            "DDQN",
            end,
            low=0.0,
        ),
        Claim(
            "Optimal values vary more from task to task than on cartpole.",
            "deviation of the optimal return over the sources' tasks, of the way to it; "
            "cartpole's is 0",
            {
                protocol: variation(experiment.pool, figure.runs[protocol]["GVT"].scale)
                for protocol, experiment in CAR._asdict().items()
            },
            None,
            low=CONSTANT,
        ),
    ]
