"""What fills in a panel: a setup that cannot end its script."""

import json

from bs4 import BeautifulSoup

from vtbook import panels


def test_a_setup_reaches_the_script_whatever_it_says():
    setup = {"text": "</script><b>", "numbers": [1, 2.5]}
    html = panels.panel("race", setup, iterations=1, shown="1", squares="", alt="")
    told = BeautifulSoup(html, "html.parser").select_one("script[type='application/json']")
    assert json.loads(told.string) == setup
