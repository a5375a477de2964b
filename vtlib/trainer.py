"""A panel for a page: the reader trains the method there, in WebAssembly, from real sources."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from xarray import Dataset

from vtlib.baselines import MellowTDSettings
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.rooms import GVT, MGVT, NT
from vtlib.experiments.store import weights
from vtlib.native.build import PAGE
from vtlib.native.runs import INTEGERS, NUMBERS, kernel_settings
from vtlib.plots import COLOURS
from vtlib.priors import SPAN_JITTER
from vtlib.transfer import Settings

STATIC = Path(__file__).resolve().parents[1] / "book" / "_static"
ALGORITHMS: dict[str, Settings | MellowTDSettings] = {"MGVT": MGVT, "GVT": GVT, "NT": NT}


def mean_curves(runs: Mapping[str, Dataset], until: int) -> list[dict[str, Any]]:
    """Mean learning returns of stored runs up to an iteration, as ``train_here`` draws them."""
    until_then = {label: one.sel(iteration=slice(None, until)) for label, one in runs.items()}
    return [
        {
            "label": f"{label}, {stored.sizes['run']} runs",
            "colour": COLOURS[label],
            "iterations": stored.iteration.values.tolist(),
            "values": stored.learning.mean("run").values.round(3).tolist(),
        }
        for label, stored in until_then.items()
    ]


def train_here(
    experiment: Experiment,
    doors: Sequence[float],
    references: Sequence[Mapping[str, Any]] = (),
    iterations: int = 5_000,
    **start: str | float,
) -> str:
    """HTML of the panel: sources of the experiment's pool, a task with doors (W,) to move.

    references: curves to draw below the reader's, each a label, a colour, iterations and values.
    start: where controls stand at first, by their names, such as family="GVT" or sources=2.
    """
    sources = weights(experiment.pool)
    scales = np.abs(sources).max(1) / 127
    pool = np.round(sources / scales[:, None]).astype(np.int8)
    code = PAGE.read_bytes()
    setup = {
        "fields": {"integers": INTEGERS.split(), "numbers": NUMBERS.split()},
        "settings": {name: _told(name, s) for name, s in ALGORITHMS.items()},
        "scales": [float(f"{x:.6g}") for x in scales],
        "doors": list(doors),
        "references": list(references),
        "start": start,
        "iterations": iterations,
        "every": iterations // 200,
        "wasm": b64encode(code).decode(),
        "pool": b64encode(pool.tobytes()).decode(),
        "worker": _read("trainer_worker.js"),
    }
    return Template(_read("trainer.html")).substitute(
        style=_read("trainer.css"),
        script=_read("trainer.js"),
        setup=json.dumps(setup, separators=(",", ":")).replace("<", "\\u003c"),  # as HTML wants it
        code=round(len(code) / 1e3),
        data=round(pool.nbytes / 1e3),
    )


def _told(name: str, s: Settings | MellowTDSettings) -> dict[str, Any]:
    """The kernel's settings of an algorithm, and where its posterior starts."""
    told = {**kernel_settings(s), "name": name}
    if isinstance(s, Settings):
        told.update(init=s.init, variance=SPAN_JITTER if s.init == "span" else 1 / told["scale"])
    return told


def _read(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")
