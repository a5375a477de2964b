"""MyST as plain Markdown: what the pages use is filled in, and nothing else is let through."""

import pytest

TEXTS = {
    ("glue:text", "share"): "91%",
    ("doc", "mazes"): "[Mazes](06.08-mazes.ipynb)",
    ("term", "mellow TD"): "mellow TD",
    ("eq", "eq-5-2"): "(5.2)",
    ("doc", "the next page <mazes>"): "[the next page](06.08-mazes.ipynb)",
}
NUMBERS = {"tab-one": "Table 6.1", "fig-one": "Figure 6.2", "eq-5-2": "5.2", "lst": "Listing 5.1"}
MACROS = {"E": r"\mathbb{E}", "KL": r"\mathrm{KL}"}


@pytest.fixture
def plain(extension):
    module = extension("plain_markdown")
    link = lambda role, content: TEXTS[role, content]  # noqa: E731
    filling = module.Filling(link, NUMBERS.__getitem__, lambda path: f"# {path}\n", MACROS)
    return lambda text: module.plain(text, filling)


@pytest.mark.parametrize(
    ("myst", "markdown"),
    [
        (
            "By {eq}`eq-5-2`, see {doc}`the next\npage <mazes>`.",
            "By (5.2), see [the next page](06.08-mazes.ipynb).",
        ),
        (r"$\E[x] + \KL(q) + \Eps$", r"$\mathbb{E}[x] + \mathrm{KL}(q) + \Eps$"),
        ("(the-place)=\n## A place", "## A place"),
        (
            "```{admonition} The answer\n:class: tip\n\nYes, {glue:text}`share`.\n```",
            "> **The answer**\n>\n> Yes, 91%.",
        ),
        (
            ":::{admonition} Solution\n:class: dropdown\n\nNo.\n:::",
            "<details><summary>Solution</summary>\n\nNo.\n\n</details>",
        ),
        (
            ":::{table} One.\n:name: tab-one\n\n| a |\n| --- |\n:::",
            "**Table 6.1.** One.\n\n| a |\n| --- |",
        ),
        (
            "```{glossary}\n:sorted:\n\nDDQN\n  Learns\n  twice.\n\nVT\n  {term}`mellow TD`.\n```",
            "**DDQN** Learns twice.\n\n**VT** mellow TD.",
        ),
        (
            "```{literalinclude} a.py\n:language: python\n:name: lst\n:caption: All.\n```",
            "**Listing 5.1.** All.\n\n```python\n# a.py\n```",
        ),
        (
            ":::::{admonition} Outer\n\nwhere $a +\nb$\n\n"
            "::::{admonition} Inner\n\n$$\nx\n= y\n$$ (eq-5-2)\n::::\n:::::",
            "> **Outer**\n>\n> where $a + b$\n>\n> > **Inner**\n> >\n> > $$ x = y \\tag{5.2} $$",
        ),
        ("5. [Draw $s$]{.in-2}", "5. " + "&nbsp;" * 8 + "Draw $s$"),
        ("1. So\n\n   $$\n   x\n   $$ (eq-5-2)", "1. So\n\n   $$\n   x\n   \\tag{5.2}\n   $$"),
        ("```python\nprint(1)\n```", "```python\nprint(1)\n```"),
    ],
)
def test_what_the_pages_use_reads_as_in_the_book(plain, myst, markdown):
    assert plain(myst) == markdown


def test_a_directive_that_is_not_known_is_an_error(plain):
    with pytest.raises(ValueError, match="do not know the directive 'bibliography'"):
        plain("```{bibliography}\n```")
