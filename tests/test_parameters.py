"""The tables of appendix A: the thesis' numbers, from the configurations that run."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from html import unescape

import pytest

from vtlib.baselines import DDQNSettings, MellowTDSettings
from vtlib.envs.rooms import RoomsFamily
from vtlib.experiments import (
    EXPERIMENTS,
    ROOMS_CHANGE,
    ROOMS_DEVIATIONS,
    ROOMS_EVALUATION,
    ROOMS_EXPLORATION,
    ROOMS_LIKELIHOOD,
    ROOMS_SOURCES,
)
from vtlib.experiments.control import CAR, CARTPOLE
from vtlib.experiments.parameters import (
    ENVIRONMENTS,
    WORDS,
    doors,
    environment,
    learner_table,
    rooms_table,
    runs_table,
    shown,
    tables,
    transfer_table,
)
from vtlib.sources import NetworkPool
from vtlib.transfer import CLIP, PRIOR_JITTER, Settings

# Appendix A and chapter 6, entered by hand. Where the thesis says nothing, nothing is here.
TRANSFER = {
    "rooms": {
        "GVT": {"lambda_": 1e-4},
        "1-MGVT": {"lambda_": 1e-6, "sigma_p2": 1e-5},
        "3-MGVT": {"lambda_": 1e-6, "sigma_p2": 1e-5},
        "all": {"batch": 50, "buffer": 10_000, "weights": 10, "alpha_L": 0.1},
    },
    "cartpole": {
        "GVT": {},
        "1-MGVT": {"sigma_p2": 1e-5},
        "3-MGVT": {"sigma_p2": 1e-5},
        "all": {"lambda_": 1e-3, "batch": 500, "weights": 5, "alpha_L": 1e-4},
    },
    "mountain car": {
        "GVT": {},
        "1-MGVT": {"sigma_p2": 1e-5},
        "3-MGVT": {"sigma_p2": 1e-5},
        "all": {"lambda_": 1e-5, "batch": 500, "weights": 10, "alpha_L": 1e-4},
    },
    "mazes": {
        "GVT": {"alpha_L": 1e-7},
        "1-MGVT": {"alpha_L": 1e-6, "sigma_p2": 1e-5},
        "3-MGVT": {"alpha_L": 1e-6, "sigma_p2": 1e-5},
        "all": {"lambda_": 1e-6, "batch": 50, "buffer": 50_000, "weights": 10},
    },
}
EVERYWHERE = {"psi": 0.5, "gamma": 0.99, "alpha_mu": 1e-3, "sigma_min": 1e-4}
DDQN_CARTPOLE = {"batch": 150, "buffer": 50_000, "target_every": 500, "alpha": 1e-3}
DDQN_CAR = {"batch": 32, "buffer": 50_000, "target_every": 500, "alpha": 1e-3}
DDQN_MAZES = {"batch": 70, "buffer": 10_000, "target_every": 100, "alpha": 1e-3}
# Parameters of the thesis, and the share of the iterations over which epsilon falls.
LEARNERS = {
    ("rooms", "sources"): (
        MellowTDSettings,
        {"batch": 50, "buffer": 50_000, "psi": 0.5, "alpha": 1e-3, "epsilon_end": 0.02},
        0.7,
    ),
    ("cartpole", "sources"): (
        MellowTDSettings,
        {"batch": 150, "buffer": 50_000, "alpha": 1e-3},
        None,
    ),
    ("cartpole", "DDQN"): (DDQNSettings, DDQN_CARTPOLE, 0.35),
    ("mountain car", "sources"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mountain car", "DDQN"): (DDQNSettings, DDQN_CAR, 0.15),
    ("mazes", "sources"): (DDQNSettings, DDQN_MAZES, 0.1),
    ("mazes", "DDQN"): (DDQNSettings, DDQN_MAZES, 0.1),
}
# One hidden layer of 32 units from 4 numbers to 2, and so on; 121 bases for each of 4 actions.
WEIGHTS = {
    "rooms": 121 * 4,
    "cartpole": 5 * 32 + 33 * 2,
    "mountain car": 3 * 64 + 65 * 3,
    "mazes": 23 * 32 + 33 * 32 + 33 * 3,
}
POOLS = {"rooms": 50, "cartpole": 100, "mountain car": 50, "mazes": 20}


def cells(html: str) -> dict[str, list[str]]:
    """Text of the rows of a table, by their first cell; the head's row as ``parameter``."""
    rows = {}
    for row in re.findall(r"<tr>(.*?)</tr>", html):
        found = re.findall(r"<t[hd]>(.*?)</t[hd]>", row)
        first, *rest = [unescape(re.sub(r"<.*?>", "", cell)) for cell in found]
        rows[first] = rest
    return rows


def row(html: str, name: str) -> list[str]:
    """The cells of the row of the parameter of that name in vtlib."""
    return next(rest for first, rest in cells(html).items() if first.split()[-1] == name)


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_transfer_has_the_numbers_of_the_thesis(name: str):
    html = transfer_table(ENVIRONMENTS[name])
    labels = ["GVT", "1-MGVT", "3-MGVT"]
    assert cells(html)["parameter"] == [*labels, "from"]
    for at, label in enumerate(labels):
        settings = ENVIRONMENTS[name].transfer[label]
        expected = EVERYWHERE | TRANSFER[name]["all"] | TRANSFER[name][label]
        for parameter, value in expected.items():
            assert getattr(settings, parameter) == value, (label, parameter)
            assert row(html, parameter)[at] == shown(value)
            assert not row(html, parameter)[-1].startswith("open"), parameter
        assert settings.family == ("gaussian" if label == "GVT" else "mixture")
        assert (settings.components, settings.init, settings.act) == (
            3 if label == "3-MGVT" else 1,
            "sources",
            "step",
        )


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_what_the_thesis_leaves_open_is_marked(name: str):
    given = set(EVERYWHERE) | set(TRANSFER[name]["all"]) | {"lambda_", "alpha_L", "sigma_p2"}
    given |= {"components", "init", "act", "covariance"}
    html = transfer_table(ENVIRONMENTS[name])
    for parameter in WORDS["transfer"]:
        if parameter in ("jitter", "clip"):
            continue
        opened = row(html, parameter)[-1].startswith("open")
        assert opened == (parameter not in given), parameter


@pytest.mark.parametrize(("name", "label"), LEARNERS)
def test_learners_have_the_numbers_of_the_thesis(name: str, label: str):
    method, expected, share = LEARNERS[name, label]
    learner, iterations = ENVIRONMENTS[name].learners[label]
    html = learner_table(ENVIRONMENTS[name], label)
    assert type(learner) is method
    assert learner.gamma == 0.99
    for parameter, value in expected.items():
        assert getattr(learner, parameter) == value, parameter
        assert row(html, parameter)[0] == shown(value)
        assert not row(html, parameter)[-1].startswith("open"), parameter
    epsilon, origin = row(html, "epsilon_steps")
    if share is None:
        assert origin.startswith("open")
    else:
        assert learner.epsilon_steps / iterations == pytest.approx(share)
        assert epsilon == f"{learner.epsilon_steps:,} of {iterations:,} ({share:g})"
        assert not origin.startswith("open")


def test_the_rooms_without_transfer_are_the_sources_settings():
    (sources, long), (nt, short) = (ENVIRONMENTS["rooms"].learners[x] for x in ("sources", "NT"))
    assert replace(nt, epsilon_steps=sources.epsilon_steps) == sources
    assert nt.epsilon_steps / short == sources.epsilon_steps / long
    html = learner_table(ENVIRONMENTS["rooms"], "NT")
    assert row(html, "batch")[-1] == "open: as for the sources"


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_runs_and_pools_are_those_of_the_thesis(name: str):
    env = ENVIRONMENTS[name]
    html = runs_table(env)
    assert cells(html)["weights of the Q-function"][0] == f"{WEIGHTS[name]:,}"
    expected = ["20", *(("5", "20,000") if name == "mazes" else ("10", "10,000"))]
    assert [row(html, x)[0] for x in ("runs", "sources", "iterations")] == expected
    assert row(learner_table(env, "sources"), "count")[0] == str(POOLS[name])
    common = "common" in str(cells(learner_table(env, "sources")))
    assert common == isinstance(env.pool, NetworkPool)


@pytest.mark.parametrize("experiment", [ROOMS_EVALUATION, CARTPOLE, CAR], ids=lambda e: e.name)
def test_a_changed_configuration_changes_its_table(experiment):
    def made(**changes):
        return environment(replace(experiment, **changes), "A.1", "6.1", {})

    before = made()
    for label, parameter, value in (
        ("GVT", "lambda_", 0.125),
        ("1-MGVT", "alpha_mu", 0.25),
        ("3-MGVT", "weights", 77),
    ):
        other = replace(experiment.algorithms[label], **{parameter: value})
        after = made(algorithms={**experiment.algorithms, label: other})
        at = ["GVT", "1-MGVT", "3-MGVT"].index(label)
        assert row(transfer_table(after), parameter)[at] == f"{value:g}"
        assert row(transfer_table(before), parameter)[at] != f"{value:g}"
    settings = replace(experiment.pool.settings, batch=77)
    after = made(pool=replace(experiment.pool, settings=settings, limit=777_777))
    assert row(learner_table(after, "sources"), "batch")[0] == "77"
    assert row(learner_table(after, "sources"), "limit")[0] == "777,777"
    assert row(runs_table(made(runs=40)), "runs")[0] == "40"
    baseline = "NT" if "NT" in experiment.algorithms else "DDQN"
    other = replace(experiment.algorithms[baseline], alpha=0.5)
    after = made(algorithms={**experiment.algorithms, baseline: other})
    assert row(learner_table(after, baseline), "alpha")[0] == "0.5"
    assert tables(after)[:3] == tables(before)[:3]


def test_no_parameter_is_left_out():
    assert {f.name for f in fields(Settings)} - {"family"} <= set(WORDS["transfer"])
    for settings in (MellowTDSettings, DDQNSettings):
        assert {f.name for f in fields(settings)} <= set(WORDS["learner"])
    elsewhere = {"name", "family", "settings", "twin"}
    assert {f.name for f in fields(NetworkPool)} - elsewhere <= set(WORDS["pool"])


def test_constants_are_those_of_the_algorithm():
    found = cells(transfer_table(ENVIRONMENTS["rooms"]))
    assert found["bound on a gradient's entries"][:3] == [shown(CLIP)] * 3
    assert found["added to the variances of the prior"][:3] == [shown(PRIOR_JITTER), "–", "–"]
    assert row(transfer_table(ENVIRONMENTS["rooms"]), "sigma_p2")[0] == "–"


ALL_ROOMS = (ROOMS_EVALUATION, ROOMS_CHANGE, ROOMS_EXPLORATION, ROOMS_LIKELIHOOD, ROOMS_SOURCES)


def test_one_table_speaks_for_every_rooms_experiment():
    base = ENVIRONMENTS["rooms"]
    known = {replace(settings, components=1) for settings in base.transfer.values()}
    for experiment in EXPERIMENTS.values():
        if not isinstance(experiment.family, RoomsFamily) or "sliders" in experiment.name:
            continue
        if experiment is ROOMS_DEVIATIONS:  # these are there for what differs
            continue
        for label, algorithm in experiment.algorithms.items():
            if isinstance(algorithm, Settings):
                assert replace(algorithm, components=1, init="sources") in known, label
        assert experiment.pool.settings == base.learners["sources"][0]


def test_rooms_experiments_and_what_they_differ_in():
    found = cells(rooms_table(ALL_ROOMS))
    assert list(found)[1:] == [e.name for e in ALL_ROOMS]
    assert found["rooms-evaluation"] == [
        "3 rooms, doors uniform",
        "20: 3 rooms, doors uniform",
        "20",
        "10",
        "10,000",
    ]
    assert found["rooms-distribution-change"][0] == "3 rooms, lower door at 5, upper uniform"
    assert found["rooms-exploration"][1] == "20: 2 rooms, lower door at 5"
    assert found["rooms-likelihood"][1:3] == ["20: 2 rooms, doors normal(5, 1.8)", "400"]
    assert found["rooms-number-of-sources"][3:] == ["2 to 10", "1,950"]
    longer = cells(rooms_table([replace(ROOMS_EVALUATION, iterations=7, every=7)]))
    assert longer["rooms-evaluation"][-1] == "7"


def test_doors_in_words():
    assert doors(RoomsFamily(rooms=2)) == "2 rooms, doors uniform"
    assert doors(RoomsFamily(rooms=3, normal=(5.0, 1.8), fixed_lower=2.5)) == (
        "3 rooms, lower door at 2.5, upper normal(5, 1.8)"
    )


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (1e-4, "10⁻⁴"),
        (1e-3, "10⁻³"),
        (2e-4, "0.0002"),
        (0.1, "0.1"),
        (0.99, "0.99"),
        (1000.0, "1,000"),
        (50_000, "50,000"),
        ("step", "step"),
    ],
)
def test_values_are_written_for_readers(value, text: str):
    assert shown(value) == text


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_every_table_says_where_each_value_is_from(name: str):
    env = ENVIRONMENTS[name]
    made = tables(env)
    assert len(made) == 2 + len(env.learners)
    for html in made:
        head, *rows = cells(html).values()
        assert head[-1] == "from"
        assert all(len(rest) == len(head) and all(rest) for rest in rows)
        pattern = r"(open: .+|A\.\d.*|\d(\.\d)*|chapter \d|Algorithm 1, line \d)"
        assert all(re.fullmatch(pattern, rest[-1]) for rest in rows), rows
