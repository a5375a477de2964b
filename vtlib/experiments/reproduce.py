"""Everything from nothing, in a folder of its own, compared with what is stored."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vtlib import store
from vtlib.experiments.verify import results_of
from vtlib.experiments.work import complete, load_result


def reproduce(names: list[str], root: Path, fresh: Path, jobs: int) -> list[str]:
    """Compute the named experiments under ``fresh``, resuming there; one line per result."""
    for name in names:
        complete(name, fresh, jobs)
    pairs = dict.fromkeys(pair for name in names for pair in results_of(name))
    return [_compare(owner, label, root, fresh) for owner, label in pairs]


def _compare(owner: str, label: str, root: Path, fresh: Path) -> str:
    new, note = load_result(owner, label, fresh)
    head = f"{owner}/{label}: {note['seconds']:.0f} s, "
    if not store.exists(root / owner / label):
        return head + "nothing stored to compare with"
    old, _ = load_result(owner, label, root)
    if store.same_arrays(old, new):
        return head + "identical"
    key = "greedy" if "greedy" in new else "optimum"
    a, b = (_last(x[key]).mean() for x in (old, new))
    return head + f"final {key} {a:.4f} stored, {b:.4f} computed anew"


def _last(values: np.ndarray) -> np.ndarray:
    """The last recorded value of each run."""
    return np.asarray(values, dtype=np.float64).reshape(len(values), -1)[:, -1]
