"""How `vtlib.trust` is to be judged: tasks, rivals, lengths and streams, fixed before any run.

Nobody has run these: the book's experiments do not list them until their results are there. The
method was chosen on the tuning tasks of `compared` and on cartpoles of two wirings. Each rival has
the setting that `compared` chose for it, in a task that is new the one of the task it resembles.
"""

from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLES
from vtbook.experiments.compared import ENVIRONMENTS, FOUR
from vtlab.envs.base import TaskFamily
from vtlab.envs.cartpole.noisy import NoisyCartpoleFamily
from vtlab.envs.cartpole.wired import WiredCartpoleFamily
from vtlab.envs.mountain_car.steep import SteepCarFamily
from vtlab.experiment import Experiment, Pool
from vtlib.recommended import Recommended
from vtlib.trust import Trust

OURS = "trust"
RIVALS = ("untouched", "NT", "fine-tuned", "DDQN, fine-tuned", "1-MGVT", "3-MGVT", "Langevin")
REPEATED = tuple(f"{x}{FOUR}" for x in ("fine-tuned", "1-MGVT", "3-MGVT"))
RUNS, ITERATIONS = 30, 5_000
# A loss that counts as none, as a share of the optimum; the tests, over all places and rivals, are
# corrected together, after Holm.
LOSS = 0.03
WIRED = evolve(CARTPOLES, name="wired-sources", family=WiredCartpoleFamily(), count=30)
ROOMS, CHANGED, POLES, CARS = (place.judged() for place in ENVIRONMENTS)


def _judged(
    name: str, beside: Experiment, family: TaskFamily | None = None, pool: Pool | None = None
) -> Experiment:
    """The method and its rivals, with the settings of `beside`, on tasks of their own."""
    algorithms = {x: beside.algorithms[x] for x in (*RIVALS, *REPEATED) if x in beside.algorithms}
    return evolve(
        beside,
        name=f"{name}-trust",
        stream=f"{name}-trust",
        family=family or beside.family,
        pool=pool or beside.pool,
        algorithms={OURS: Trust(), "recommended": Recommended(), **algorithms},
        runs=RUNS,
        iterations=ITERATIONS,
        every=100,
    )


JUDGED = (
    _judged("rooms-evaluation", ROOMS),
    _judged("rooms-distribution-change", CHANGED),
    _judged("cartpole", POLES),
    _judged("mountain-car", CARS),
    _judged("wired-cartpole", POLES, WiredCartpoleFamily(), WIRED),
    _judged("noisy-cartpole", POLES, NoisyCartpoleFamily()),
    _judged("steep-car", CARS, SteepCarFamily()),
)
