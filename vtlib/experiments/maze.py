"""The maze experiments (section 6.3) with the parameters of appendix A.2.3."""

from __future__ import annotations

from attrs import evolve

from vtlib.baselines import DDQNSettings
from vtlib.envs.maze import MazeFamily
from vtlib.experiments.experiment import Algorithm, Experiment, Pool, sliders_of
from vtlib.transfer import Settings

MAZE_ITERATIONS = 20_000
SOURCE_LIMIT = 400_000
MAZE_DDQN = DDQNSettings(
    epsilon_steps=MAZE_ITERATIONS // 10, minibatch=70, buffer=10_000, target_every=100
)
MAZE_GVT = Settings(family="gaussian", lambda_=1e-6, buffer=50_000, alpha_L=1e-7)
MAZE_MGVT = evolve(MAZE_GVT, family="mixture", alpha_L=1e-6)

FAMILY = MazeFamily()
MAZES = Pool(
    "maze-solved-sources",
    FAMILY,
    count=20,
    iterations=200_000,
    limit=SOURCE_LIMIT,
    check_every=500,
    attempts=10,
    settings=evolve(MAZE_DDQN, epsilon_steps=SOURCE_LIMIT // 10),
)
DIAGONAL = "1-MGVT-diagonal"
CORNERS = ("north-east", "north-west", "south-east", "south-west")
ALGORITHMS: dict[str, Algorithm] = {
    "3-MGVT": evolve(MAZE_MGVT, components=3),
    "GVT": MAZE_GVT,
    "1-MGVT": MAZE_MGVT,
    DIAGONAL: evolve(MAZE_MGVT, covariance="diagonal"),
    "DDQN": MAZE_DDQN,
}


def _target(corner: str) -> Experiment:
    """Transfer to the middle one of a corner's five mazes, from mazes of the other corners."""
    return Experiment(
        name=f"maze-{corner}-3",
        pool=MAZES,
        family=MazeFamily((f"{corner} 3",)),
        algorithms=ALGORITHMS,
        sources=5,
        iterations=MAZE_ITERATIONS,
        every=200,
        excluded=tuple(i for i, name in enumerate(FAMILY.names) if name.startswith(corner)),
    )


MAZE_TARGETS = {corner: _target(corner) for corner in CORNERS}
MAZE_LAMBDAS, MAZE_PSIS, MAZE_COMPONENTS = (1e-8, 1e-6, 1e-4), (0.0, 0.5), (1, 3)
MAZE_SLIDERS = sliders_of(
    MAZE_TARGETS[CORNERS[0]],
    "maze-north-east-3-sliders",
    5,
    5_000,
    MAZE_LAMBDAS,
    MAZE_PSIS,
    MAZE_COMPONENTS,
)

EXPERIMENTS = (*MAZE_TARGETS.values(), MAZE_SLIDERS)
