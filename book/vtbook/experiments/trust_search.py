"""What `vtlib.trust` learns with, one setting at a time, on tasks on which nothing is judged.

The sources never play, so that all that is earned is what was learned. Maze 0 and both streams are
for development alone. Before these runs the stronger pull had been tried in thirty or forty runs,
which are not stored, in three rooms, in maze 8 and, for 2,000 steps, on cartpole. It had earned
2.8 points more in rooms, 13 more on cartpole and 6.6 less in the maze. No random actions had earned
1.7 more in rooms with other doors. These runs ask whether that holds.
"""

from attrs import evolve

from vtbook.experiments.compared import ENVIRONMENTS
from vtbook.experiments.maze import MAZE_TARGETS
from vtbook.experiments.trust import ITERATIONS, RUNS
from vtbook.neighbours import VariedTrust
from vtlab.experiment import Algorithm, Experiment
from vtlib.trust import NARROW, WORTH, Trust

CHOSEN, STRONGER, GREEDY = "as it is", "ten times the pull", "no random actions"
_ALONE = Trust(sources_play=False)
_PULLED = evolve(_ALONE.in_units, lambda_=10 * WORTH * NARROW**2)
CHANGES: dict[str, Algorithm] = {
    STRONGER: VariedTrust(sources_play=False, learner=_PULLED),
    GREEDY: VariedTrust(sources_play=False, random=0.0),
}


def _search(beside: Experiment) -> Experiment:
    name = f"{beside.name.removesuffix('-tuning')}-search"
    return evolve(
        beside,
        name=name,
        stream=name,
        algorithms={CHOSEN: _ALONE, **CHANGES},
        runs=RUNS,
        iterations=ITERATIONS,
        every=100,
        greedy=False,
    )


_ROOMS, _, _POLES, _ = ENVIRONMENTS
#: By the name of the environment.
SEARCH = {
    "three rooms": _search(_ROOMS.tuning()),
    "cartpole": _search(_POLES.tuning()),
    "maze 0": _search(MAZE_TARGETS[0]),
}
