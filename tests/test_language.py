"""The check of the pages' language finds faults in prose, and reads no code."""

from __future__ import annotations

import pytest

pytest.importorskip("proselint")

PAGE = """---
kernelspec: very unique
---
# A page

{before} prose of $very unique$ `very unique` and
two lines.

```{{code-cell}} python3
x = "very unique"
```

```{{admonition}} The answer
:class: tip

{within} an answer.
```
"""


@pytest.fixture
def faults(extension):
    return lambda **words: list(extension("prose").faults("page.md", PAGE.format(**words)))


def test_good_prose_passes(faults):
    assert faults(before="Good", within="Here is") == []


@pytest.mark.parametrize("fault", ["A very unique", "Sought is", "Needless to say,"])
def test_a_fault_is_named_with_its_line(faults, fault):
    assert faults(before=fault, within="Here is")[0].startswith("page.md:6: ")
    assert faults(before="Good", within=fault)[0].startswith("page.md:16: ")


def test_the_pages_read_well(extension):
    prose = extension("prose")
    assert len(prose.PAGES) > 20
    assert not [line for page in prose.PAGES for line in prose.faults(page.name, page.read_text())]
