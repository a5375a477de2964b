"""Six robots in a maze while agents learn there: a probe that records them, a panel that plays."""

import zlib
from base64 import b64encode
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from vtbook.browser_panel import panel
from vtbook.paths import walks
from vtbook.plots import COLOURS
from vtbook.probes import Probe
from vtlab.envs.maze import Mazes
from vtlab.experiment import Experiment
from vtlab.run import chosen_sources, targets
from vtlib.rng import generator
from vtlib.training import Agent
from vtlib.transfer import VariationalTransfer

PER_METRE = 25  # places are told in so many steps of each metre, headings in 256 of a turn
STATES = Mazes.horizon + 1
STARTS = 6
Policy = Callable[[Tensor], Tensor]  # actions (B,) at states (B, 3)


def maze_of(experiment: Experiment) -> Mazes:
    """The maze of the first run."""
    tasks = targets(experiment, [0])
    assert isinstance(tasks, Mazes)
    return tasks


def six_walks(experiment: Experiment, policy: Policy) -> list[np.ndarray]:
    """States (T, 3) of six walks; starts and noise are the same for every policy."""
    rng = generator(experiment.stream, 0, "walks")
    copies = maze_of(experiment).select([0] * STARTS)
    start = copies.start(torch.from_numpy(rng.random((STARTS, Mazes.start_dim))))
    noise = rng.standard_normal((Mazes.horizon, STARTS, Mazes.noise_dim))
    return walks(copies, policy, start, torch.from_numpy(noise))


class WalksProbe(Probe):
    """At each look six walks of the greedy policy, and six of draws from a posterior.

    The ``arrays`` are "walks" (R, T, 1 or 2, 6, 101, 3) uint8: x, y and heading along each walk,
    whose last state is repeated. Robots share a mixture's components evenly.
    """

    def _note(self, agent: Agent) -> dict[str, Tensor]:
        mu = agent.mu.detach()
        components, robots = mu.shape[1], torch.arange(STARTS)
        drivers = [mu[:, robots % components]]
        if isinstance(agent, VariationalTransfer):
            drawn = self._samples(agent, STARTS)
            drivers.append(drawn[:, robots % components * STARTS + robots])
        modes = torch.stack(drivers, 1)
        walks = [[driven(self._experiment, w) for w in each] for each in modes]
        return {"walks": torch.from_numpy(np.array(walks))}


def driven(experiment: Experiment, weights: Tensor) -> np.ndarray:
    """Six walks (6, 101, 3) uint8 in the first run's maze, greedy in weights (6, d), one each.

    All walks in that maze have the same starts and noise.
    """
    q, maze = experiment.family.q(), maze_of(experiment).select([0] * STARTS)

    def policy(states: Tensor) -> Tensor:
        values = q.q(weights.unsqueeze(0), q.prepare(maze.observe(states).unsqueeze(0)))[0]
        return values.diagonal(dim1=0, dim2=2).argmax(0)  # of each robot its own weights' values

    walks = six_walks(experiment, policy)
    whole = np.stack([np.pad(w, ((0, STATES - len(w)), (0, 0)), "edge") for w in walks])
    # cut, not rounded: a robot is shown in the cell that it is in
    whole[..., 2] *= 256 / (2 * np.pi) / PER_METRE
    return (whole * PER_METRE).astype(int).astype(np.uint8)


def by_sources(experiment: Experiment, weights: np.ndarray) -> np.ndarray:
    """Six walks, as ``driven``, of the first run's sources in turn; weights (S, d) of a pool."""
    chosen = weights[chosen_sources(experiment, [0])[0]]
    return driven(experiment, torch.from_numpy(chosen[np.arange(STARTS) % len(chosen)]))


def walks_panel(
    experiments: Mapping[str, Experiment],
    walks: Mapping[str, Mapping[str, np.ndarray]],
    shown: Mapping[str, str],
) -> str:
    """HTML of the robots of some algorithms in some mazes, to play, pause and scrub.

    experiments, walks: by a maze's title, the latter by label, of the first run (T, 1 or 2, 6, 101,
    3). shown: what the page calls each algorithm, by its label. Where a reader wants no motion the
    picture stands still at its end.
    """
    first = next(iter(experiments.values()))
    last = first.iterations // first.every * STATES - 1
    setup = {
        "robots": STARTS,
        "states": STATES,
        "perMetre": PER_METRE,
        "every": first.every,
        "last": last,
        "mazes": [_maze(e, walks[title], shown) for title, e in experiments.items()],
    }
    squares = "".join(
        f'<figure><figcaption>{name}</figcaption><canvas width="300" height="300" '
        f'aria-hidden="true"></canvas><p class="count"></p></figure>'
        for name in shown.values()
    )
    titles = "".join(f'<option value="{i}">{title}</option>' for i, title in enumerate(experiments))
    styles = "player.css", "walks.css"
    return panel("walks", setup, ("player.js",), styles, squares=squares, titles=titles, last=last)


def _maze(
    experiment: Experiment, walks: Mapping[str, np.ndarray], shown: Mapping[str, str]
) -> dict[str, Any]:
    maze = maze_of(experiment)
    return {
        "walls": np.argwhere(maze.walls[0].numpy()).tolist(),
        "goal": maze.goal[0].tolist(),
        "runs": [_run(label, walks[label]) if label in walks else None for label in shown],
    }


def _run(label: str, walks: np.ndarray) -> dict[str, Any]:
    # from state to state little changes, which packs well
    changes = np.diff(walks, axis=-2, prepend=np.uint8(0))
    packed = zlib.compress(changes.tobytes(), 9)
    return {
        "colour": COLOURS.get(label, "#666666"),
        "moments": len(walks),
        "modes": walks.shape[1],
        "walks": b64encode(packed).decode(),
    }
