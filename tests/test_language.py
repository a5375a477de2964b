"""The check of the pages' language finds faults in prose, and reads no code."""

import pytest

pytest.importorskip("proselint")

PAGE = """---
kernelspec: very unique
---
{} prose of $very unique$ `very unique` and
two lines.

```{{code-cell}} python3
x = "very unique"
```

```{{admonition}} The answer
:class: tip

{} an answer.
```
"""


@pytest.mark.parametrize("fault", ["A very unique", "Sought is", "Needless to say,"])
def test_a_fault_is_named_with_its_line_and_nothing_else_is_found(extension, fault):
    for line, words in ((4, (fault, "Here is")), (14, ("Good", fault))):
        found = extension("prose").faults("page.md", PAGE.format(*words))
        assert {one.partition(": ")[0] for one in found} == {f"page.md:{line}"}
