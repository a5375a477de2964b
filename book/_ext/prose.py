"""Check the language of the pages with proselint.

``python book/_ext/prose.py`` names file, line and what is wrong. Code and formulas are no prose.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from markdown_it.renderer import RendererHTML
from myst_parser.config.main import MdParserConfig
from myst_parser.parsers.mdit import create_md_parser
from proselint.checks import __register__
from proselint.config import DEFAULT, Config
from proselint.registry import CheckRegistry
from proselint.tools import LintFile

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted((ROOT / "book").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
SYNTAX = MdParserConfig(enable_extensions={"amsmath", "attrs_inline", "colon_fence", "dollarmath"})
PARSER = create_md_parser(SYNTAX, RendererHTML)
CheckRegistry().register_many(__register__)
# What other directives hold is prose, and so are the captions in the settings of cells.
CODE = ("{literalinclude}", "{bibliography}", "{toctree}", "{raw}", "{eval-rst}")
# Checks of proselint that are not made, each with its reason.
EXCEPTIONS = {
    "typography.symbols.curly_quotes": "quotes are typed straight, and Sphinx curls them",
    "lexical_illusions": "finds words repeated over the formulas that are left out",
    "dates_times.dates.dash_and_from": "takes numbers in a sentence for years",
    "typography.symbols.ellipsis": "finds the dots of lists such as 0.5, 1, ..., 9.5",
    "cliches.misc.write_good": "'trial and error' is what this learning is called",
}


def prose(text: str, first: int = 1) -> Iterator[tuple[int, str]]:
    """The prose of a page, piece by piece, with the line of each."""
    for token in PARSER.parse(text):
        line = first + token.map[0] if token.map else first
        name = token.info.split(" ")[0]
        if token.type == "inline":
            for child in token.children:
                line += child.type == "softbreak"
                yield line, child.content if child.type == "text" else ""
        elif name == "{code-cell}":
            settings = token.content.split("---\n")[1:2]
            yield from prose(re.sub(r"^ +", "", "".join(settings), flags=re.MULTILINE), line + 2)
        elif name.startswith("{") and name not in CODE:
            yield from prose(token.content, line + 1)


def faults(name: str, text: str) -> Iterator[str]:
    """What is wrong with a text, as lines 'name:line: check: advice'."""
    lines = [""] * (text.count("\n") + 1)
    for line, piece in prose(text):
        lines[line - 1] += piece
    squeezed = re.sub(r"  +", " ", "\n".join(lines))
    for fault in LintFile(name, squeezed).lint(Config(max_errors=1000, checks=DEFAULT["checks"])):
        result = fault.check_result
        if result.check_path not in EXCEPTIONS:
            yield f"{name}:{fault.pos[0]}: {result.check_path}: {result.message}"


def main() -> int:
    """Print what is wrong with the pages; 1 if anything is."""
    lines = [
        line for page in PAGES for line in faults(str(page.relative_to(ROOT)), page.read_text())
    ]
    print("\n".join(lines) or f"{len(PAGES)} pages read well")
    return bool(lines)


if __name__ == "__main__":
    raise SystemExit(main())
