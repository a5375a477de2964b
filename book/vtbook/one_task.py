"""A panel's setting for the engines: many runs of one task, with the reader's numbers."""

from collections.abc import Sequence
from typing import Any

import attrs
import torch
from attrs import evolve
from torch import Tensor

from vtbook.stages import beside, learners
from vtlab.envs.base import TaskFamily
from vtlab.experiment import Experiment
from vtlab.registry import named
from vtlib.transfer import Settings
from vtlib.trust import Trust

# What a reader copies from a panel; a name after a dollar stands for what the panel has.
CELL = """\
import matplotlib.pyplot as plt

from vtbook.one_task import one_task
from vtlab.run import run_batch
from vtlab.store import weights

here = one_task(
    "$experiment",
    [$task],
    "$family",
    lambda_=$lambda,
    psi=$psi,
    components=$components,
    sources=$sources,
    iterations=$iterations,
    seed=$seed,
)
for label in here.algorithms:
    runs = run_batch(here, label, range(10), weights(here.pool))
    plt.plot(runs["iterations"], runs["learning"].mean(0), label=label)
plt.legend();
"""


def one_task(
    name: str,
    task: Sequence[float],
    family: str,
    *,
    sources: int,
    iterations: int,
    seed: int,
    **changes: Any,
) -> Experiment:
    """An experiment whose runs all learn one task, with the algorithms of a page's panel.

    name: the experiment whose sources and settings these are. task: the doors (W,) of rooms, else
    the numbers that tell a task of the family apart. family: "GVT", "MGVT" or "Trust"; changes are
    fields of its settings. The seed decides its sources and random numbers.
    """
    (base,) = named(name)
    settings = learners(base)[family]
    assert isinstance(settings, Settings | Trust)
    chosen = evolve(settings, **changes)
    label = f"{chosen.components}-MGVT" if family == "MGVT" else family
    return evolve(
        base,
        name=f"{name}-one-task",
        stream=f"{name}, seed {seed}",
        family=always(base.family, task),
        algorithms={label: chosen, **beside(base)},
        runs_per_task=1,
        counts={},
        sources=sources,
        iterations=iterations,
        every=iterations // 50,
        visits=False,
        probes=0,
        probe=None,
    )


def always(family: TaskFamily, task: Sequence[float]) -> TaskFamily:
    """A family that draws the same task whenever it is asked."""

    class OneTask(type(family)):  # type: ignore[misc]
        kernel = family.kernel  # the engines ask for a class's own

        def draw_tasks(self, stream: str, runs: Sequence[int]) -> Any:
            return with_task(family.draw_tasks(stream, runs), task)

    return OneTask(**attrs.asdict(family, recurse=False))


def with_task(tasks: Any, task: Sequence[float]) -> Any:
    """A batch of tasks in which each row is the given task."""
    rows = torch.tensor(task).float().expand(len(tasks), -1)
    if getattr(tasks, tasks.parameters[0]).ndim == 2:  # the doors of rooms
        return evolve(tasks, **{tasks.parameters[0]: rows})
    return evolve(tasks, **dict(zip(tasks.parameters, rows.T.contiguous(), strict=True)))


def optimum(family: TaskFamily, task: Sequence[float]) -> float:
    """Best mean discounted return that an episode of a task can earn."""
    best: Tensor = family.optimum(with_task(family.draw_tasks("optimum", [0]), task))
    return float(best[0])
