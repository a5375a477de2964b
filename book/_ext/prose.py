"""Check the language of the pages with proselint, and for turns of phrase that this book avoids.

``python book/_ext/prose.py`` names file, line and what is wrong. Code, formulas and names in
backticks are no prose and are blanked out beforehand, line by line, so that a fault keeps its line.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from proselint.checks import __register__
from proselint.config import DEFAULT, Config
from proselint.registry import CheckRegistry
from proselint.tools import LintFile

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    *sorted((ROOT / "book").glob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
)
FRONT = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
FENCE = re.compile(r"^\s*(`{3,}|:{3,})(.*)$")
# Directives whose content is no prose; that of the others, and of colon fences, is read.
CODE = ("{code-cell}", "{literalinclude}", "{bibliography}", "{toctree}", "{raw}")
CAPTION = " " * 6  # what stands so far to the right in a cell's settings is read
INLINE = re.compile(
    r"<!--.*?-->|\$\$.*?\$\$|\$[^$]+\$|\]\([^)]*\)|\{[a-z:]+\}`[^`]*`|`[^`]+`", re.DOTALL
)
# Checks of proselint that are not made, each with its reason.
EXCEPTIONS = {
    "typography.symbols.curly_quotes": "quotes are typed straight, and Sphinx curls them",
    "lexical_illusions": "finds words repeated over the formulas that are blanked out",
    "dates_times.dates.dash_and_from": "takes numbers in a sentence for years",
    "typography.symbols.ellipsis": "finds the dots of lists such as 0.5, 1, ..., 9.5",
    "cliches.misc.write_good": "'trial and error' is what this learning is called",
}
RIDDLES = {
    r"\bSought (is|are)\b": "begin with who seeks",
    r"\bFurther down\b": "link to the place",
    r"^(Hence|Thus) an? ": "a sentence needs a verb",
    r"\b(is|are|was) no (model|prediction|refinement|likelihood)s?\b": "write 'not a'",
    r"\b(it|that) goes without saying\b": "leave it out",
    r"\bpart(s)? (here|there) in\b": "write 'differ'",
    r"\bby and by\b": "write 'gradually'",
    r"\bof its own accord\b": "write 'by itself'",
    r"\b(the likes of|whereto|whereof|wherein|thereof)\b": "use plain words",
    r"\b(obviously|needless to say|of course|simply put)\b": "leave it out",
}


def space(found: re.Match[str]) -> str:
    """Spaces as long as what was found, with its lines."""
    return re.sub(r"\S", " ", found[0])


def without_code(lines: list[str]) -> Iterator[str]:
    """Lines without fenced code but for its captions, and without fences around prose."""
    closing, header = "", False  # of the code that is skipped; whether its settings stand here
    for line in lines:
        fence = FENCE.match(line)
        if closing:
            closing = "" if line.strip() == closing else closing
            header ^= line == "---"
            yield line.strip() if header and line.startswith(CAPTION) else ""
        elif fence or re.match(r":[a-z-]+:", line):
            info = fence[2].strip() if fence else ""
            # a bare fence in a page's prose ends a directive; code names its language
            if fence and fence[1][0] == "`" and info and (info[0] != "{" or info.startswith(CODE)):
                closing = fence[1]
            yield ""
        else:
            yield line


def blanked(text: str) -> str:
    """The text without all that is no prose, on as many lines."""
    lines = FRONT.sub(space, text).split("\n")
    return INLINE.sub(space, "\n".join(without_code(lines)))


def riddles(text: str) -> Iterator[tuple[int, str]]:
    """Line and advice for each turn of phrase to avoid, also where it runs over a line's end."""
    for pattern, advice in RIDDLES.items():
        spaced = pattern.replace(" ", r"\s+")
        for found in re.finditer(spaced, text, re.IGNORECASE | re.MULTILINE):
            yield text.count("\n", 0, found.start()) + 1, f"'{found[0]}': {advice}"


def faults(name: str, text: str) -> Iterator[str]:
    """What is wrong with a text, as lines 'name:line: check: advice'."""
    prose = blanked(text)
    yield from (f"{name}:{line}: riddle: {advice}" for line, advice in riddles(prose))
    registry = CheckRegistry()
    if not registry.checks:
        registry.register_many(__register__)
    squeezed = "\n".join(re.sub(r"  +", " ", line).strip() for line in prose.split("\n"))
    for found in LintFile(name, squeezed).lint(Config(max_errors=1000, checks=DEFAULT["checks"])):
        result = found.check_result
        if result.check_path not in EXCEPTIONS:
            yield f"{name}:{found.pos[0]}: {result.check_path}: {result.message}"


def main() -> int:
    """Print what is wrong with the pages; 1 if anything is."""
    found = [
        line for page in PAGES for line in faults(str(page.relative_to(ROOT)), page.read_text())
    ]
    print("\n".join(found) or f"{len(PAGES)} pages read well")
    return bool(found)


if __name__ == "__main__":
    raise SystemExit(main())
