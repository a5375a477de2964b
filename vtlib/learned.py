"""What was learned, as a thing to keep: it acts, and is saved and read."""

import io
import json
from pathlib import Path
from typing import Any, Self

import attrs
import numpy as np
import torch
from attrs import frozen
from torch import Tensor

from vtlib.checks import check_kind, check_whole, shown
from vtlib.files import TornResult, write_bytes
from vtlib.qfunctions import MLP, QFunction
from vtlib.trust import Trust

ABOUT = "about"  # the text beside the arrays of a file
STATE = "state "  # before the names of a state's arrays
ARRAYS = "weights", "iterations", "returns", "steps", "improved"
WORDS = "first_action", "interrupted"


@frozen(eq=False)
class Learned:
    """What R runs end with.

    weights (R, C, d): final weights, those of each component's mean for a posterior. iterations
    (T,) and returns (R, T): mean discounted return of the last 50 episodes, NaN before the first
    has ended. steps (R,): of the environment. improved (R,): whether the weights learned are kept;
    else they are the best source's (see ``transfer``). state: why ``Trust`` acted as it did, and
    all that it takes to go on (``Trusting.state``). interrupted: whether Ctrl-C ended it. q and
    settings are the call's; the environments' first action is first_action.
    """

    weights: Tensor
    iterations: Tensor
    returns: Tensor
    steps: Tensor
    improved: Tensor
    state: dict[str, Tensor] | None = None
    q: QFunction | None = None
    settings: Any = None
    first_action: int = 0
    interrupted: bool = False

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

    def predict(self, obs: Any, run: int = 0) -> int:
        """The greedy action at an observation (obs_dim,).

        The values of all components of a run are averaged, as by ``evaluate``, and actions are the
        environment's. Raises ValueError for what the Q-function cannot value.
        """
        check_kind("q", self.q, QFunction)
        check_whole("run", run, 0, len(self.weights) - 1)
        try:
            seen = torch.as_tensor(np.asarray(obs, np.float32))[None, None]
            if not bool(seen.isfinite().all()):
                raise ValueError("numbers that are not finite")
            values = self.q.q(self.weights[[run]], self.q.prepare(seen))  # type: ignore[union-attr]
        except Exception as error:  # a user's Q-function may raise anything
            fault = shown(str(error))
            raise ValueError(f"obs must be observations of q, got {shown(obs)}: {fault}") from error
        return int(values[0].mean(0).argmax()) + self.first_action

    def save(self, path: str | Path) -> None:
        """Write all but a module, and settings other than of ``Trust``, to one .npz, at once."""
        arrays = {name: getattr(self, name).numpy() for name in ARRAYS}
        arrays |= {STATE + name: part.numpy() for name, part in (self.state or {}).items()}
        about = {
            "sizes": self.q.sizes if isinstance(self.q, MLP) else None,
            "settings": attrs.asdict(self.settings) if isinstance(self.settings, Trust) else None,
            **{name: getattr(self, name) for name in WORDS},
        }
        arrays[ABOUT] = np.array(json.dumps(about))
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **arrays)
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        write_bytes(Path(path), buffer.getvalue())

    @classmethod
    def load(cls, path: str | Path, q: QFunction | None = None) -> Self:
        """What was saved; TornResult names a file that is not whole or holds something else.

        q: needed for a module or a Q-function of one's own; ValueError where it is another.
        """
        whole = io.BytesIO(Path(path).read_bytes())
        try:
            with np.load(whole, allow_pickle=False) as stored:
                arrays = dict(stored)
            about = json.loads(str(arrays.pop(ABOUT)))
            sizes, settings = about.pop("sizes"), about.pop("settings")
            parts: dict[str, Any] = {name: torch.from_numpy(x) for name, x in arrays.items()}
            state = {x.removeprefix(STATE): parts.pop(x) for x in [*parts] if x.startswith(STATE)}
            learned = cls(
                **parts,
                **about,
                state=state or None,
                q=MLP(sizes) if q is None and sizes else q,
                settings=settings and Trust(**settings),
            )
        except Exception as error:  # what is not such a file may raise anything
            raise TornResult(f"{path} is not what Learned.save wrote") from error
        if q is not None and getattr(q, "d", None) != (d := learned.weights.shape[2]):
            raise ValueError(f"q must be a Q-function of {d} weights, got {shown(q)}")
        return learned
