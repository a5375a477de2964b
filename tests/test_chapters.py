"""The pages' sources: sections, boxes, symbols and names, and the shape of an experiment's."""

import pkgutil
import re
from pathlib import Path

import attrs
import pytest

from vtlib.transfer import Settings

BOOK = Path(__file__).resolve().parents[1] / "book"
PAGES = {path.stem: path.read_text(encoding="utf-8") for path in BOOK.glob("*.md")}
EXPERIMENTS = [name for name in PAGES if name.startswith("rooms_")]
EXPERIMENTS += ["cartpole", "mountain_car", "mazes"]
SHAPE = """The claims, Would fine-tuning do as well?, Move the parameters, What the sources cost,
    Limits, An exercise, How it was computed"""
# The thesis' table of contents, in its order; our headings of the same parts.
CONTENTS = {
    "introduction": "Contribution, Outline",
    "background": """Reinforcement learning and Markov decision processes,
        Value-based RL fundamentals, Variational inference, Bayesian inference and intractability,
        Evidence lower bound (ELBO), Inductive PAC-Bayesian learning overview""",
    "setting": """Motivation, Designing a transfer algorithm, Related fields, Multitask learning,
        Learning to learn, Lifelong learning, Our setting""",
    "related": """Hierarchical Bayesian multitask reinforcement learning, Hidden-parameter MDPs,
        Randomized value functions""",
    "method": """Variational transfer algorithm, Modeling the likelihood, Variational approximation,
        Algorithm, TD error optimization, Practical implementations, Gaussian variational transfer,
        Mixture of Gaussians variational transfer""",
    "conclusions": "Future work",
    "parameters": "The rooms problem, Classic control, Cartpole, Mountain car, Maze navigation",
    **dict.fromkeys(EXPERIMENTS, SHAPE),
}


def words(prose: str) -> int:
    """How many a reader counts: a number from code is one."""
    return len(re.findall(r"\S*\w\S*", re.sub(r"\{[a-z:]+\}`[^`]*`", "x", prose)))


@pytest.mark.parametrize("page", CONTENTS)
def test_every_section_has_its_place(page):
    wanted = re.split(r",\s+", CONTENTS[page])
    headings = re.findall(r"^##+ (.*)$", PAGES[page], re.MULTILINE)
    assert [heading for heading in headings if heading in wanted] == wanted


def test_the_reference_has_every_module_once(extension):
    api = extension("api")
    listed = [
        name
        for page in PAGES
        if page.startswith("api_")
        for patterns in api.MODULES.findall(PAGES[page])
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


@pytest.mark.parametrize("page", EXPERIMENTS)
def test_a_page_of_an_experiment_asks_answers_and_is_read_to_the_end(page):
    cells = re.compile(r"^```\{code-cell\}.*?^```$", re.DOTALL | re.MULTILINE)
    prose = cells.sub("", PAGES[page])
    assert re.search(r"^# .*\?$", prose, re.MULTILINE), "the title asks"
    assert words(prose) < 2_000
    answer = re.search(r"```\{admonition\} The answer\n:class: tip\n(.*?)```", prose, re.DOTALL)[1]
    assert words(answer) <= 60


def test_every_symbol_has_a_meaning_and_a_name_that_exists():
    lines = re.findall(r"^\| (?!symbol|---).*", PAGES["glossary"], re.MULTILINE)
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]
    assert all(meaning.strip() for _, meaning, _, _ in rows)
    names = {name for row in rows for name in re.findall(r"`(.*?)`", row[-1])}
    settings = {f"Settings.{field}" for field in attrs.fields_dict(Settings)}
    assert names & settings
    for name in names - settings:
        assert pkgutil.resolve_name(f"vtlib.{name}") is not None, name
