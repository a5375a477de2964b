"""The check of the pages' language finds faults in prose, and reads no code."""

import pytest

pytest.importorskip("proselint")

PAGE = """---
kernelspec: very unique
---
{} prose of $very unique$ `very unique` and
two lines.

```{{code-cell}} python3
---
caption: |
      {} caption.
---
x = "very unique"
```

```{{admonition}} The answer
:class: tip

{} an answer.
```
"""


@pytest.mark.parametrize("line", [4, 10, 18])
def test_a_fault_is_named_with_its_line_and_nothing_else_is_found(extension, line):
    words = {place: "A very unique" if place == line else "Here is" for place in (4, 10, 18)}
    faults = extension("prose").faults("page.md", PAGE.format(*words.values()))
    assert {fault.partition(": ")[0] for fault in faults} == {f"page.md:{line}"}
