"""The cells of an experiment's page: what a reader executes is what a reader sees."""

import ast
import builtins
import re
from pathlib import Path

import pytest
from attrs import frozen

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
FIRST, NUMBERS = 12, 5  # lines that the first cell and a cell of numbers may have


@frozen
class Cell:
    """A page's cell: its tags and its code."""

    tags: frozenset[str]
    source: str

    @property
    def tree(self) -> ast.Module:
        return ast.parse(self.source)

    @property
    def lines(self) -> int:
        """How many lines of code there are; blank ones and comments do not count."""
        return sum(bool(re.match(r"\s*[^#\s]", x)) for x in self.source.splitlines())

    def calls(self, method: str) -> int:
        """How often the cell calls a method of the page."""
        wanted = f"page.{method}"
        calls = [x.func for x in ast.walk(self.tree) if isinstance(x, ast.Call)]
        return sum(ast.unparse(x) == wanted for x in calls)


def cells_of(text: str) -> list[Cell]:
    """The cells of a page's source."""
    cells = []
    for whole in CELL.findall(text):
        head = (HEAD.match(whole) or [""])[0]
        tags = re.search(r"^:?tags: \[(.*)\]$", head, re.MULTILINE)
        cells.append(Cell(frozenset(tags[1].split(", ") if tags else ()), whole[len(head) :]))
    return cells


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
    cells = cells_of(text)
    first, found, made = cells[0], [], set()
    if first.tags or first.lines > FIRST:
        found.append(f"the first cell has {first.lines} lines and the tags {sorted(first.tags)}")
    for number, cell in enumerate(cells):
        if "remove-cell" in cell.tags:
            found.append(f"cell {number} is removed")
        if not cell.tags and (unseen := used(cell.tree) - made):
            found.append(f"cell {number} uses names that nobody sees made: {sorted(unseen)}")
        if not cell.tags & {"remove-cell", "remove-input"}:
            made |= bound(cell.tree)
        if cell.calls("say") and (cell.tags != {"hide-input"} or cell.lines > NUMBERS):
            found.append(f"cell {number} has numbers in {cell.lines} lines, {sorted(cell.tags)}")
    again = sum(cell.calls("rerun") for cell in cells if not cell.tags)
    if again != 1:
        found.append(f"{again} visible cells make the runs again")
    return found


@pytest.mark.parametrize("page", PAGES)
def test_a_reader_sees_what_is_executed(page):
    assert faults((BOOK / f"{page}.md").read_text(encoding="utf-8")) == []
