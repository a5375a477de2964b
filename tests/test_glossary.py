"""The glossary: every name of the library that it gives exists, every symbol has a meaning."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import attrs
import pytest

from vtlib.transfer import Settings

TEXT = (Path(__file__).resolve().parents[1] / "book" / "glossary.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
    for line in TEXT.splitlines()
    if line.startswith("| ") and not line.startswith(("| symbol", "| ---"))
]
NAMES = sorted({name for row in ROWS for name in re.findall(r"`(.*?)`", row[-1])})
TERMS = re.findall(r"^([A-Za-z]+)\n  [A-Z]", TEXT, re.MULTILINE)


def find(name: str) -> object:
    """What a dotted name below vtlib stands for."""
    if name.startswith("Settings."):
        return getattr(attrs.fields(Settings), name.removeprefix("Settings."))
    return pkgutil.resolve_name(f"vtlib.{name}")


@pytest.mark.parametrize("name", NAMES)
def test_a_name_in_the_library_exists(name: str):
    assert find(name) is not None


def test_every_symbol_has_a_meaning_and_a_place():
    assert len(ROWS) > 40
    for symbol, meaning, place, _ in ROWS:
        assert symbol.startswith("$") or meaning == "upper bound on the divergence"
        assert meaning
        assert re.fullmatch(r"(A|\d(\.\d)*|\(\d\.\d+\))(, (A|\d(\.\d)*|\(\d\.\d+\)))*", place)


def test_every_acronym_of_the_thesis_is_explained():
    thesis = "MDP, GVT, MGVT, RL, SGD, TD, VT, DDQN, MLP, ReLU, ELBO, PAC, KL, MTL, BNN, LSVI, AI"
    assert set(thesis.split(", ")) <= set(TERMS)
    assert len(TERMS) == len(set(TERMS))
