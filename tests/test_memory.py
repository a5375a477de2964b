"""How much memory the posteriors over large networks take."""

import gc
import json

import pytest
import torch
from torch.profiler import ProfilerActivity, profile

from vtlib.qfunctions import MLP
from vtlib.replay import Transition
from vtlib.rng import Rng
from vtlib.transfer import Settings


@pytest.mark.parametrize(
    ("settings", "runs"), [(Settings("gaussian"), 4), (Settings(components=3), 2)]
)
def test_a_run_takes_less_than_30_megabytes_for_each_component(settings, runs, tmp_path):
    # What PyTorch's allocator counts, from an agent's beginning to its 10th step; the system's
    # numbers depend on how large its pages are.
    q, g = MLP((22, 32, 32, 3)), torch.Generator().manual_seed(0)
    sources, obs = (torch.randn(runs, *size, generator=g) for size in ((10, q.d), (22,)))
    flags = torch.zeros(runs, dtype=torch.bool)
    gc.collect()
    with profile(activities=[ProfilerActivity.CPU], profile_memory=True) as seen:
        agent = settings.agent(q, sources / 10, 22, Rng("memory", range(runs)))
        for _ in range(10):
            action = agent.act(obs, flags)
            agent.learn(Transition(obs, action, torch.ones(runs), obs, flags))
    seen.export_chrome_trace(str(tmp_path / "trace.json"))
    events = json.loads((tmp_path / "trace.json").read_text())["traceEvents"]
    events = sorted((e for e in events if e["name"] == "[memory]"), key=lambda e: e["ts"])
    taken = torch.tensor([event["args"]["Bytes"] for event in events]).cumsum(0).max()
    # of which the triangle of L alone takes 7.1
    assert 7.1e6 < int(taken) / (settings.components * runs) < 30e6
