"""A panel for a page: the reader trains the method there, in WebAssembly, from real sources."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from xarray import Dataset

from vtbook.browser_panel import panel, static
from vtbook.experiments.cartpole import CARTPOLE, CARTPOLE_NOTHING
from vtbook.experiments.mountain_car import CAR, CAR_NOTHING
from vtbook.experiments.protocols import transfer_settings
from vtbook.experiments.rooms import NT, NT_GREEDY, PUBLISHED_GVT, PUBLISHED_MGVT
from vtbook.plots import COLOURS
from vtbook.published import PublishedCurve
from vtlab.experiment import Experiment
from vtlab.native.build import page_module
from vtlab.native.runs import INTEGERS, NUMBERS, kernel_settings
from vtlab.store import weights
from vtlib.baselines import MellowTDSettings
from vtlib.priors import SPAN_JITTER
from vtlib.transfer import Settings

INK = "currentColor"  # of what was published: a thin line in the colour of the page's text


@frozen
class Stage:
    """What trains and moves: its algorithms as published, its files, and how its task changes.

    Weights of networks need sixteen bits: with eight the sources of mountain car drive worse.
    """

    algorithms: dict[str, Settings | MellowTDSettings]
    scripts: tuple[str, ...]
    template: str
    changes: str
    weights: type[np.signedinteger[Any]] = np.int16
    worker: str = ""


def _with_networks(published: Experiment, nothing: Experiment, script: str) -> Stage:
    """The stage of an experiment whose sources are networks; fine-tuning hardly explores."""
    learner = nothing.algorithms["NT"]
    assert isinstance(learner, MellowTDSettings)
    algorithms: dict[str, Settings | MellowTDSettings] = {
        "MGVT": transfer_settings(published, "1-MGVT"),
        "GVT": transfer_settings(published, "GVT"),
        "NT": learner,
        "fine": evolve(learner, epsilon_start=learner.epsilon_end),
    }
    return Stage(algorithms, ("stage_drive.js", script), "stage_drive.html", "the task changes")


# As published, where the thesis' figures begin.
STAGES = {
    "rooms": Stage(
        {"MGVT": PUBLISHED_MGVT, "GVT": PUBLISHED_GVT, "NT": NT, "fine": NT_GREEDY},
        ("stage_rooms.js",),
        "stage_rooms.html",
        "a door moves",
        np.int8,
        "stage_rooms_worker.js",
    ),
    "cartpole": _with_networks(CARTPOLE.published, CARTPOLE_NOTHING, "stage_cartpole.js"),
    "mountain_car": _with_networks(CAR.published, CAR_NOTHING, "stage_mountain_car.js"),
}


def mean_curves(runs: Mapping[str, Dataset], until: int) -> list[dict[str, Any]]:
    """Mean learning returns of stored runs up to an iteration, as ``train_here`` draws them."""
    curves = []
    for label, stored in runs.items():
        mean = stored.learning.sel(iteration=slice(None, until)).mean("run")
        name = f"{label}, {stored.sizes['run']} runs"
        curves.append(_reference(name, COLOURS[label], mean.iteration.values, mean.values))
    return curves


def published_curves(printed: Mapping[str, PublishedCurve], until: int) -> list[dict[str, Any]]:
    """Those of GVT and 1-MGVT up to an iteration; a panel shows that of the family it trains."""
    curves = []
    for label in ("GVT", "1-MGVT"):
        at, mean, *_ = printed[label]
        early = at <= until
        curve = _reference(f"{label}, published", INK, at[early], mean[early])
        curves.append({**curve, "family": label.removeprefix("1-")})
    return curves


def _reference(label: str, colour: str, at: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    points = {"iterations": at.tolist(), "values": values.round(3).tolist()}
    return {"label": label, "colour": colour, **points}


def train_here(
    experiment: Experiment,
    task: Sequence[float],
    references: Sequence[Mapping[str, Any]] = (),
    iterations: int = 5_000,
    **start: str | float,
) -> str:
    """HTML of the panel: sources of the experiment's pool, and a task to change.

    task: the doors (W,) of rooms, else the numbers that tell a task of the family apart.
    references: curves to draw below the reader's, each a label, a colour, iterations and values.
    start: where the family and the numbers stand at first, such as family="GVT" or sources=2.
    The learner without transfer is the experiment's own, if it has one.
    """
    family = experiment.family
    stage, code = STAGES[family.kernel], page_module(family.kernel).read_bytes()
    nothing = experiment.algorithms.get("NT", stage.algorithms["NT"])
    assert isinstance(nothing, MellowTDSettings)
    pool, scales = quantised(weights(experiment.pool), stage.weights)
    setup = {
        "fields": {"integers": INTEGERS.split(), "numbers": NUMBERS.split()},
        "settings": {
            name: _settings(name, s) for name, s in (stage.algorithms | {"NT": nothing}).items()
        },
        "scales": [float(f"{x:.6g}") for x in scales],
        "bits": 8 * pool.itemsize,
        "weights": pool.shape[1],
        "spread": family.scale,
        "task": list(task),
        "references": list(references),
        "start": start,
        "iterations": iterations,
        "every": iterations // 200,
        "wasm": b64encode(code).decode(),
        "pool": b64encode(pool.tobytes()).decode(),
        "worker": static("trainer_worker.js") + (stage.worker and static(stage.worker)),
    }
    return panel(
        "trainer",
        setup,
        stage.scripts,
        code=round(len(code) / 1e3),
        data=round(pool.nbytes / 1e3),
        bits=8 * pool.itemsize,
        changes=stage.changes,
        stage=static(stage.template),
    )


def quantised(
    sources: np.ndarray, kind: type[np.signedinteger[Any]]
) -> tuple[np.ndarray, np.ndarray]:
    """Weights (S, d) as little-endian integers of a kind, and the scale (S,) of each source."""
    scales = np.abs(sources).max(1) / np.iinfo(kind).max
    integers = np.round(sources / scales[:, None]).astype(kind)
    return integers.astype(integers.dtype.newbyteorder("<")), scales


def _settings(name: str, s: Settings | MellowTDSettings) -> dict[str, Any]:
    """The kernel's settings of an algorithm, and where its posterior starts."""
    settings = {**kernel_settings(s), "name": name}
    if isinstance(s, Settings):
        variance = SPAN_JITTER if s.init == "span" else 1 / settings["scale"]
        settings.update(init=s.init, variance=variance, ddof=s.ddof)
    return settings
