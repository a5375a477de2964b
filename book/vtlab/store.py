"""Stored runs: one .npz of plain arrays and one .json of provenance, verified when they are read.

The .json is written last and holds the digest of the .npz: a pair is complete or absent, and a file
that was cut short or altered is noticed when it is read. The .json of a pool or an experiment also
holds its configuration, and the result is refused under another one.
"""

import hashlib
import io
import json
import os
import platform
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import attrs
import numpy as np
import torch
import xarray as xr
from attrs import NOTHING, Factory

from vtlab.experiment import SOURCES, TASKS, Experiment, Pool
from vtlib import native
from vtlib.checks import check_weights, one_line, shown
from vtlib.files import TornResult, write_bytes

Arrays = dict[str, np.ndarray]
Note = dict[str, Any]  # plain JSON values
# The fields that an experiment's targets depend on, and those that only its runs depend on.
OF_TASKS = ("family", "runs", "sources", "stream", "runs_per_task", "excluded")
OF_RUNS = ("iterations", "every", "visits", "probes", "each", "greedy")


def results_folder() -> Path:
    """Where stored runs lie: VTLIB_RESULTS, else book/results of a checkout, else ./results."""
    book = Path(__file__).resolve().parents[1] / "results"
    return Path(os.environ.get("VTLIB_RESULTS", book if book.is_dir() else "results"))


def check_writable(root: Path) -> None:
    """Make a folder for results unless it is there; OSError says why it cannot take any."""
    try:
        root.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=root).close()
    except OSError as error:
        raise OSError(f"results cannot be written to {root}: {error.strerror}") from error


def check_readable(root: Path) -> None:
    """Raise FileNotFoundError, and say what to do, unless there is a folder of results."""
    if not root.is_dir():
        raise FileNotFoundError(
            f"there is no folder {root}: the book's results are book/results of its repository; "
            "run in a checkout, or set VTLIB_RESULTS to that folder"
        )


def save(path: Path, arrays: Arrays, provenance: Note) -> None:
    """Write arrays to path.npz and provenance to path.json, each whole or not at all."""
    if objects := [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]:
        raise ValueError(f"{path} cannot hold objects, only plain arrays: {', '.join(objects)}")
    buffer = io.BytesIO()
    # NumPy's types know only the options among the names
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    note = {**provenance, "sha256": hashlib.sha256(data).hexdigest()}
    text = json.dumps(note, indent=1, sort_keys=True) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path.with_name(path.name + ".npz"), data)
    write_bytes(path.with_name(path.name + ".json"), text.encode())


def read(path: Path) -> tuple[Arrays, Note]:
    """Arrays and provenance of a stored result.

    Raises FileNotFoundError when there is none, TornResult when it is not what was written.
    """
    npz, note = path.with_name(path.name + ".npz"), path.with_name(path.name + ".json")
    if not note.exists():
        check_readable(results_folder())  # an installation has none
        raise FileNotFoundError(f"no stored result at {path}")
    try:
        provenance: Note = json.loads(note.read_text())
        data = npz.read_bytes()
        if hashlib.sha256(data).hexdigest() != provenance["sha256"]:
            raise TornResult(f"{npz} is not the file that was stored: its digest differs")
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return dict(arrays), provenance
    except TornResult:
        raise
    except Exception as error:  # a damaged file may raise anything
        raise TornResult(f"{path} cannot be read: {one_line(error)}") from error


def provenance(path: Path) -> Note:
    """The provenance of a stored result, whose arrays are not read."""
    note: Note = json.loads(path.with_name(path.name + ".json").read_text())
    return note


def exists(path: Path) -> bool:
    """Whether a complete result is stored at path."""
    return path.with_name(path.name + ".json").exists()


def remove(path: Path) -> None:
    """Delete a stored result, provenance first: without it arrays are never taken for a result."""
    for ending in (".json", ".npz"):
        path.with_name(path.name + ending).unlink(missing_ok=True)


def machine() -> dict[str, str]:
    """Versions and processor, and kernels: "none" without them."""
    without = {"kernels": "none"} if native.level() is None else {}
    return {
        **without,
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "system": f"{platform.system()} {platform.machine()}",
        "processor": _processor(),
    }


def _processor() -> str:
    """The processor's name and numbers: on rented machines several kinds have one name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().split("\n\n", 1)[0].splitlines()
    except OSError:
        lines = []
    facts = {name.strip(): value.strip() for name, _, value in (x.partition(":") for x in lines)}
    name = facts.get("model name", platform.processor() or "unknown")
    numbers = [facts[x] for x in ("cpu family", "model", "stepping") if x in facts]
    return f"{name} ({'/'.join(numbers)})" if numbers else name


def results_of(experiment: Experiment) -> list[tuple[Pool | Experiment, str]]:
    """The stored results behind an experiment, as owner and label: its pool's come first."""
    labels = [TASKS, *experiment.algorithms]
    return [(experiment.pool, SOURCES), *((experiment, label) for label in labels)]


def results_behind(experiments: Iterable[Experiment]) -> list[tuple[Pool | Experiment, str]]:
    """The stored results behind experiments, each once."""
    results = (result for experiment in experiments for result in results_of(experiment))
    return list({(owner.name, label): (owner, label) for owner, label in results}.values())


def path_of(owner: Pool | Experiment, label: str, root: Path | None = None) -> Path:
    """Where a result of a pool or experiment is stored, without the endings of its two files."""
    return (root or results_folder()) / owner.name / label


def origin(owner: Pool | Experiment, label: str) -> Note:
    """What the provenance of a result says of where it comes from, as plain JSON values."""
    seeds = f"SHA-256 of {owner.stream}/<run>/<role>"
    config = _plain({key: value for key, (value, _) in _entries(owner, label).items()})
    return {"owner": owner.name, "label": label, "seeds": seeds, "config": config}


def _entries(owner: Pool | Experiment, label: str) -> dict[str, tuple[Any, Any]]:
    """What a result depends on, each value with its default or NOTHING."""
    entries = _fields(owner)
    if isinstance(owner, Pool):
        return entries
    runs = label in owner.algorithms
    entries = {key: entries[key] for key in (*OF_TASKS, *(OF_RUNS if runs else ()))}
    entries["pool"] = owner.pool.name, NOTHING
    if runs:
        entries["sources"] = owner.sources_of(label), NOTHING
        entries["algorithm"] = owner.algorithms[label], NOTHING
    return entries


def _fields(thing: Any) -> dict[str, tuple[Any, Any]]:
    """The fields of an object of an attrs class, each value with its default or NOTHING."""
    fields = {}
    for field in attrs.fields(type(thing)):
        default = field.default
        if isinstance(default, Factory):  # type: ignore[arg-type]  # a class, to mypy a function
            default = default.factory(*([thing] if default.takes_self else []))
        plain = NOTHING if default is NOTHING else _plain(default)
        fields[field.name] = getattr(thing, field.name), plain
    return fields


def _plain(value: Any) -> Any:
    return json.loads(json.dumps(value, default=attrs.asdict))


def _differing(stored: object, entries: dict[str, tuple[Any, Any]]) -> list[str]:
    """The names of entries that are stored with another value; a key not stored has its default."""
    config = stored if isinstance(stored, dict) else {}
    wrong = [shown(key) for key in config if key not in entries]
    for key, (now, default) in entries.items():
        before = config.get(key, default)
        if attrs.has(type(now)) and isinstance(before, dict):
            wrong += [f"{key}.{name}" for name in _differing(before, _fields(now))]
        elif before is NOTHING or before != _plain(now):
            wrong.append(key)
    return wrong


def check_note(path: Path, note: Note, owner: Pool | Experiment, label: str) -> None:
    """Raise TornResult unless the provenance is of the owner's present configuration."""
    now, wrong = origin(owner, label), _differing(note.get("config"), _entries(owner, label))
    if wrong := wrong + [x for x in ("owner", "label", "seeds") if note.get(x) != now[x]]:
        raise TornResult(
            f"{path} was computed under another configuration, which differs in "
            f"{', '.join(wrong)}: move it away and run `python -m vtlab run` again"
        )


def stored(owner: Pool | Experiment, label: str, root: Path | None = None) -> tuple[Arrays, Note]:
    """Arrays and provenance of a result of a pool or experiment, as they lie in their files.

    Raises FileNotFoundError for a missing result, TornResult for a damaged one, or one that was
    computed under another configuration.
    """
    path = path_of(owner, label, root)
    arrays, note = read(path)
    check_note(path, note, owner, label)
    if bad := [x for x, a in arrays.items() if a.dtype.kind == "f" and not np.isfinite(a).all()]:
        raise TornResult(f"{path} has numbers that are not finite among its {', '.join(bad)}")
    return arrays, note


def load(owner: Pool | Experiment, label: str, root: Path | None = None) -> xr.Dataset:
    """A stored result of a pool ("sources") or experiment ("tasks", or an algorithm's label).

    Its first dimension is "source" or "run"; the second of what was recorded along the way is
    "iteration". The provenance is among its attributes. Raises as ``stored`` does.
    """
    arrays, note = stored(owner, label, root)
    if isinstance(owner, Pool):
        first, index, count, recorded = "source", "index", owner.count, None
    else:
        first, index, count, recorded = "run", "run", owner.runs, arrays.pop("iterations", None)
    coordinates = {first: arrays.pop(index, np.arange(count))}
    if recorded is not None:
        coordinates["iteration"] = recorded
    variables = {}
    for name, array in arrays.items():
        if array.shape[:1] != (count,):
            raise TornResult(f"{path_of(owner, label, root)} does not hold {count} {name}")
        rest = [f"{name}_{axis}" for axis in range(1, array.ndim)]
        along = recorded is not None and array.shape[1:2] == recorded.shape
        if along and name != "fingerprints":
            rest[0] = "iteration"
        variables[name] = ([first, *rest], array)
    return xr.Dataset(variables, coordinates, note)


def returns(experiment: Experiment, label: str, root: Path | None = None) -> xr.Dataset:
    """The stored runs of an algorithm as ``load`` gives them, and each run's planned optimum."""
    best = load(experiment, TASKS, root).optimum
    return load(experiment, label, root).assign(optimum=best)


def weights(pool: Pool, root: Path | None = None) -> np.ndarray:
    """The stored source weights (count, d) of a pool; ValueError when they are anything else."""
    found = stored(pool, SOURCES, root)[0].get("weights", np.zeros(0))
    name = f"weights of {pool.name}"
    check_weights(name, torch.from_numpy(found), pool.count, pool.family.q().d)
    return found
