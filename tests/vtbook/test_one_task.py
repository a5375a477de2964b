"""A panel's setting for the engines: one task, with the reader's numbers, as the page trains it."""

import numpy as np
import pytest

from vtbook.one_task import one_task, optimum
from vtlab.envs.mountain_car import MountainCarFamily
from vtlab.run import by_kernels, chosen_sources, targets
from vtlib.trust import Trust

TOLD = {"sources": 2, "iterations": 500, "seed": 3, "psi": 0.5, "components": 1}
TASKS = {
    "rooms-evaluation": (7.0, 2.5),
    "cartpole": (1.2, 0.15, 0.7),
    "mountain-car": (0.00131,),
}


@pytest.mark.parametrize(("name", "task"), TASKS.items())
def test_every_run_learns_the_reader_s_task_by_the_kernels(name, task):
    here = one_task(name, task, "GVT", lambda_=0.0, **TOLD)
    drawn = targets(here, range(3))
    numbers = [here.family.kernel_parameters(drawn, row)[: len(task)] for row in range(3)]
    np.testing.assert_allclose(numbers, [task] * 3, rtol=1e-6)
    assert list(here.algorithms) == ["GVT", "fine-tuned mean", "NT"]
    assert all(by_kernels(here, label) for label in here.algorithms)
    assert (here.algorithms["GVT"].lambda_, here.sources) == (0.0, 2)


def test_the_recommended_method_is_a_setting_too():
    told = {"sources": 2, "iterations": 500, "seed": 3}
    here = one_task("mountain-car", TASKS["mountain-car"], "Trust", **told)
    assert here.algorithms["Trust"] == Trust()
    assert list(here.algorithms) == ["Trust", "fine-tuned mean", "NT"]


def test_another_seed_draws_other_sources():
    first, again, other = (
        chosen_sources(one_task("cartpole", TASKS["cartpole"], "MGVT", **{**TOLD, "seed": s}), [0])
        for s in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_a_stronger_engine_is_worth_more():
    family = MountainCarFamily()
    assert optimum(family, (0.0015,)) > optimum(family, (0.001,)) + 5
