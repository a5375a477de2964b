"""Whole runs computed anew, and every number that is stored of them beside its own.

Learning is chaotic. Where the arithmetic may round otherwise than that of the stored run, rounding
sends a run elsewhere sooner or later; up to there its numbers are the stored ones.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vtlab import sources, store
from vtlab.experiment import TASKS, Experiment, Pool
from vtlab.permutation import same_distribution_p
from vtlab.run import by_kernels
from vtlab.schedule import Unit, compute, joined, shared_by_all, units_of
from vtlib import native
from vtlib.checks import check_whole
from vtlib.rng import generator
from vtlib.training import FINGERPRINTS

# Two machines round differently; what any change of the method, the seeds or the tasks does is
# larger by orders of magnitude.
RELATIVE = 1e-3
ABSOLUTE = 1e-3
TIES = 2  # evaluations that rounding may change, where two actions are worth the same
EARNED = "learning", "greedy"
LEVEL = 0.01  # how often `reproduce` calls alike runs different; for one result `verify` a tenth
DRAWS = 1_000_000  # where 10,000 leave it open whether a p value is below a level
TRAINED = ("weights", "iterations", "greedy", "solved", "fresh", "passes")  # what sources end with


class Whole(NamedTuple):
    """What members (runs or sources) are, computed anew, beside what is stored of them.

    alike: in every number, up to RELATIVE and ABSOLUTE. parted: alike up to the iteration named,
    where rounding sends them elsewhere. wrong: what differs first, for another reason.
    """

    alike: list[int]
    parted: dict[int, int]
    wrong: dict[int, str]


class Difference(NamedTuple):
    """The first number of an array that differs, at its iteration (0 if of none), and how many."""

    iteration: int
    key: str
    stored: object
    anew: object
    places: int = 1

    def __str__(self) -> str:
        at = f" at iteration {self.iteration}" if self.iteration else ""
        return f"{self.key}{at} is {_short(self.stored)}, anew {_short(self.anew)}"


def _short(value: object) -> str:
    return f"{value:.7g}" if isinstance(value, np.floating) else str(value)


def count_of(owner: Pool | Experiment) -> int:
    """How many members each result of an owner has."""
    return owner.count if isinstance(owner, Pool) else owner.runs


def members_of(owner: Pool | Experiment, members: Sequence[int] | None = None) -> list[int]:
    """Some members in order, each once, or all; ValueError unless the owner's results have them."""
    chosen = range(count_of(owner)) if members is None else members
    for member in chosen:
        check_whole("member", member, 0, count_of(owner) - 1)
    return sorted(set(chosen))


def verify(
    *experiments: Experiment, root: Path | None = None, rng: np.random.Generator | None = None
) -> Iterator[tuple[Pool | Experiment, str, Whole]]:
    """Compute every stored result behind experiments anew, or of each one member that rng draws."""
    for owner, label in store.results_behind(experiments):
        members = None if rng is None else [int(rng.integers(count_of(owner)))]
        yield owner, label, check_runs(owner, label, members, root)


def check_runs(
    owner: Pool | Experiment,
    label: str,
    members: Sequence[int] | None = None,
    root: Path | None = None,
) -> Whole:
    """Compute members of a stored result anew, or all, and compare all that is stored of them.

    Raises as ``store.stored`` does, and ValueError unless members are among those of the result.
    """
    stored, chosen = store.stored(owner, label, root), members_of(owner, members)
    given = None if isinstance(owner, Pool) else store.weights(owner.pool, root)
    computed = _computed(owner, label, chosen, given)
    found = compare_runs(owner, label, stored, computed, chosen)
    if isinstance(owner, Pool) or not found.parted:
        return found
    there, here = list(found.parted), np.searchsorted(chosen, list(found.parted))
    old, new = ({k: x[k][at] for k in EARNED} for x, at in ((stored[0], there), (computed, here)))
    said, p, _ = together(old, new, EARNED, "verify")
    wrong = dict.fromkeys(there, said)
    return Whole(found.alike, {}, found.wrong | wrong) if p < LEVEL / 10 else found


def together(
    stored: store.Arrays, anew: store.Arrays, keys: Sequence[str], name: str
) -> tuple[str, float, float]:
    """What parted members earn, in words, a P value that it could be exchanged, and its least.

    Tested are the means and the last returns (Bonferroni).
    """
    said, p = [], []
    for key in keys:
        a, b = (np.asarray(x[key], float).reshape(len(x[key]), -1) for x in (stored, anew))
        said.append(f"{key} {a.mean():.4f} stored, {b.mean():.4f} anew")
        for x, y in ((a.mean(1), b.mean(1)), (a[:, -1], b[:, -1])):
            p.append(_p_value(x, y, f"{name}/{key}"))
    return "; ".join(said), min(1.0, len(p) * min(p)), len(p) * 2.0 ** (1 - len(a))


def _p_value(a: np.ndarray, b: np.ndarray, name: str) -> float:
    """P value of the hypothesis that stored and new runs could be exchanged; 1 with one run."""
    if len(a) < 2:
        return 1.0
    p = same_distribution_p(a, b, generator(name, 0, "comparison"))
    return p if p > LEVEL else same_distribution_p(a, b, generator(name, 1, "comparison"), DRAWS)


def _computed(
    owner: Pool | Experiment, label: str, members: list[int], given: np.ndarray | None
) -> store.Arrays:
    """The arrays of members, computed as for the store: alone by the kernels, else in batches."""
    units = units_with(owner, label, members)
    arrays = joined([compute(unit, given)[0] for unit in units])
    rows = np.flatnonzero(np.isin([member for unit in units for member in unit.members], members))
    shared = shared_by_all(arrays)
    return {key: array if key in shared else array[rows] for key, array in arrays.items()}


def units_with(owner: Pool | Experiment, label: str, members: Sequence[int]) -> list[Unit]:
    """The units that members of a result are stored from: alone by the kernels, else batches."""
    if isinstance(owner, Experiment) and by_kernels(owner, label):
        return [Unit(owner, label, members)]
    chosen = set(members)
    return [u for u in units_of(owner) if u.label == label and not chosen.isdisjoint(u.members)]


def expected_seconds(owner: Pool | Experiment, label: str, member: int) -> float:
    """What a member of a result takes to compute anew, by the clock of those that are stored."""
    return sum(unit.expected_seconds for unit in units_with(owner, label, [member]))


def compare_runs(
    owner: Pool | Experiment,
    label: str,
    stored: tuple[store.Arrays, store.Note],
    computed: store.Arrays,
    members: Sequence[int],
    machine: Mapping[str, str] | None = None,
) -> Whole:
    """A stored result beside arrays of some of its members, computed anew, here or on a machine."""
    (arrays, note), machine = stored, machine or store.machine()
    rounds = _rounds_otherwise(owner, label, note, machine)
    found = Whole([], {}, {})
    for row, member in enumerate(members):
        differs = differences(arrays, computed, member, row, count_of(owner))
        # what kernels learn torch evaluates, which rounds by the processor
        may_part = rounds or (_only_ties(differs) and _elsewhere(note, machine))
        until = _parted(owner, member, arrays, differs) if differs and may_part else None
        if not differs:
            found.alike.append(member)
        elif until is None:
            found.wrong[member] = str(min(differs, key=lambda x: x.iteration))
        else:
            found.parted[member] = until
    return found


def _rounds_otherwise(
    owner: Pool | Experiment, label: str, note: store.Note, machine: Mapping[str, str]
) -> bool:
    """Whether a machine may round otherwise than that on which a result was computed."""
    elsewhere = _elsewhere(note, machine)
    if label == TASKS or elsewhere is None:
        return False
    if not elsewhere:
        # what kernels computed, torch computes where none are compiled
        return native.level() is None and "device" not in machine and _has_kernel(owner)
    if "device" in machine or isinstance(owner, Pool) or not by_kernels(owner, label):
        return True
    # kernels that fuse products and sums round alike, but a Gaussian's first factor is LAPACK's
    gaussian = getattr(owner.algorithms[label], "family", None) == "gaussian"
    return gaussian or native.level() in (None, "baseline")


def _elsewhere(note: store.Note, machine: Mapping[str, str]) -> bool | None:
    """Whether a result was computed on another processor or device; None if it does not say."""
    there = note.get("machine")
    if not isinstance(there, dict) or there.get("processor") is None:
        return None
    return any(there.get(part) != machine.get(part) for part in ("processor", "device"))


def _has_kernel(owner: Pool | Experiment) -> bool:
    """Whether kernels, where they are compiled, may compute results of an owner."""
    if isinstance(owner, Pool) or owner.visits or owner.probe:
        return False
    return bool(owner.family.kernel)


def differences(
    stored: store.Arrays, computed: store.Arrays, member: int, row: int, count: int
) -> list[Difference]:
    """Where a member, one of ``count``, is not what is in its row of those computed anew."""
    found, shared = [], shared_by_all(computed)
    for key in sorted(stored.keys() | computed.keys()):
        if key not in stored or key not in computed:
            before, now = ("missing", "there") if key in computed else ("there", "missing")
            found.append(Difference(0, key, before, now))
            continue
        old, new = stored[key], computed[key]
        shape = new.shape if key in shared else (count, *new.shape[1:])
        if (old.shape, old.dtype.kind) != (shape, new.dtype.kind):
            found.append(Difference(0, key, f"{old.dtype}{old.shape}", f"{new.dtype}{shape}"))
            continue
        if key not in shared:
            old, new = old[member], new[row]
        near = partial(np.isclose, rtol=RELATIVE, atol=ABSOLUTE, equal_nan=True)
        wrong = np.argwhere(~(near if new.dtype.kind == "f" else np.equal)(old, new))
        if len(wrong):
            first = tuple(wrong[0])
            at = _iteration(key, old.shape[:1], first, computed) if key not in shared else 0
            found.append(Difference(at, key, old[first], new[first], len(wrong)))
    return found


def _iteration(
    key: str, length: tuple[int, ...], place: tuple[int, ...], computed: store.Arrays
) -> int:
    """The iteration that a place along an array belongs to; 0 if to none."""
    if key == "fingerprints":
        return FINGERPRINTS[place[0]]
    if not shared_by_all(computed):
        return 0
    recorded = computed["iterations"]
    if length == recorded.shape:
        return int(recorded[place[0]])
    return int(place[0]) + 1 if length == (recorded[-1],) else 0


def _only_ties(differs: Sequence[Difference]) -> bool:
    """Whether nothing but evaluations differ, and so few that rounding decided between actions."""
    return all(x.key == "greedy" and x.places <= TIES for x in differs)


def _parted(
    owner: Pool | Experiment, member: int, stored: store.Arrays, differs: Sequence[Difference]
) -> int | None:
    """Up to which iteration rounding explains what differs of a member; None if it does not."""
    by_key = {x.key: x for x in differs}
    prints = by_key.get("fingerprints")
    first = min((x.iteration for x in differs if x.iteration), default=0)
    if prints and prints.iteration <= FINGERPRINTS[0]:
        return None
    if stored.keys() == {"fingerprints"}:  # of heads nothing else is known
        return first - 1
    if isinstance(owner, Pool):
        if by_key.keys() - {"fingerprints", *TRAINED}:
            return None
        given = stored["weights"][[member]], stored["optimum"][[member]]
        earned = sources.judge(owner, [member], *given)
        same = all(np.allclose(v, stored[k][member], RELATIVE, ABSOLUTE) for k, v in earned.items())
        known = first - 1 if first else FINGERPRINTS[-1]
        check: Any = by_key.get("greedy")
        tie = check and abs(check.stored - check.anew) * owner.episodes <= TIES * given[1][0]
        return known if same and ("weights" in by_key or (tie and len(by_key) == 1)) else None
    if _only_ties(differs):
        return first - 1
    learning = by_key.get("learning")
    begins = learning.iteration if learning else first  # a tie may come before
    if any(not x.iteration for x in differs) or (begins <= FINGERPRINTS[-1] and not prints):
        return None
    if learning is None:  # nothing follows from an evaluation, nor from where the last steps led
        late = by_key.keys() == {"visited"} and first > owner.iterations - 2 * owner.every
        # returns that stay the same, as where the goal is never reached, show nothing
        rest = stored["learning"][member][stored["iterations"] >= first]
        silent = np.allclose(rest, rest[-1], RELATIVE, ABSOLUTE)
        return first - 1 if late or silent else None
    last = first > owner.iterations - owner.every
    return first - 1 if last or learning.places > 1 else None
