"""A panel for a page: the reader trains the method there, in WebAssembly, from real sources."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import Any

import numpy as np
from xarray import Dataset

from vtlib.baselines import MellowTDSettings
from vtlib.experiments.experiment import Experiment
from vtlib.experiments.rooms import GVT, MGVT, NT
from vtlib.experiments.store import weights
from vtlib.native.build import PAGE
from vtlib.native.runs import INTEGERS, NO_CLIP, NUMBERS
from vtlib.plots import COLOURS
from vtlib.priors import SPAN_JITTER
from vtlib.transfer import Settings

STATIC = Path(__file__).resolve().parents[1] / "book" / "_static"
ALGORITHMS: dict[str, Settings | MellowTDSettings] = {"MGVT": MGVT, "GVT": GVT, "NT": NT}
FIELDS = {"integers": INTEGERS.split(), "numbers": NUMBERS.split()}


def mean_curves(runs: Mapping[str, Dataset], until: int) -> list[dict[str, Any]]:
    """Mean learning returns of stored runs up to an iteration, as ``train_here`` draws them."""
    curves = []
    for label, stored in runs.items():
        mean = stored.learning.mean("run").sel(iteration=slice(None, until))
        curves.append(
            {
                "label": f"{label}, mean of {stored.sizes['run']} runs",
                "colour": COLOURS[label],
                "iterations": mean.iteration.values.tolist(),
                "values": [round(float(x), 3) for x in mean],
            }
        )
    return curves


def train_here(
    experiment: Experiment,
    doors: Sequence[float],
    references: Sequence[Mapping[str, Any]] = (),
    iterations: int = 5_000,
    every: int = 25,
    start: Mapping[str, Any] = MappingProxyType({}),
) -> str:
    """HTML of the panel: sources of the experiment's pool, a task with doors (W,) to move.

    references: curves to draw below the reader's, each a label, a colour, iterations and values.
    The learning return is recorded every so many iterations, up to the last. start: where controls
    stand at first, such as {"family": "GVT", "sources": 2}.
    """
    pool, scales = eight_bits(weights(experiment.pool))
    code = PAGE.read_bytes()
    files = {
        "wasm": b64encode(code).decode(),
        "pool": b64encode(pool.tobytes()).decode(),
        "worker": _read("trainer_worker.js"),
    }
    setup = {
        "fields": FIELDS,
        "settings": {name: kernel_settings(name, s) for name, s in ALGORITHMS.items()},
        "scales": [float(f"{x:.6g}") for x in scales],
        "doors": list(doors),
        "references": list(references),
        "start": dict(start),
        "iterations": iterations,
        "every": every,
        "files": files,
    }
    thousands = {"code": round(len(code) / 1e3), "data": round(pool.nbytes / 1e3)}
    style, html, script = (_read(f"trainer.{kind}") for kind in ("css", "html", "js"))
    data = json.dumps(setup, separators=(",", ":")).replace("<", "\\u003c")  # as HTML wants it
    return (
        f'<style>{style}</style><div class="trainer" role="group" aria-label="Train it here">'
        f"{Template(html).substitute(thousands, count=len(pool))}"
        f'<script type="application/json">{data}</script></div>'
        f"<script>{script}</script>"
    )


def eight_bits(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (S, d) as int8 (S, d) and a scale for each source (S,): w is about scale * byte."""
    scales = np.abs(weights).max(1) / 127
    return np.round(weights / scales[:, None]).astype(np.int8), scales


def kernel_settings(name: str, settings: Settings | MellowTDSettings) -> dict[str, Any]:
    """What the page's kernel is told of an algorithm, by the names that it has there."""
    names = [*FIELDS["integers"], *FIELDS["numbers"]]
    told = {key: getattr(settings, key) for key in names if hasattr(settings, key)}
    if isinstance(settings, MellowTDSettings):
        return {**told, "name": name, "alpha_mu": settings.alpha, "clip": NO_CLIP}
    gaussian = settings.family == "gaussian"
    prior = settings.jitter if gaussian else settings.sigma_p2
    return {
        **told,
        "name": name,
        "init": settings.init,
        "clip": NO_CLIP if settings.clip is None else settings.clip,
        "equal": int(settings.responsibilities == "equal"),
        "diagonal_kl": int(settings.kl == "diagonal"),
        "scale": 1 / prior,
        "variance": SPAN_JITTER if settings.init == "span" else prior,
    }


def _read(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")
