"""Configurations: what is refused, by the name of its field, and what follows from the fields."""

import math
from types import SimpleNamespace

import attrs
import pytest
from attrs import evolve

from vtbook.experiments.grids import slider_lambdas, sliders_of
from vtbook.experiments.protocols import transfer_settings
from vtlib.baselines import LearnerSettings, MellowTDSettings
from vtlib.envs.maze import MazeFamily
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.transfer import Settings

NO_WHOLE = [0, -1, 1.0, True, "3", None, 10**10, math.nan]
NO_NAME = ["", " ", "..", "a/b", "a\nb", "\u2028", 3, None]
NO_BOOL = [0, 1, "True", None]
NO_KIND = [None, 3, "rooms", object]
POOL = {
    "name": NO_NAME,
    "family": NO_KIND,
    "count": NO_WHOLE,
    "iterations": NO_WHOLE,
    "limit": NO_WHOLE,
    "check_every": NO_WHOLE,
    "episodes": NO_WHOLE,
    "required": [-0.1, 1.1, math.nan, "0.5", True, None],
    "attempts": NO_WHOLE,
    # settings without an agent, and those of an algorithm that transfers
    "settings": [*NO_KIND, LearnerSettings(5), Settings()],
    "common": NO_BOOL,
    "as_targets": NO_BOOL,
    "stream": NO_NAME,
}
NT = MellowTDSettings(epsilon_steps=100)
EXPERIMENT = {
    "name": NO_NAME,
    "pool": NO_KIND,
    "family": [*NO_KIND, RoomsFamily()],
    "algorithms": [*NO_KIND, {}, {"NT": 3}, {"NT": LearnerSettings(5)}, {"": NT}, {"tasks": NT}],
    "runs": [*NO_WHOLE, 2],  # not divided by the runs of a task
    "sources": [*NO_WHOLE, 4, 2],  # more than are eligible; fewer than an algorithm uses
    "iterations": [*NO_WHOLE, 10],  # fewer than one record
    "every": [*NO_WHOLE, 221],
    "stream": NO_NAME,
    "runs_per_task": [*NO_WHOLE, 2, 6],
    "counts": [None, {"3-MGVT": 1}, {"NT": 0}, {"NT": 4}, {"NT": 1.0}],
    "visits": NO_BOOL,
    "excluded": [None, 1, [1], (3,), (-1,), (1.0,), (True,), (0,)],  # too few would be left
    "probes": [-1, 1.0, True, None, 5],  # 5 only where all transfer
    "probe": [print],  # without places to look at
    "each": NO_BOOL,
}
TABLES = ((Pool, POOL), (Experiment, EXPERIMENT))


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [(kind, name, x) for kind, table in TABLES for name, values in table.items() for x in values],
)
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


@pytest.mark.parametrize(("config", "table"), TABLES)
def test_every_field_has_values_that_are_refused(config, table):
    assert [field.name for field in attrs.fields(config)] == list(table)


def test_a_pool_cannot_have_more_sources_than_its_family_names():
    mazes = MazeFamily(("north-east 0", "south-west 11"))
    Pool("mazes", mazes, count=2)
    with pytest.raises(ValueError, match="count must not exceed the tasks of the family, got 3"):
        Pool("mazes", mazes, count=3)


def test_an_algorithm_must_be_of_an_attrs_class(tiny):
    loose = SimpleNamespace(transfers=False, agent=print)
    with pytest.raises(ValueError, match="settings must be of an attrs class"):
        evolve(tiny.pool, settings=loose)


def test_sliders_need_a_lambda_and_an_algorithm_to_vary(tiny):
    with pytest.raises(ValueError, match="lambda_ must be positive"):
        slider_lambdas(Settings(lambda_=0))
    with pytest.raises(ValueError, match=r"algorithms\['NT'\] must be of type Settings"):
        transfer_settings(tiny, "NT")
    with pytest.raises(ValueError, match="the sliders' algorithm must be one of NT, "):
        sliders_of(tiny, "tiny-sliders", 2, 100)
