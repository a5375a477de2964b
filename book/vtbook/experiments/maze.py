"""The maze experiments (section 6.3) with the parameters of appendix A.2.3."""

from attrs import evolve

from vtbook.experiments.protocols import as_published, fine_tuning, transfer
from vtbook.maze_walks import STARTS, WalksProbe
from vtbook.neighbours import GuidedSettings
from vtlab.envs.maze import MazeFamily
from vtlab.experiment import Experiment, Pool
from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.transfer import Settings

ITERATIONS = 20_000
SOURCE_ITERATIONS = 200_000
DDQN = DDQNSettings(epsilon_steps=ITERATIONS // 10, minibatch=70, buffer=10_000, target_every=100)
GVT = Settings(family="gaussian", lambda_=1e-6, buffer=50_000, alpha_L=1e-7)
MGVT = evolve(GVT, family="mixture", alpha_L=1e-6)
# In the mazes the published GVT, too, has the divergence of diag(L) alone.
PUBLISHED_GVT, PUBLISHED_MGVT = evolve(as_published(GVT), kl="diagonal"), as_published(MGVT)

FAMILY = MazeFamily()
MAZES = Pool(
    "maze-sources",
    FAMILY,
    count=20,
    iterations=SOURCE_ITERATIONS,
    limit=2 * SOURCE_ITERATIONS,
    check_every=5_000,
    attempts=2,
    settings=evolve(DDQN, epsilon_steps=SOURCE_ITERATIONS // 10),
)
MAIN = 8  # the paper's maze, the only one with 3-MGVT
TARGETS = (0, 6, MAIN, 13)


def _target(number: int) -> Experiment:
    """Transfer to a maze from mazes with their goal elsewhere."""
    name = FAMILY.names[number]
    corner = name.rstrip("0123456789")
    return Experiment(
        name=f"maze-{number}",
        pool=MAZES,
        family=MazeFamily((name,)),
        algorithms={
            **transfer(PUBLISHED_GVT, PUBLISHED_MGVT, (3,) if number == MAIN else ()),
            "DDQN": DDQN,
            **fine_tuning(DDQN),
        },
        sources=5,
        iterations=ITERATIONS,
        every=200,
        excluded=tuple(i for i, x in enumerate(FAMILY.names) if x.startswith(corner)),
        each=True,
    )


MAZE_TARGETS = {number: _target(number) for number in TARGETS}
# The mixtures' learner without any source: what their lead over DDQN owes to transfer. Guided by
# what the sources do it owes them exploration, but no weights.
NT = MellowTDSettings(epsilon_steps=ITERATIONS // 10)
MAZE_NOTHING = {
    number: evolve(
        target,
        name="maze-no-transfer" if number == MAIN else f"maze-{number}-no-transfer",
        algorithms={"NT": NT, "NT, guided": GuidedSettings(NT)},
    )
    for number, target in MAZE_TARGETS.items()
}


def _walks(published: Experiment) -> Experiment:
    """The first runs once more, to show where their robots go."""
    known = {**published.algorithms, "NT": NT}
    return evolve(
        published,
        name=f"{published.name}-walks",
        algorithms={x: known[x] for x in WALKED if x in known},
        runs=1,
        every=ITERATIONS // 10,
        probes=STARTS,
        probe=WalksProbe,
    )


WALKED = ("NT", "DDQN", "GVT", "1-MGVT", "3-MGVT")
MAZE_WALKS = {n: _walks(MAZE_TARGETS[n]) for n in (MAIN, 13)}
