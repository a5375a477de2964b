"""The pages' sources: sections, boxes, symbols and names, and the shape of an experiment's."""

from __future__ import annotations

import pkgutil
import re
from pathlib import Path

import attrs
import pytest

from vtlib.transfer import Settings

BOOK = Path(__file__).resolve().parents[1] / "book"
# The thesis' table of contents, in its order; our headings of the same parts.
CONTENTS = {
    "introduction": "Contribution, Outline",
    "background": "Reinforcement learning and Markov decision processes, "
    "Value-based RL fundamentals, Variational inference, Bayesian inference and intractability, "
    "Evidence lower bound (ELBO), Inductive PAC-Bayesian learning overview",
    "setting": "Motivation, Designing a transfer algorithm, Related fields, Multitask learning, "
    "Learning to learn, Lifelong learning, Our setting",
    "related": "Hierarchical Bayesian multitask reinforcement learning, Hidden-parameter MDPs, "
    "Randomized value functions",
    "method": "Variational transfer algorithm, Modeling the likelihood, Variational approximation, "
    "Algorithm, TD error optimization, Practical implementations, Gaussian variational transfer, "
    "Mixture of Gaussians variational transfer",
    "conclusions": "Future work",
    "parameters": "The rooms problem, Classic control, Cartpole, Mountain car, Maze navigation",
}
EXPERIMENT_PAGES = [path.stem for path in BOOK.glob("rooms_*.md")]
EXPERIMENT_PAGES += ["cartpole", "mountain_car", "mazes"]
SHAPE = (
    "The claims, Would fine-tuning do as well?, Move the parameters, What the sources cost, "
    "An exercise, Limits, How it was computed"
)


def text_of(page: str) -> str:
    """A page's source."""
    return (BOOK / f"{page}.md").read_text(encoding="utf-8")


def words(prose: str) -> list[str]:
    """Words as a reader counts them: a number from code is one."""
    return re.findall(r"\S*\w\S*", re.sub(r"\{[a-z:]+\}`[^`]*`", "x", prose))


@pytest.mark.parametrize("page", [*CONTENTS, *EXPERIMENT_PAGES])
def test_every_section_has_its_place(page: str):
    wanted = CONTENTS.get(page, SHAPE).split(", ")
    headings = re.findall(r"^##+ (.*)$", text_of(page), re.MULTILINE)
    assert [heading for heading in headings if heading in wanted] == wanted


def test_definitions_theorems_and_the_algorithm_are_boxes():
    boxes = r"^:class: statement.*\n:name: (\S+)$"
    background, method = (
        re.findall(boxes, text_of(page), re.MULTILINE) for page in ("background", "method")
    )
    wanted = [f"definition-2-{i}" for i in (1, 2, 3)] + [f"theorem-2-{i}" for i in (1, 2, 3, 4)]
    assert sorted(background) == wanted
    assert sorted(method) == ["algorithm-1", "definition-5-1", "theorem-5-1"]


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
    lines = ["KL(q || p) of `mu`, lambda_ too (eq. 5.7).", "## Units"]
    lines += ["| a | b |", "| --- | --- |", "| 1 | `x` |", "end"]
    text = "\n".join(extension("api").converted(lines))
    assert "KL(q \\|\\| p) of ``mu``, lambda\\_ too (eq. :eq:`eq-5-7`)." in text
    assert "\n.. rubric:: Units\n" in text
    assert "   * - a\n     - b\n   * - 1\n     - ``x``\n" in text
    assert text.endswith("\nend\n")


@pytest.mark.parametrize("page", EXPERIMENT_PAGES)
def test_a_page_of_an_experiment_asks_answers_and_is_read_to_the_end(page: str):
    prose = re.sub(r"^```\{code-cell\}.*?^```$", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    assert re.search(r"^# .*\?$", prose, re.MULTILINE), "the title asks"
    assert len(words(prose)) < 2_000
    answer = re.search(r"```\{admonition\} The answer\n:class: tip\n(.*?)```", prose, re.DOTALL)[1]
    assert len(words(answer)) <= 60


GLOSSARY = text_of("glossary")
ROWS = [
    [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
    for line in re.findall(r"^\| (?!symbol|---).*", GLOSSARY, re.MULTILINE)
]


def test_every_symbol_has_a_meaning_and_a_name_that_exists():
    assert all(meaning for _, meaning, _, _ in ROWS)
    names = {name for row in ROWS for name in re.findall(r"`(.*?)`", row[-1])}
    settings = {f"Settings.{field}" for field in attrs.fields_dict(Settings)}
    assert names & settings
    for name in names - settings:
        assert pkgutil.resolve_name(f"vtlib.{name}") is not None, name


def test_every_acronym_of_the_thesis_is_explained_once():
    thesis = "MDP, GVT, MGVT, RL, SGD, TD, VT, DDQN, MLP, ReLU, ELBO, PAC, KL, MTL, BNN, LSVI, AI"
    terms = re.findall(r"^([A-Za-z]+)\n  [A-Z]", GLOSSARY, re.MULTILINE)
    assert set(thesis.split(", ")) <= set(terms)
    assert len(terms) == len(set(terms))
