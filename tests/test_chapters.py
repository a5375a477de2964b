"""The chapters' sources against the thesis: sections, equations, boxes, and the code they name."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
BOOK = ROOT / "book"

# The thesis' table of contents, in its order; our headings of the same parts.
CONTENTS = {
    "introduction": ("Contribution", "Outline"),
    "background": (
        "Reinforcement learning and Markov decision processes",
        "Value-based RL fundamentals",
        "Variational inference",
        "Bayesian inference and intractability",
        "Evidence lower bound (ELBO)",
        "Inductive PAC-Bayesian learning overview",
    ),
    "setting": (
        "Motivation",
        "Designing a transfer algorithm",
        "Related fields",
        "Multitask learning",
        "Learning to learn",
        "Lifelong learning",
        "Our setting",
    ),
    "related": (
        "Hierarchical Bayesian multitask reinforcement learning",
        "Hidden-parameter MDPs",
        "Randomized value functions",
    ),
    "method": (
        "Variational transfer algorithm",
        "Modeling the likelihood",
        "Variational approximation",
        "Algorithm",
        "TD error optimization",
        "Practical implementations",
        "Gaussian variational transfer",
        "Mixture of Gaussians variational transfer",
    ),
    "conclusions": ("Future work",),
    "parameters": (
        "The rooms problem",
        "Classic control",
        "Cartpole",
        "Mountain car",
        "Maze navigation",
    ),
}
NUMBERED = [f"eq-2-{i}" for i in range(1, 24)] + [f"eq-5-{i}" for i in range(1, 16)]
BOXES = {
    "background": [f"definition-2-{i}" for i in (1, 2, 3)]
    + [f"theorem-2-{i}" for i in (1, 2, 3, 4)],
    "method": ["algorithm-1", "definition-5-1", "theorem-5-1"],
}


def text_of(page: str) -> str:
    """A page's source."""
    return (BOOK / f"{page}.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", CONTENTS)
def test_every_section_of_the_thesis_has_its_place(page: str):
    headings = re.findall(r"^##+ (.*)$", text_of(page), re.MULTILINE)
    wanted = [heading for heading in headings if heading in CONTENTS[page]]
    assert wanted == list(CONTENTS[page])


def test_the_equations_are_those_of_the_thesis_and_in_its_order(extension):
    assert list(extension("equations").formulas()) == NUMBERED


@pytest.mark.parametrize("page", BOXES)
def test_definitions_theorems_and_the_algorithm_are_boxes(page: str):
    boxes = re.findall(r"^:class: statement.*\n:name: (\S+)$", text_of(page), re.MULTILINE)
    assert sorted(boxes) == BOXES[page]


def test_the_functions_named_under_equations_exist(extension):
    equations = extension("equations").EQUATIONS
    assert set(equations) <= set(NUMBERED)
    for names in equations.values():
        for name in names:
            found = pkgutil.resolve_name(f"vtlib.{name}")
            assert callable(found), name
            assert found.__doc__, name


def test_the_reference_has_every_module_once(extension):
    api = extension("api")
    listed = [
        name
        for page in sorted(BOOK.glob("api_*.md"))
        for patterns in api.MODULES.findall(page.read_text(encoding="utf-8"))
        for name in api.matching(patterns)
    ]
    assert sorted(listed) == [name for name in api.modules() if name != "vtlib"]


def test_docstrings_become_what_sphinx_reads(extension):
    lines = [
        "The `mu` of KL(q || p), lambda_ too (eq. 5.7).",
        "## Units",
        "| a | b |",
        "| --- | --- |",
    ]
    text = "\n".join(extension("api").converted([*lines, "| 1 | `x` |", "end"]))
    assert "The ``mu`` of KL(q \\|\\| p), lambda\\_ too (eq. :eq:`eq-5-7`)." in text
    assert "\n.. rubric:: Units\n" in text
    assert "   * - a\n     - b\n   * - 1\n     - ``x``\n" in text
    assert text.endswith("\nend\n")


def test_the_way_to_cite_is_that_of_the_citation_file():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    for key in ("title", "version"):
        value = re.search(rf'^{key}: "?(.*?)"?$', citation, re.MULTILINE)[1]
        assert f"{{{value}}}" in text_of("index"), key


EXPERIMENT_PAGES = [
    "rooms_evaluation",
    "rooms_distribution_change",
    "rooms_exploration",
    "rooms_likelihood",
    "rooms_number_of_sources",
    "cartpole",
    "mountain_car",
    "mazes",
]
SHAPE = [
    "The claims",
    "Would fine-tuning do as well?",
    "Move the parameters",
    "What the sources cost",
    "An exercise",
    "Limits",
    "How it was computed",
]


@pytest.mark.parametrize("page", EXPERIMENT_PAGES)
def test_pages_of_experiments_have_one_shape_and_are_read_to_the_end(page: str):
    prose = re.sub(r"^```\{code-cell\}.*?^```$", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^## (.*)$", prose, re.MULTILINE)
    assert [x for x in headings if x in SHAPE] == SHAPE
    assert re.search(r"^# .*\?$", prose, re.MULTILINE), "the title asks"
    assert len(words(prose)) < 2_000
    answer = re.search(r"```\{admonition\} The answer\n:class: tip\n(.*?)```", prose, re.DOTALL)[1]
    assert len(words(answer)) <= 60


def words(prose: str) -> list[str]:
    """Words as a reader counts them: a number from code is one."""
    return re.findall(r"\S*\w\S*", re.sub(r"\{[a-z:]+\}`[^`]*`", "x", prose))
