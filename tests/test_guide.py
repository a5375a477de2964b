"""The guide's stored runs are what its script computes."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest
import torch

from vtlib.experiments import store
from vtlib.gym_runs import evaluate

SCRIPT = Path(__file__).resolve().parents[1] / "book" / "_ext" / "guide_runs.py"
_spec = spec_from_file_location("guide_runs", SCRIPT)
assert _spec is not None
assert _spec.loader is not None
guide_runs = module_from_spec(_spec)
_spec.loader.exec_module(guide_runs)


@pytest.mark.parametrize("place", ["within", "outside"])
@pytest.mark.parametrize("name", guide_runs.KINDS)
def test_every_task_has_twenty_runs_of_each_way(name, place):
    found, note = store.read(guide_runs.FOLDER / f"{name}-{place}")
    assert note["seed"] == guide_runs.SEED
    for way in ("from nothing", "best source", "fine-tuned", "transfer", "improved", "steps"):
        assert found[way].shape == (20,)
        assert np.isfinite(found[way]).all()
    best = found["sources"].mean(1).argmax()
    np.testing.assert_array_equal(found["best source"], found["sources"][best])


def test_the_stored_sources_earn_again_what_is_stored():
    kind = guide_runs.KINDS["windy-grid"]
    weights = torch.from_numpy(store.read(guide_runs.FOLDER / "windy-grid-sources")[0]["weights"])
    envs = [kind.make(kind.within) for _ in range(guide_runs.RUNS)]
    found, _ = store.read(guide_runs.FOLDER / "windy-grid-within")
    earned = evaluate(envs, kind.q, weights[:1].expand(20, 1, -1), seed=guide_runs.SEED).mean(1)
    # rounding on another processor may turn an episode, but not the mean
    assert earned.mean() == pytest.approx(found["sources"][0].mean(), abs=0.1)


def test_what_is_stored_is_not_computed_again(monkeypatch, capsys):
    monkeypatch.setattr(guide_runs, "judge", None)
    monkeypatch.setattr("sys.argv", ["guide_runs.py"])
    guide_runs.main()
    assert capsys.readouterr().out == ""
