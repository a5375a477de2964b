"""The README's example runs as it stands, and does what the README says of it."""

import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import torch

import vtlib
from vtlab.stats import difference_interval

# As the policy's network of Stable-Baselines3's DQN is, beside which the README's lines were tried.
NETWORK = torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.ReLU(), torch.nn.Linear(8, 2))

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_example_transfers(capsys, monkeypatch):
    returns, evaluate = [], vtlib.evaluate

    def recorded(*arguments):
        returns.append(evaluate(*arguments))
        return returns[-1]

    monkeypatch.setattr(vtlib, "evaluate", recorded)
    text = README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names = {}
    exec(compile(code, str(README), "exec"), names)
    earned = dict(zip(names["ways"], (x.mean(1).numpy() for x in returns), strict=True))
    means = [f"{name} {x.mean():.1f}, standard error" for name, x in earned.items()]
    shown = capsys.readouterr().out.splitlines()
    assert [line.rpartition(" ")[0] for line in shown[:7]] == means
    assert shown[7:] == str(names["learned"]).splitlines()
    # "All ways take as many steps"
    assert names["learned"].steps.tolist() == [1000] * 10
    # "earns as much as the best of them"
    ours, tuned, scratch = (earned[x] for x in ("transferred", "fine-tuned", "from scratch"))
    best = max((x for name, x in earned.items() if name.startswith("source")), key=np.mean)
    assert difference_interval(ours, best).high >= -0.5
    # "has to unlearn the first", and learning from scratch needs more steps
    assert difference_interval(ours, tuned).low > 0
    assert difference_interval(ours, scratch).low > 0
    # "after an episode each": the first two sources play one, and soon the others play all
    played = names["learned"].state["played"]
    assert all(((played == wrong).sum(1) == 1).all() for wrong in (0, 1))
    assert (played[:, 4:7] < 4).all()  # then the trial begins


def test_networks_of_stable_baselines3_are_sources():
    text = README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```text\n(q = ModuleQ.*?)```", text, re.DOTALL)
    model = SimpleNamespace(q_net=SimpleNamespace(q_net=NETWORK))
    names = {"models": [model, model], "envs": [gymnasium.make("CartPole-v1")], "torch": torch}
    names |= {"ModuleQ": vtlib.ModuleQ, "transfer": vtlib.transfer}
    exec(compile(code.replace("1000", "10"), str(README), "exec"), names)
    assert names["learned"].weights.shape[2] == sum(p.numel() for p in NETWORK.parameters())
