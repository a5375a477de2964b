"""Three hundred wrong calls of the front door: each is refused in one line that helps."""

import math
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
import torch

import vtlib
from vtlib import MLP, FineTuning, Learned, MellowTDSettings, ModuleQ, Settings, Trust

Q, CALLS, PAIR = MLP((4, 3, 2)), 300, [1, 2]
WORDS = (" must ", "must be", "needs ")
ODD = [None, "x", -1, 2.5, math.nan, math.inf, True, [], {}, 1j, b"x", object(), np.ones((2, 3))]
ODD += [torch.ones(3), torch.full((1, 1, Q.d), math.nan), torch.ones(1, 1, Q.d).double(), len, int]
ODD += [10**5000, "a\nb", (), [None], PAIR, np.array("x"), torch.nn.Linear(4, 2), Settings]


def learned():
    runs, none = torch.ones(1), torch.empty(0, dtype=torch.int64)
    parts = torch.ones(1, 1, Q.d), none, torch.empty(1, 0), runs.long(), runs.bool()
    return Learned(*parts, q=Q, settings=Trust())


def calls():
    """Functions of the front door, each with arguments that are good."""
    envs, sources = [gym.make("CartPole-v1")], torch.ones(2, Q.d)
    weights = torch.ones(1, 1, Q.d)
    counts = {"episodes": 1, "gamma": 0.9, "seed": 0}
    learning = {"iterations": 1, "seed": 0, "callback": None}
    return [
        (
            vtlib.solve,
            {"envs": envs, "q": Q, "settings": MellowTDSettings(1), "trials": 0, **learning},
        ),
        (
            vtlib.transfer,
            {"envs": envs, "q": Q, "sources": sources, "settings": Trust(), **learning},
        ),
        (vtlib.evaluate, {"envs": envs, "q": Q, "weights": weights, **counts}),
        (vtlib.resume, {"learned": learned(), "envs": envs, "iterations": 1, "callback": None}),
        (learned().predict, {"obs": np.zeros(4), "run": 0}),
        (learned().values, {"obs": np.zeros(4), "run": 0}),
        (MLP, {"sizes": (4, 2)}),
        (ModuleQ, {"module": torch.nn.Linear(4, 2), "n_actions": 2}),
        (Trust, {"components": 3, "updates": 4, "gamma": 0.9}),
        (Settings, {"family": "mixture", "components": 1, "gamma": 0.9, "n_samples": 3}),
        (FineTuning, {"learner": MellowTDSettings(1), "start": "one"}),
        (Learned.load, {"path": "nothing.npz"}),
        (learned().save, {"path": "/dev/null/x"}),
    ]


GOOD = {  # what is odd elsewhere, and right here
    "settings": (None,),
    "callback": (None, len, int, Settings),
    "sizes": (PAIR,),
    "module": [x for x in ODD if isinstance(x, torch.nn.Module)],
}


def wrong_calls():
    """Calls with one argument that is wrong, drawn with a seed."""
    rng, found = np.random.default_rng(0), []
    while len(found) < CALLS:
        function, arguments = calls()[rng.integers(len(calls()))]
        name = str(rng.choice([*arguments]))
        value = ODD[rng.integers(len(ODD))]
        if any(value is good for good in GOOD.get(name, ())):
            continue
        if name == "path":
            value = [None, 3, [], 2.5][rng.integers(4)]
        found.append((name, value, partial(function, **{**arguments, name: value})))
    return found


def test_wrong_calls_are_refused_in_one_line_with_name_rule_and_value():
    faults = []
    for name, value, call in wrong_calls():
        try:
            call()
        except (ValueError, TypeError) as error:
            text = str(error)
            good = name in text and any(x in text for x in WORDS) and "got" in text
            if not (good and text.isprintable() and len(text) < 600):
                faults.append(f"{call.func.__name__}({name}={type(value)}): {text}")
        except Exception as error:
            faults.append(f"{call.func.__name__}({name}={type(value)}): {error!r}")
        else:
            faults.append(f"{call.func.__name__}({name}={type(value)} {str(value)[:20]}): accepted")
    if faults:
        pytest.fail("\n".join(sorted(set(faults))))
