"""A panel for a page: the reader trains the method there, in WebAssembly, from real sources."""

import functools
import json
from base64 import b64encode
from collections.abc import Mapping, Sequence
from html import escape
from string import Template
from typing import Any

import numpy as np
import torch
from attrs import evolve, frozen
from xarray import Dataset

from vtbook.browser_panel import lean, panel, static
from vtbook.checkpoints import pauses
from vtbook.experiments.protocols import FROM_MEAN
from vtbook.plots import COLOURS
from vtbook.stages import STAGES, Method, Number, learners
from vtlab.envs.base import TaskFamily
from vtlab.experiment import Experiment
from vtlab.native.build import page_module
from vtlab.native.runs import FIXED, INTEGERS, NUMBERS, kernel_settings
from vtlab.run import prepare
from vtlab.store import weights
from vtlib.priors import SPAN_JITTER
from vtlib.training import arithmetic
from vtlib.transfer import Settings
from vtlib.trust import Trust, Trusting
from vtlib.units import FIRST


@frozen
class Preset:
    """A setting at one press: its name, what to look for there, and where the controls stand.

    What `state` does not name stays as it is, but for lambda, which becomes the thesis' own.
    """

    name: str
    look: str
    state: Mapping[str, Any]

    @property
    def button(self) -> str:
        state, look = (escape(x) for x in (json.dumps(dict(self.state)), self.look))
        return (
            f'<button type="button" class="preset" data-state="{state}" data-look="{look}">'
            f"{escape(self.name)}</button>"
        )


CURVATURES = 4  # runs that tell the curvature
FAMILIES = {"GVT": "GVT", "1-MGVT": "MGVT", "trust": "Trust"}

THESIS = Preset("thesis’ settings", "", {"psi": 0.5, "components": 1})


def mean_curves(runs: Mapping[str, Dataset], until: int) -> list[dict[str, Any]]:
    """Mean learning returns of stored runs of GVT, 1-MGVT and trust up to an iteration.

    A panel shows that of the family it trains.
    """
    curves = []
    for label, runs_of in runs.items():
        mean = runs_of.learning.sel(iteration=slice(None, until)).mean("run")
        source = f"{label.replace('trust', 'Trust')} from ten sources"
        others = f"{runs_of.sizes['run']} runs on other tasks"
        optimum = f"{float(runs_of.optimum.mean()):.3g}".replace("-", "−")
        curves.append(
            {
                "label": f"{source}, mean of {others} (mean optimum {optimum})",
                "family": FAMILIES[label],
                "colour": COLOURS[label],
                "iterations": mean.iteration.values.tolist(),
                "values": mean.values.round(3).tolist(),
            }
        )
    return curves


def train_here(
    experiment: Experiment,
    task: Sequence[float],
    references: Sequence[Mapping[str, Any]] = (),
    iterations: int = 5_000,
    presets: Sequence[Preset] = (THESIS,),
    other: Experiment | None = None,
    **start: str | float,
) -> str:
    """HTML of the panel: sources of the experiment's pool, and a task to change.

    task: the doors (W,) of rooms, else the numbers that tell a task of the family apart.
    references: curves to draw below the reader's, of which that of the chosen family is seen, each
    a label, a family, a colour, iterations and values. other: an experiment from whose pool, as
    large as the first, a preset with pool=1 takes its sources. start: where the family and the
    numbers stand at first, such as family="GVT" or sources=2.
    """
    family = experiment.family
    stage, code = STAGES[family.kernel], page_module(family.kernel).read_bytes()
    pools = [quantised(weights(e.pool)) for e in (experiment, other) if e]
    pool, scales = (np.concatenate(parts) for parts in zip(*pools, strict=True))
    numbers = stage.numbers[: len(task)]
    setup = {
        "fields": {"integers": INTEGERS.split(), "numbers": NUMBERS.split()},
        "settings": {
            name: _settings(name, s, family.kernel) for name, s in learners(experiment).items()
        },
        "scales": [float(f"{x:.6g}") for x in scales],
        "pools": len(pools),
        "weights": pool.shape[1],
        "spread": family.scale,
        "task": list(task),
        "ranges": [(number.least, number.most) for number in numbers],
        "limits": stage.limits,
        "ticks": stage.ticks,
        "optima": _optima(family, len(task)),
        "references": list(references),
        "start": start,
        "iterations": iterations,
        "every": iterations // 200,
        "wasm": b64encode(code).decode(),
        "pool": b64encode(pool.tobytes()).decode(),
        "worker": "".join(map(lean, ("promises.js", "trainer_worker.js", *stage.workers))),
    }
    mixture, chosen = static("trainer_mixture.html"), tuple(presets) != (THESIS,)
    return panel(
        "trainer",
        setup,
        stage.scripts,
        # where presets choose the setting, C and psi are rarely touched
        seen="" if chosen else mixture,
        folded=mixture if chosen else "",
        rare="C, ψ, " if chosen else "",
        changes=stage.changes,
        note=stage.note if FROM_MEAN in experiment.algorithms else "",
        arrival=stage.arrival,
        last=len(pools) - 1,
        presets="".join(preset.button for preset in presets),
        stage=_scene(family.kernel, numbers, task),
    )


@functools.cache
def _optima(family: TaskFamily, numbers: int) -> list[float]:
    landmarks = STAGES[family.kernel].landmarks
    return [round(optimum(family, task[:numbers]), 3) for task in landmarks]


def optimum(family: TaskFamily, task: Sequence[float]) -> float:
    """Best mean discounted return that an episode of a task, told by its numbers, can earn."""
    drawn: Any = family.draw_tasks("optimum", [0])
    parts = {name: getattr(drawn, name) for name in drawn.parameters}
    numbers = torch.tensor(task).split([part.numel() for part in parts.values()])
    changed = {name: x.view_as(parts[name]) for name, x in zip(parts, numbers, strict=True)}
    return float(family.optimum(evolve(drawn, **changed))[0])


def _scene(kernel: str, numbers: Sequence[Number], task: Sequence[float]) -> str:
    """HTML of what moves and of what changes its task: sliders, or doors to drag."""
    stage = STAGES[kernel]
    if kernel == "rooms":
        door = Template(static("stage_rooms_door.html"))
        names = [n.label for n in numbers] if len(numbers) > 1 else ["Door"]
        parts = {"walls": "<path/>" * len(numbers)}
        parts["task"] = "".join(door.substitute(name=name) for name in names)
    else:
        parts = {**stage.shown, "scene": static(f"stage_{kernel}.html")}
        parts["task"] = "".join(map(_slider, numbers, task))
    return Template(static(stage.template)).substitute(parts)


def _slider(number: Number, value: float) -> str:
    least, most, step = number.least, number.most, number.step
    return (
        f'<label class="number"><span>{number.label}</span><input type="range" min="{least:g}" '
        f'max="{most:g}" step="{step:.5f}" value="{value:g}" aria-label="{number.label}">'
        f'<output aria-live="off">{value:g}</output></label>'
    )


def quantised(sources: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights (S, d) as little-endian integers of 16 bits, and the scale (S,) of each source."""
    scales = np.abs(sources).max(1) / np.iinfo(np.int16).max
    return np.round(sources / scales[:, None]).astype("<i2"), scales


def _settings(name: str, method: Method, kernel: str) -> dict[str, Any]:
    """The kernel's settings of a method, and where its posterior starts."""
    if isinstance(method, Trust):
        inner = _settings(name, method.in_units, kernel)
        fixed = {"family": FIXED, "updates": method.updates, "eta": _curvature(kernel)}
        return {**inner, **fixed, "deviation": inner["variance"] ** 0.5}
    settings = {**kernel_settings(method), "name": name}
    if isinstance(method, Settings):
        variance = SPAN_JITTER if method.init == "span" else 1 / settings["scale"]
        settings.update(init=method.init, variance=variance, ddof=method.ddof)
    return settings


@functools.cache
def _curvature(kernel: str) -> float:
    """The curvature of the TD error in a stage's tasks, of which the recommended method learns.

    The page holds the median of some runs, because it says only how much the prior counts beside
    a transition, and after some episodes that is nothing.
    """
    published = STAGES[kernel].published
    experiment = evolve(published, algorithms={"trust": Trust()}, counts={})
    batch = prepare(experiment, "trust", range(CURVATURES), weights(published.pool))
    with arithmetic():
        list(pauses(batch, [2 * FIRST]))
    assert isinstance(batch.agent, Trusting)
    state = batch.agent.state()
    unit = state["sources"].square().mean((1, 2))
    return float((state["curvature"].flatten() / unit).median())
