"""Which stored runs have been computed anew, whole: when, up to where, on what processor.

A line belongs to the file whose digest it bears, so what is stored anew begins without any.
"""

import csv
import datetime
import io
from collections.abc import Sequence
from pathlib import Path

from vtlib.experiments import store
from vtlib.experiments.experiment import Experiment, Pool
from vtlib.experiments.whole import Whole, count_of

NAME = "recomputed.csv"
FIELDS = ("result", "member", "alike_until", "date", "processor", "sha256")
END = "end"

Line = dict[str, str]


def record(owner: Pool | Experiment, label: str, whole: Whole, root: Path) -> None:
    """Note of the members of a result that they were computed anew today, on this machine."""
    digest = store.provenance(store.path_of(owner, label, root))["sha256"]
    here = datetime.date.today().isoformat(), store.machine()["processor"], digest
    lines = {(line["result"], line["member"]): line for line in _read(root)}
    for member, until in [*((m, END) for m in whole.alike), *whole.parted.items()]:
        key = f"{owner.name}/{label}", str(member)
        old = lines.get(key, {})
        # up to its end is more than up to where rounding parted it
        if until == END or (old.get("alike_until"), old.get("sha256")) != (END, digest):
            lines[key] = dict(zip(FIELDS, (*key, str(until), *here), strict=True))
    text = io.StringIO()
    writer = csv.DictWriter(text, FIELDS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines[key] for key in sorted(lines, key=lambda key: (key[0], int(key[1]))))
    store.write_bytes(root / NAME, text.getvalue().encode())


def recorded(
    results: Sequence[tuple[Pool | Experiment, str]], root: Path | None = None
) -> list[Line]:
    """The lines that belong to results as they are stored now; none where nothing was noted."""
    known: dict[tuple[str, str], str] = {}
    for owner, label in results:
        digest = store.provenance(store.path_of(owner, label, root))["sha256"]
        known |= {(f"{owner.name}/{label}", str(m)): digest for m in range(count_of(owner))}
    lines = _read(root or store.results_folder())
    return [x for x in lines if known.get((x["result"], x["member"])) == x["sha256"]]


def _read(root: Path) -> list[Line]:
    path = root / NAME
    if not path.exists():
        return []
    with path.open(newline="") as file:
        lines = list(csv.DictReader(file))
    if any(line.keys() != set(FIELDS) or None in line.values() for line in lines):
        raise store.TornResult(f"{path} is not what was written: lines need {', '.join(FIELDS)}")
    if len({(line["result"], line["member"]) for line in lines}) < len(lines):
        raise store.TornResult(f"{path} is not what was written: a member of a result comes twice")
    return lines
