"""A panel for a page: the reader trains the method there, in WebAssembly, from real sources."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from xarray import Dataset

from vtbook.browser_panel import panel, static
from vtbook.experiments.rooms import NT, NT_GREEDY, PUBLISHED_GVT, PUBLISHED_MGVT
from vtbook.plots import COLOURS
from vtbook.published import PublishedCurve
from vtlab.experiment import Experiment
from vtlab.native.build import PAGE
from vtlab.native.runs import INTEGERS, NUMBERS, kernel_settings
from vtlab.store import weights
from vtlib.baselines import MellowTDSettings
from vtlib.priors import SPAN_JITTER
from vtlib.transfer import Settings

INK = "currentColor"  # of what was published: a thin line in the colour of the page's text
# As published, where the thesis' figures begin; fine-tuning hardly explores.
ALGORITHMS: dict[str, Settings | MellowTDSettings] = {
    "MGVT": PUBLISHED_MGVT,
    "GVT": PUBLISHED_GVT,
    "NT": NT,
    "fine": NT_GREEDY,
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
    doors: Sequence[float],
    references: Sequence[Mapping[str, Any]] = (),
    iterations: int = 5_000,
    **start: str | float,
) -> str:
    """HTML of the panel: sources of the experiment's pool, a task with doors (W,) to move.

    references: curves to draw below the reader's, each a label, a colour, iterations and values.
    start: where the family and the numbers stand at first, such as family="GVT" or sources=2.
    The learner without transfer is the experiment's own.
    """
    nothing = experiment.algorithms.get("NT", NT)
    assert isinstance(nothing, MellowTDSettings)
    sources = weights(experiment.pool)
    scales = np.abs(sources).max(1) / 127
    pool = np.round(sources / scales[:, None]).astype(np.int8)
    code = PAGE.read_bytes()
    setup = {
        "fields": {"integers": INTEGERS.split(), "numbers": NUMBERS.split()},
        "settings": {
            name: _settings(name, s) for name, s in (ALGORITHMS | {"NT": nothing}).items()
        },
        "scales": [float(f"{x:.6g}") for x in scales],
        "doors": list(doors),
        "references": list(references),
        "start": start,
        "iterations": iterations,
        "every": iterations // 200,
        "wasm": b64encode(code).decode(),
        "pool": b64encode(pool.tobytes()).decode(),
        "worker": static("trainer_worker.js"),
    }
    sizes = {"code": round(len(code) / 1e3), "data": round(pool.nbytes / 1e3)}
    return panel("trainer", setup, **sizes)


def _settings(name: str, s: Settings | MellowTDSettings) -> dict[str, Any]:
    """The kernel's settings of an algorithm, and where its posterior starts."""
    settings = {**kernel_settings(s), "name": name}
    if isinstance(s, Settings):
        variance = SPAN_JITTER if s.init == "span" else 1 / settings["scale"]
        settings.update(init=s.init, variance=variance, ddof=s.ddof)
    return settings
