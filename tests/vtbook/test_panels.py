"""What fills in a panel: files of the page, and a setup that cannot end its script."""

import json
import re

import pytest

from vtbook import panels


def test_a_panel_has_its_files_and_its_setup(tmp_path, monkeypatch):
    (tmp_path / "toy.html").write_text("<style>$style</style><script>$script($setup)</script>$word")
    (tmp_path / "toy.css").write_text("p { color: red }")
    (tmp_path / "toy.js").write_text("run")
    monkeypatch.setattr(panels, "STATIC", tmp_path)
    setup = {"text": "</script><b>", "numbers": [1, 2.5]}
    html = panels.panel("toy", setup, word="said")
    around = r"<style>p { color: red }</style><script>run\(([^<]*)\)</script>said"
    assert json.loads(re.fullmatch(around, html)[1]) == setup
    with pytest.raises(KeyError, match="word"):
        panels.panel("toy", setup)
