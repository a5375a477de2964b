"""What was learned, as a thing to keep: it acts, says how sure it is, and is saved and read."""

import io
import json
from pathlib import Path
from typing import Any, Self

import attrs
import numpy as np
import torch
from attrs import frozen
from torch import Tensor

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.checks import check_kind, check_whole, shown
from vtlib.files import TornResult, write_bytes
from vtlib.qfunctions import QFunction, described, from_description
from vtlib.transfer import Settings
from vtlib.trust import Trust

KINDS = (DDQNSettings, FineTuning, MellowTDSettings, Settings, Trust)
DRAWS = 200  # from each component, for a deviation
ABOUT = "about"  # the text beside the arrays of a file
STATE = "state "  # before the names of a state's arrays


@frozen(eq=False)
class Learned:
    """What R runs end with.

    weights (R, C, d): final weights, those of each component's mean for a posterior. iterations
    (T,) and returns (R, T): mean discounted return of the last 50 episodes, NaN before the first
    has ended. steps (R,): of the environment. improved (R,): whether the weights learned are kept;
    else they are the best source's (see ``transfer``). mu (R, C, d) and scale_tril (R, C, d, d):
    means and factors L of the posterior learned, kept or not, or L's diagonals
    (R, C, d) where it is diagonal; None without a posterior. state: why ``Trust`` acted as it did,
    and all that it takes to go on (``Trusting.state``). interrupted: whether Ctrl-C ended it. q,
    settings and seed are the call's; the environments' first action is first_action.
    """

    weights: Tensor
    iterations: Tensor
    returns: Tensor
    steps: Tensor
    improved: Tensor
    mu: Tensor | None = None
    scale_tril: Tensor | None = None
    state: dict[str, Tensor] | None = None
    q: QFunction | None = None
    settings: Any = None
    seed: int = 0
    first_action: int = 0
    interrupted: bool = False

    def __attrs_post_init__(self) -> None:
        (runs, components, d), (times,) = self.weights.shape, self.iterations.shape
        shapes = [tuple(x.shape) for x in (self.returns, self.steps, self.improved)]
        means, factors = (None if x is None else x.shape for x in (self.mu, self.scale_tril))
        shape = (runs, components, d)
        posteriors = (None, None), (shape, shape), (shape, (*shape, d))
        if shapes != [(runs, times), (runs,), (runs,)] or (means, factors) not in posteriors:
            got = f"{shapes}, mu {means}, scale_tril {factors}"
            raise ValueError(f"arrays must fit weights {shape} and {times} records, got {got}")

    def __str__(self) -> str:
        lines = []
        for run, steps in enumerate(self.steps.tolist()):
            line = f"run {run}: {steps:,} steps"
            if self.state is not None:
                played, sources = self.state["played"][run], self.state["sources"].shape[1]
                ended, by_sources = (played >= 0).sum(), ((played >= 0) & (played < sources)).sum()
                keeps = "what was learned" if self.improved[run] else "a source"
                line += f", sources played {by_sources} of {ended} episodes, kept is {keeps}"
            lines.append(line + ", interrupted" * self.interrupted)
        return "\n".join(lines)

    @property
    def gamma(self) -> float:
        """The discount that was learned with; ValueError where the settings are not known."""
        settings = getattr(self.settings, "learner", self.settings)
        check_kind("settings", settings, DDQNSettings | MellowTDSettings | Settings | Trust)
        return float(settings.gamma)

    def predict(self, obs: Any, run: int = 0) -> Any:
        """The greedy action at an observation (obs_dim,), or actions (B,) at (B, obs_dim).

        The values of all components of a run are averaged, as by ``evaluate``, and actions are the
        environment's. Raises ValueError for what the Q-function cannot value.
        """
        values, many = self._values(self.weights, obs, run)
        actions = values.mean(0).argmax(-1).numpy() + self.first_action
        return actions if many else int(actions[0])

    def values(self, obs: Any, run: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of Q, (A,) at an observation or (B, A) at many.

        They are the posterior's, whether it is kept or not, from 200 draws of each component;
        without a posterior the deviation is 0. Raises as ``predict``.
        """
        weights = self.weights
        if self.mu is not None and self.scale_tril is not None:
            check_whole("run", run, 0, len(weights) - 1)
            mu, L = self.mu[run].unsqueeze(1), self.scale_tril[run]
            z = torch.randn(len(mu), DRAWS, mu.shape[2], generator=torch.Generator().manual_seed(0))
            draws = mu + (z * L.unsqueeze(1) if L.ndim == 2 else z @ L.mT)
            weights = draws.reshape(1, -1, draws.shape[2]).expand(len(weights), -1, -1)
        values, many = self._values(weights, obs, run)
        mean, deviation = values.mean(0).numpy(), values.std(0, correction=0).numpy()
        return (mean, deviation) if many else (mean[0], deviation[0])

    def _values(self, weights: Tensor, obs: Any, run: int) -> tuple[Tensor, bool]:
        """Values (K, B, A) of a run's weights (R, K, d), and whether observations are many."""
        check_kind("q", self.q, QFunction)
        check_whole("run", run, 0, len(weights) - 1)
        try:
            seen = torch.as_tensor(np.asarray(obs, np.float32))
            rows = seen if seen.ndim == 2 else seen.unsqueeze(0)
            if seen.ndim not in (1, 2) or not bool(seen.isfinite().all()):
                raise ValueError("numbers that are not finite, or of other than 1 or 2 axes")
            values = self.q.q(weights[run : run + 1], self.q.prepare(rows.unsqueeze(0)))  # type: ignore[union-attr]
        except Exception as error:  # a user's Q-function may raise anything
            fault = shown(str(error))
            raise ValueError(f"obs must be observations of q, got {shown(obs)}: {fault}") from error
        return values[0].transpose(1, 2), seen.ndim == 2

    def save(self, path: str | Path) -> None:
        """Write everything but a module's code to one .npz of plain arrays, at once."""
        check_kind("path", path, str | Path)
        if Path(path).is_dir():
            rule = f"path must be a file, such as {path}/learned.npz"
            raise ValueError(f"{rule}, got the folder {path}")
        arrays: dict[str, Any] = {
            name: part.cpu().numpy()
            for name, part in attrs.asdict(self, recurse=False).items()
            if isinstance(part, Tensor)
        }
        arrays |= {STATE + name: part.numpy() for name, part in (self.state or {}).items()}
        about = {
            "q": None if self.q is None else described(self.q),
            "settings": _plain(self.settings) if isinstance(self.settings, KINDS) else None,
            **{x: getattr(self, x) for x in ("seed", "first_action", "interrupted")},
        }
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        arrays[ABOUT] = np.array(json.dumps(about))
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)
        write_bytes(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path, q: QFunction | None = None) -> Self:
        """What was saved; TornResult names a file that is not whole or holds something else.

        q: needed for a module or a Q-function of one's own; ValueError where it is another.
        """
        check_kind("path", path, str | Path)
        if not Path(path).is_file():
            rule = "path must be a file that Learned.save wrote"
            raise ValueError(f"{rule}, got {path}, which is none")
        whole = io.BytesIO(Path(path).read_bytes())
        try:
            with np.load(whole, allow_pickle=False) as stored:
                arrays = dict(stored)
            about = json.loads(str(arrays.pop(ABOUT)))
            spec, settings = about.pop("q", None), about.pop("settings", None)
            about["settings"] = settings and _settings(settings)
            parts: dict[str, Any] = {name: torch.from_numpy(x) for name, x in arrays.items()}
            state = {x: parts.pop(x) for x in list(parts) if x.startswith(STATE)}
            about["state"] = {x.removeprefix(STATE): part for x, part in state.items()} or None
            learned = cls(**about, **parts)
        except Exception as error:  # what is not such a file may raise anything
            raise TornResult(f"{path} is not what Learned.save wrote") from error
        return attrs.evolve(learned, q=q if spec is None else from_description(spec, q))


def _plain(settings: Any) -> dict[str, Any]:
    """Settings as JSON takes them, with the name of their class."""
    parts = attrs.asdict(settings, recurse=False)
    fields = {k: _plain(x) if attrs.has(type(x)) else x for k, x in parts.items()}
    return {"kind": type(settings).__name__, **fields}


def _settings(plain: dict[str, Any]) -> Any:
    kinds, fields = {kind.__name__: kind for kind in KINDS}, dict(plain)
    kind = kinds[fields.pop("kind")]
    return kind(**{k: _settings(x) if isinstance(x, dict) else x for k, x in fields.items()})
