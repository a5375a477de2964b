"""The README's example runs as it stands, and does what the README says of it."""

import re
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import torch

import vtlib
from vtlib.stats import difference_interval, mean_interval

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
    earned = dict(zip(names["weights"], (x.mean(1).numpy() for x in returns), strict=True))
    printed = [f"{name} {mean_interval(x)}" for name, x in earned.items()]
    assert capsys.readouterr().out.splitlines() == printed
    assert len(printed) == 8
    # "no source can balance the target's pole": 63.4 is the most that 100 steps can pay
    alone = [x for name, x in earned.items() if name.startswith("source")]
    assert all(mean_interval(x).high < 55 for x in alone)
    # "Transfer earns more than the best source untouched"
    ours, tuned, scratch = (earned[x] for x in ("transferred", "fine-tuned", "from scratch"))
    assert ours.mean() > max(x.mean() for x in alone) + 3
    # "more than twice what as many iterations learn from scratch"
    assert mean_interval(ours).low > 2 * mean_interval(scratch).high
    # "so does learning from scratch when it is given all the steps, eight times as many"
    assert difference_interval(ours, earned["from scratch, as many steps"]).low <= 0
    assert 7 < names["steps"] / 1000 < 9
    # "fine-tuning after the same trials does as well here"
    assert difference_interval(ours, tuned).low < 0


def test_networks_of_stable_baselines3_are_sources():
    text = README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```text\n(q = ModuleQ.*?)```", text, re.DOTALL)
    model = SimpleNamespace(q_net=SimpleNamespace(q_net=NETWORK))
    names = {"models": [model, model], "envs": [gymnasium.make("CartPole-v1")], "torch": torch}
    names |= {"ModuleQ": vtlib.ModuleQ, "transfer": vtlib.transfer}
    exec(compile(code.replace("1000", "10"), str(README), "exec"), names)
    assert names["learned"].weights.shape[2] == sum(p.numel() for p in NETWORK.parameters())
