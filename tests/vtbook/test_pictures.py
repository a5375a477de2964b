"""Every moving formula of the pages: each slider changes the picture and is named in its text."""

from __future__ import annotations

import itertools
import re

import pytest

METHOD = ("collapse", "mellowmax", "psi", "gaussian-kl", "source-prior", "mixture-bound")
MOVING = [
    *[("background", name) for name in ("contraction", "td-bias", "elbo", "gibbs")],
    *[("method", name) for name in METHOD],
]
IMAGE = re.compile(r'<img alt="([^"]+)".* src="data:image/png;base64,([^"]+)">')


@pytest.mark.parametrize(("name", "figure"), MOVING)
def test_a_slider_changes_the_picture_and_the_text_that_names_it(cells_of, name: str, figure: str):
    axes, draw = cells_of(name)[f"fig-{figure}"]
    ends = [[axis.options[0][1], axis.options[-1][1]] for axis in axes]
    seen = {}
    for values in itertools.product(*ends):
        text, image = IMAGE.fullmatch(draw(*values)).groups()
        seen[text] = image
        for value in values:
            assert re.search(rf"[ =]({value:g}|{value:.2g})\b", text), (value, text)
    assert len(seen) == len(set(seen.values())) == 2 ** len(axes)
