"""The lead of the method over fine-tuning is the sum of what its parts add."""

import itertools

import numpy as np
import pytest

from vtbook.decomposition import PARTS, course, difference, lead_by_part
from vtbook.experiments.controls import CONTROLS
from vtbook.experiments.protocols import FROM_MEAN
from vtlab.store import returns


@pytest.mark.parametrize("page", CONTROLS)
def test_parts_add_up_to_the_lead_and_each_begins_where_the_last_ended(page):
    lead, *parts = lead_by_part(CONTROLS[page]).values()
    np.testing.assert_allclose(sum(parts), lead, atol=1e-6)
    labels = [FROM_MEAN, *(label for _, label in PARTS.values())]
    assert [*itertools.pairwise(labels)] == list(PARTS.values())
    assert labels[-1] == "1-MGVT"


def test_a_task_that_several_runs_have_counts_once():
    experiment = CONTROLS["rooms_likelihood"]
    stored = returns(experiment, "GVT")
    first = stored.learning.values[: experiment.runs_per_task].mean() / stored.optimum.values.mean()
    assert len(course(experiment, "GVT")) == experiment.runs // experiment.runs_per_task
    assert course(experiment, "GVT")[0] == pytest.approx(first, rel=1e-5)
    assert difference(experiment, "GVT", "GVT").max() == 0
