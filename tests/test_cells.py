"""The cells of an experiment's page: what a reader executes is what a reader sees."""

import ast
import builtins
import re
from pathlib import Path

import pytest

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = (
    "rooms_evaluation",
    "rooms_distribution_change",
    "rooms_exploration",
    "rooms_likelihood",
    "rooms_number_of_sources",
    "cartpole",
    "mountain_car",
    "mazes",
)
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
HEAD = re.compile(r"\A---\n.*?\n---\n|\A(?::[^\n]*\n)+", re.DOTALL)  # as YAML, or lines of options


def bound(tree: ast.Module) -> set[str]:
    """The names that code makes, wherever in it that is."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
            names.add(node.id)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.arg):
            names.add(node.arg)
        elif isinstance(node, ast.alias):
            names.add(node.asname or node.name.partition(".")[0])
    return names


def used(tree: ast.Module) -> set[str]:
    """The names that code reads and does not make itself."""
    loads = {x.id for x in ast.walk(tree) if isinstance(x, ast.Name) and x.id not in dir(builtins)}
    return loads - bound(tree)


def faults(text: str) -> list[str]:
    """What a page's cells do that a reader cannot see or repeat."""
    found, made, again = [], set(), 0
    for number, whole in enumerate(CELL.findall(text)):
        head = (HEAD.match(whole) or [""])[0]
        tree, visible = ast.parse(whole[len(head) :]), "tags:" not in head
        if "remove-cell" in head:
            found.append(f"cell {number} is removed")
        if visible and (unseen := used(tree) - made):
            found.append(f"cell {number} uses names that nobody sees made: {sorted(unseen)}")
        if "remove-input" not in head:
            made |= bound(tree)
        again += "page.rerun(" in whole
    return [*found, *[f"{again} cells make the runs again"] * (again != 1)]


@pytest.mark.parametrize("page", PAGES)
def test_a_reader_sees_what_is_executed(page):
    assert faults((BOOK / f"{page}.md").read_text(encoding="utf-8")) == []
