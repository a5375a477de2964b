"""Where the mean of old weights leads: it starts in the corner and takes its greedy actions."""

import numpy as np
import torch
from attrs import evolve

from vtbook.experiments.controls import CONTROLS
from vtbook.paths import walks_of_the_mean
from vtlab.run import chosen_sources
from vtlab.store import weights
from vtlib.qfunctions import greedy

STEPS = 6
UP_RIGHT_DOWN_LEFT = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])


def test_each_step_goes_where_the_mean_points():
    few = evolve(CONTROLS["rooms_evaluation"], runs=4)
    mean = torch.from_numpy(weights(few.pool)[chosen_sources(few, range(4))]).mean(1, keepdim=True)
    for run, walk in enumerate(walks_of_the_mean(few, STEPS)):
        assert walk.shape == (STEPS + 1, 2)
        assert (walk[0] == 0).all()
        state = torch.from_numpy(walk[:1])
        action = int(greedy(few.family.q(), mean[run : run + 1], state))
        # noise is a fifth of a step, so a first step never goes elsewhere
        assert (walk[1] - walk[0]) @ UP_RIGHT_DOWN_LEFT[action] > 0.3
