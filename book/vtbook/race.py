"""Two recorded runs in the same rooms, side by side, for a page to play."""

from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve

from vtbook import visits
from vtbook.browser_panel import panel
from vtbook.plots import COLOURS
from vtlab.envs.rooms.tasks import DOOR_WIDTH, GOAL_RADIUS, SIDE, Rooms
from vtlab.experiment import Experiment
from vtlab.run import run_batch, targets
from vtlab.store import weights

STEPS = 255  # places are told in so many steps along each side of the square


def paths(experiment: Experiment, labels: Sequence[str], iterations: int, run: int) -> np.ndarray:
    """Positions (A, T, 2) of one run of some algorithms, made again from the stored seeds."""
    again = evolve(experiment, iterations=iterations, every=iterations, visits=True)
    sources = weights(experiment.pool)
    made = [run_batch(again, label, [run], sources)["visited"] for label in labels]
    return np.concatenate(made)


def race(experiment: Experiment, shown: dict[str, str], iterations: int, run: int = 0) -> str:
    """HTML of a run of each algorithm in the same rooms, to play, pause and scrub.

    shown: what the page calls each algorithm, by its label. Where a reader wants no motion the
    picture stands still at its end.
    """
    visited = paths(experiment, list(shown), iterations, run)
    tasks = targets(experiment, [run])
    assert isinstance(tasks, Rooms)
    runs = [_run(label, path) for label, path in zip(shown, visited, strict=True)]
    setup = {
        "side": SIDE,
        "goal": GOAL_RADIUS,
        "gap": DOOR_WIDTH,
        "walls": np.round(tasks.walls.tolist(), 4).tolist(),
        "doors": np.round(tasks.doors[0].tolist(), 4).tolist(),
        "iterations": iterations,
        "runs": runs,
    }
    counts = zip(shown.values(), runs, strict=True)
    return panel(
        "race",
        setup,
        ("player.js",),
        ("player.css",),
        iterations=iterations,
        shown=f"{iterations:,}",
        squares="".join(
            f'<figure><figcaption>{name}</figcaption><canvas width="360" height="360" '
            f'aria-hidden="true"></canvas><p class="count"></p></figure>'
            for name in shown.values()
        ),
        alt="; ".join(f"{name}: {len(run['reached'])} times" for name, run in counts),
    )


def _run(label: str, path: np.ndarray) -> dict[str, Any]:
    places = np.round(path / SIDE * STEPS).clip(0, STEPS).astype(np.uint8)
    return {
        "colour": COLOURS[label],
        "places": b64encode(places.tobytes()).decode(),
        "reached": (np.flatnonzero(visits.at_goal(path)) + 1).tolist(),
    }
