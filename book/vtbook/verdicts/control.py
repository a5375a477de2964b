"""The claims of section 6.2, of the classic tasks."""

from vtbook.claims import EARLY, MIXTURES, OPTIMAL, TRANSFER, Claim, Figure, Runs
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_OTHER_SOURCES
from vtbook.experiments.mountain_car import CAR
from vtbook.zero_shot import zero_shot
from vtlab.stats import mean_interval
from vtlab.store import weights

START = 600  # iterations of mountain car: every run has ended an episode
AGAINST = ("DDQN",)


def cartpole() -> list[Claim]:
    """Section 6.2.1, Figure 6.8."""
    figure, end = Figure(CARTPOLE, "cartpole"), 8_900
    of_mean = zero_shot(CARTPOLE, weights(CARTPOLE.pool), 50, of_mean=True)
    of_ddqn = Runs.of(CARTPOLE_OTHER_SOURCES["ddqn-common"], "1-MGVT")
    return [
        *figure.earns("{} starts near the optimum.", TRANSFER, EARLY, low=OPTIMAL),
        figure.leads("1-MGVT starts ahead of DDQN.", "1-MGVT", "DDQN", EARLY, low=0.0),
        Claim(
            "The mean of the prior is near the optimum.",
            "greedy return of the sources' mean before learning, of the optimum",
            mean_interval(of_mean / figure.runs["GVT"].scale),
            figure.printed["GVT"].share(0, "greedy"),
            low=OPTIMAL,
        ),
        *figure.earns("{} converges quickly.", TRANSFER, 2_000, low=OPTIMAL),
        *figure.ahead(
            "Averaged over the run, {} is not behind {}: no negative transfer.",
            TRANSFER,
            AGAINST,
            end,
            low=0.0,
        ),
        Claim(
            "The algorithm that solved the sources does not hinder transfer.",
            "1-MGVT from sources of DDQN minus 1-MGVT from those of this page, learning return at "
            "1,000, of the optimum",
            of_ddqn.gain(figure.runs["1-MGVT"], 1_000),
            None,
            low=0.0,
        ),
        *figure.earns("{} keeps what it has.", TRANSFER, end, low=OPTIMAL, ours=True),
    ]


def mountain_car() -> list[Claim]:
    """Section 6.2.2, Figure 6.10; shares are of the way from never arriving to the optimum."""
    figure, end = Figure(CAR, "mountain-car"), 39_600
    level = "GVT is level with DDQN: it has no significant advantage."
    negative = "Nor is there negative transfer by {}."
    return [
        *figure.ahead(level, ("GVT",), AGAINST, end, low=0.0, high=0.0),
        *figure.ahead("{} learns faster than {}.", MIXTURES, ("GVT", "DDQN"), end, low=0.0),
        *figure.earns("{} converges to the optimum.", MIXTURES, end, low=OPTIMAL),
        *figure.earns("The jump-start of {} is not great.", MIXTURES, START, high=0.6),
        # The number that decides the first claim decides this one, too, so both count as one fact.
        *figure.ahead(negative, ("GVT",), AGAINST, end, low=0.0, fact=level),
    ]
