"""The experiments that installed packages offer to the command line."""

import functools
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from vtlab.experiment import Experiment
from vtlib.checks import shown


@functools.cache
def installed() -> Mapping[str, Mapping[str, Experiment]]:
    """Collections of experiments, each a mapping, which packages offer as "vtlab.experiments"."""
    return {entry.name: entry.load() for entry in entry_points(group="vtlab.experiments")}


def catalogue() -> dict[str, Experiment]:
    """All experiments that installed packages offer, by their names."""
    return {name: e for offered in installed().values() for name, e in offered.items()}


def named(name: str) -> list[Experiment]:
    """The experiments that a name stands for, of one or of a collection; ValueError for none."""
    if name in installed():
        return list(installed()[name].values())
    if name not in catalogue():
        near = " or ".join(get_close_matches(name, catalogue()) or installed())
        raise ValueError(f"unknown experiment {shown(name)}, {near} perhaps; run --help lists all")
    return [catalogue()[name]]


@functools.cache
def checks() -> Mapping[str, Callable[[Path, np.random.Generator | None], int]]:
    """Checks that `verify` calls, too, by name, which packages offer as "vtlab.checks".

    Each counts the results in a folder that are wrong, among all or among those a generator draws.
    """
    return {entry.name: entry.load() for entry in entry_points(group="vtlab.checks")}
