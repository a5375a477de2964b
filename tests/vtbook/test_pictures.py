"""Every moving formula of the pages: each slider changes the picture and is named in its text."""

import re

import pytest

METHOD = ("collapse", "mellowmax", "psi", "gaussian-kl", "source-prior", "mixture-bound")
MOVING = [
    *[("background", name) for name in ("contraction", "td-bias", "elbo", "gibbs")],
    *[("method", name) for name in METHOD],
]
PNG = 'data:image/png;base64,([^"]+)"'
# for telephones, and for all others
PICTURE = re.compile(
    rf'<picture><source [^>]* srcset="{PNG}><img alt="([^"]+)"[^>]* src="{PNG}></picture>'
)


@pytest.mark.parametrize(("name", "figure"), MOVING)
def test_a_slider_changes_the_picture_and_the_text_that_names_it(cells_of, name, figure):
    axes, draw = cells_of(name)[f"fig-{figure}"]
    first, last = ([axis.options[i][1] for axis in axes] for i in (0, -1))
    seen = {}
    for moved in range(len(axes) + 1):  # from one end to the other, slider by slider
        values = last[:moved] + first[moved:]
        narrow, text, image = PICTURE.fullmatch(draw(*values)).groups()
        seen[text] = narrow, image
        for value in values:
            assert re.search(rf"[ =]({value:g}|{value:.2g})\b", text), (value, text)
    assert len(seen) == len(axes) + 1
    for pictures in zip(*seen.values(), strict=True):
        assert len(set(pictures)) == len(seen)
