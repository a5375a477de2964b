"""What trains and moves in a page: its algorithms as published, its files, how its task changes."""

from collections.abc import Mapping
from typing import Any

from attrs import evolve, field, frozen

from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_NOTHING
from vtbook.experiments.mountain_car import CAR, CAR_NOTHING
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtlab.experiment import Experiment
from vtlib.baselines import MellowTDSettings
from vtlib.transfer import Settings
from vtlib.trust import Trust

Method = Settings | MellowTDSettings | Trust


@frozen
class Number:
    """A number of a task that a reader sets: what it is called, least, most, and its step."""

    label: str
    least: float
    most: float
    step: float


@frozen
class Stage:
    """Algorithms as published, the scripts, the template, and the numbers that have sliders.

    The script interpolates the optimum of a task between the landmarks' optima.
    """

    algorithms: dict[str, Method]
    published: Experiment
    scripts: tuple[str, ...]
    template: str
    changes: str
    arrival: str
    landmarks: tuple[tuple[float, ...], ...]
    limits: tuple[float, float]
    ticks: tuple[float, ...]
    numbers: tuple[Number, ...]
    shown: Mapping[str, str] = field(factory=dict)
    workers: tuple[str, ...] = ()
    note: str = ""


MELLOW = (
    "Fine-tuning and no transfer learn here by mellow TD, as the method does; "
    "this page’s stored runs of fine-tuning learn by DDQN."
)


def _stage(published: Experiment, nothing: Experiment, **fields: Any) -> Stage:
    """The stage of an experiment and of one with NT, by default one that is driven."""
    learner = nothing.algorithms["NT"]
    assert isinstance(learner, MellowTDSettings)
    # fine-tuning hardly explores
    algorithms: dict[str, Method] = {
        "MGVT": transfer_settings(published, "1-MGVT"),
        "GVT": transfer_settings(published, "GVT"),
        "Trust": Trust(),
        "NT": learner,
        "fine": evolve(learner, epsilon_start=learner.epsilon_end),
    }
    driven = {"template": "stage_drive.html", "changes": "the task changes", "note": MELLOW}
    return Stage(algorithms, published, **driven | fields)


# As published, where the thesis' figures begin.
STAGES = {
    "rooms": _stage(
        ROOMS_EVALUATION,
        ROOMS_EVALUATION,
        scripts=("stage_rooms.js",),
        template="stage_rooms.html",
        changes="a door moves",
        arrival="goal first reached",
        # it is lower only where the way leads back, from a lower door on the right
        landmarks=((5.0, 5.0), (9.5, 0.5)),
        limits=(0.0, 0.9),
        ticks=(0.0, 0.2, 0.4, 0.6, 0.8),
        numbers=(Number("Lower door", 0.5, 9.5, 0.1), Number("Upper door", 0.5, 9.5, 0.1)),
        workers=("stage_rooms_worker.js",),
        note="",
    ),
    "cartpole": _stage(
        CARTPOLE,
        CARTPOLE_NOTHING,
        scripts=("stage_drive.js", "stage_cartpole.js"),
        arrival="first balanced to the end",
        landmarks=((1.0, 0.2, 0.5),),  # every pole can be balanced to the end
        limits=(0.0, 66.0),
        ticks=(0.0, 20.0, 40.0, 60.0),
        numbers=(
            Number("cart, kg", 0.5, 1.5, 0.05),
            Number("pole, kg", 0.1, 0.3, 0.01),
            Number("half length, m", 0.2, 1, 0.02),
        ),
        shown={
            "view": "-2.9 -2.5 5.8 2.8",
            "across": "angle",
            "up": "angular velocity",
            "hint": "“You” push with the arrow keys, or touch the left or right of the picture, "
            "at half speed.",
        },
    ),
    "mountain_car": _stage(
        CAR,
        CAR_NOTHING,
        scripts=("stage_drive.js", "stage_mountain_car.js"),
        arrival="top first reached",
        landmarks=((0.001,), (0.00125,), (0.0015,)),
        limits=(-90.0, -40.0),
        ticks=tuple(range(-90, -39, 10)),
        numbers=(Number("engine", 0.001, 0.0015, 0.00001),),
        shown={
            "view": "-1.25 -0.8 1.9 1.3",
            "across": "position",
            "up": "velocity",
            "hint": "“You” drive with the arrow keys, or touch the left or right of the picture. "
            "Roll back first.",
        },
    ),
}


def learners(experiment: Experiment) -> dict[str, Method]:
    """The algorithms of an experiment's panel; that without transfer is its own, if it has one."""
    stage = STAGES[experiment.family.kernel]
    nothing = experiment.algorithms.get("NT", stage.algorithms["NT"])
    assert isinstance(nothing, MellowTDSettings)
    return {**stage.algorithms, "NT": nothing}
