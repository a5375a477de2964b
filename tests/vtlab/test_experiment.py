"""Configurations: what is refused, by the name of its field, and what follows from the fields."""

import math
from types import SimpleNamespace

import attrs
import pytest
from attrs import evolve

from vtlab.envs.maze import MazeFamily
from vtlab.envs.rooms import RoomsFamily
from vtlab.experiment import Experiment, Pool
from vtlib.baselines import LearnerSettings, MellowTDSettings
from vtlib.transfer import Settings

NO_WHOLE = [0, -1, 1.0, True, "3", None, 10**10, math.nan]
NO_NAME = ["", " ", "..", "a/b", "a\nb", "\u2028", 3, None]
NO_KIND = [None, 3, "rooms", object]
BY_KIND = [
    ("name stream", NO_NAME),
    ("count limit check_every episodes attempts iterations", NO_WHOLE),
    ("common as_targets visits each greedy", [0, 1, "True", None]),
    ("family pool", NO_KIND),
]
NT = MellowTDSettings(epsilon_steps=100)
LOOSE = SimpleNamespace(transfers=False, agent=print)
BAD = {name: values for names, values in BY_KIND for name in names.split()} | {
    "required": [-0.1, 1.1, math.nan, "0.5", True, None],
    # settings without an agent, of no attrs class, and those of an algorithm that transfers
    "settings": [*NO_KIND, LearnerSettings(5), LOOSE, Settings()],
    "algorithms": [*NO_KIND, {}, {"NT": 3}, {"NT": LearnerSettings(5)}, {"": NT}, {"tasks": NT}],
    "runs": [*NO_WHOLE, 2],  # not divided by the runs of a task
    "sources": [*NO_WHOLE, 4, 2],  # more than are eligible; fewer than an algorithm uses
    "every": [*NO_WHOLE, 221],
    "runs_per_task": [*NO_WHOLE, 2, 6],
    "counts": [None, {"3-MGVT": 1}, {"NT": 0}, {"NT": 4}, {"NT": 1.0}],
    "excluded": [None, 1, [1], (3,), (-1,), (1.0,), (True,), (0,)],  # too few would be left
    "probes": [-1, 1.0, True, None, 5],  # 5 only where all transfer
    "probe": [print],  # without places to look at
}
# a field that joins a configuration has to join its checks, too
CASES = [
    (x, f.name, bad) for x in (Pool, Experiment) for f in attrs.fields(x) for bad in BAD[f.name]
]
OTHERS = [(Experiment, "family", RoomsFamily()), (Experiment, "iterations", 10)]
OTHERS += [(Pool, "iterations", 198)]


@pytest.mark.parametrize(("kind", "name", "value"), CASES + OTHERS)
def test_a_bad_field_is_refused_by_its_name(tiny, kind, name, value):
    # three sources, all of which NT uses
    whole = evolve(tiny, sources=3, runs_per_task=3, counts={"NT": 3})
    with pytest.raises(ValueError, match="must") as caught:
        evolve(whole if kind is Experiment else tiny.pool, **{name: value})
    message = str(caught.value)
    others = {"iterations": "every", "runs": "runs_per_task", "sources": "counts"}
    assert name in message or others.get(name, "sources") in message
    assert len(message.splitlines()) == 1
    assert "got " in message


def test_a_pool_cannot_have_more_sources_than_its_family_names():
    mazes = MazeFamily(("north-east 0", "south-west 11"))
    Pool("mazes", mazes, count=2)
    with pytest.raises(ValueError, match="count must not exceed a family's tasks, got 3"):
        Pool("mazes", mazes, count=3)
