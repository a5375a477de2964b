"""The guide's stored runs are what its script computes."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from attrs import evolve
from torch import nn

from vtbook import guide_runs as runs
from vtlab import store
from vtlab.cli import main
from vtlib.qfunctions import MLP, ModuleQ

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "book" / "results" / runs.NAME


def test_every_task_has_all_runs_of_each_way():
    for name in (f"{kind}-{place}" for kind in runs.KINDS for place in ("within", "outside")):
        arrays, _ = store.read(FOLDER / name)
        for way in ("from nothing", "best source", "fine-tuned", "transfer", "improved", "steps"):
            assert arrays[way].shape == (runs.RUNS,)
            assert np.isfinite(arrays[way]).all()
        best = arrays["sources"].mean(1).argmax()
        np.testing.assert_array_equal(arrays["best source"], arrays["sources"][best])


@pytest.mark.parametrize(
    ("losses", "verdict"), [((1, 1), "holds"), ((3, 3.1), "fails"), ((0, 9), "undecided")]
)
def test_transfer_may_lose_two_percent_of_the_way_from_the_worst_to_the_best(losses, verdict):
    best = np.array([90.0, 110.0])
    arrays = {"from nothing": best - 100, "best source": best, "transfer": best - losses}
    arrays["fine-tuned"] = best
    assert runs.verdict(arrays, "best source") == verdict


def test_nothing_is_decided_where_no_way_earns_anything():
    nothing = dict.fromkeys(runs.WAYS, np.zeros(2))
    assert runs.verdict(nothing, "fine-tuned") == "undecided"


def test_sources_earn_again_what_is_stored(monkeypatch):
    kind = evolve(runs.KINDS["cartpole"], learning=1)  # nothing that rounding can send elsewhere
    monkeypatch.setitem(runs.KINDS, "cartpole", kind)
    assert not {"sources", "best source"} & {*runs.differing("cartpole-outside", FOLDER, 4)}


def test_learning_that_was_interrupted_ends_the_command_and_is_not_stored(monkeypatch, tmp_path):
    monkeypatch.setattr(runs, "solve", lambda *_, **__: SimpleNamespace(interrupted=True))
    monkeypatch.setattr(store, "results_folder", lambda: tmp_path)
    assert main(["guide"]) == 130
    assert not list(tmp_path.rglob("*.npz"))


def test_a_forged_number_is_named(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(runs.KINDS, "frozen-lake", evolve(runs.KINDS["frozen-lake"], learning=100))
    root, folder, task = tmp_path, tmp_path / runs.NAME, "frozen-lake-within"
    assert main(["verify", "guide", "--results", str(root)]) == 2  # it has none
    folder.mkdir()
    for ending in ("npz", "json"):
        shutil.copy(FOLDER / f"frozen-lake-sources.{ending}", folder)
    arrays = runs.computed(task, folder, 2)
    monkeypatch.setattr(runs, "computed", lambda *_, **__: arrays)
    monkeypatch.setattr(runs, "TASKS", [task])
    runs.complete([task], folder)
    _, note = store.read(folder / task)
    assert main(["verify", "guide", "--results", str(root)]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"guide/{task}: verified"
    for key, array in arrays.items():
        forged, first = array.copy(), array[..., 0]
        by = {"b": True, "i": 1, "f": 0.1}[array.dtype.kind]
        forged[..., 0] = first ^ by if by is True else first + by
        for stored in (forged, np.concatenate([array, array], -1)):
            store.remove(folder / task)
            store.save(folder / task, arrays | {key: stored}, note)
            assert main(["verify", "guide", "--whole", "--results", str(root)]) == 1
            assert capsys.readouterr().out.splitlines() == [f"guide/{task}: DIFFERS in {key}"]


@pytest.mark.parametrize(
    "q", [MLP((4, 8, 2)), ModuleQ(nn.Sequential(nn.Linear(4, 8), nn.ReLU(), nn.Linear(8, 2)), 2)]
)
def test_promises_are_lowered_as_the_page_says(q):
    g = torch.Generator().manual_seed(0)
    sources, too_high = torch.randn(3, q.d, generator=g), torch.tensor([1.0, 20.0, -5.0])
    obs = q.prepare(torch.randn(1, 6, 4, generator=g))
    before = q.q(sources[None], obs)
    line = "mended[:, -q.n_actions :] -= (promised - earned).clamp(min=0)[:, None]"
    assert line in (ROOT / "book" / "guide.md").read_text()
    exec(line, {"mended": sources, "q": q, "promised": too_high, "earned": torch.zeros(3)})
    lower = before - too_high.clamp(min=0).view(1, 3, 1, 1)
    torch.testing.assert_close(q.q(sources[None], obs), lower)
