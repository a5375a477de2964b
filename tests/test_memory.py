"""How much memory the posteriors over large networks take."""

from __future__ import annotations

import gc
import json
from pathlib import Path

import pytest
import torch
from torch.profiler import ProfilerActivity, profile

from vtlib.experiments import MAZE_TARGETS
from vtlib.experiments.runs import prepare

TARGET = MAZE_TARGETS["north-east"]
LIMIT = 30e6  # bytes for each run and component
RUNS = 8


def peak(label: str, trace: Path) -> int:
    """The most bytes that tensors take at once, from when runs are made ready to their 20th step.

    What PyTorch's allocator counts; the system's numbers depend on how large its pages are.
    """
    weights = torch.randn(20, 1891, generator=torch.Generator().manual_seed(0)) / 10
    gc.collect()
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as seen:
        batch = prepare(TARGET, label, TARGET.algorithms[label], range(RUNS), weights.numpy())
        for _ in range(20):
            batch.advance()
    seen.export_chrome_trace(str(trace))
    events = json.loads(trace.read_text())["traceEvents"]
    events = sorted((e for e in events if e["name"] == "[memory]"), key=lambda e: e["ts"])
    taken = torch.tensor([event["args"]["Bytes"] for event in events])
    return int(taken.cumsum(0).max())


@pytest.mark.parametrize(("label", "components"), [("GVT", 1), ("1-MGVT", 1), ("3-MGVT", 3)])
def test_a_run_takes_less_than_30_megabytes_for_each_component(label, components, tmp_path):
    most = peak(label, tmp_path / "trace.json")
    assert 14e6 < most / (components * RUNS) < LIMIT
