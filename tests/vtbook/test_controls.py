"""The lines of code that the page of controls offers run as they stand."""

import itertools
import re
import textwrap
from pathlib import Path

import gymnasium
import torch

import vtlib

PAGE = Path(__file__).resolve().parents[2] / "book" / "controls.md"


def test_the_code_of_each_control_runs():
    blocks = re.findall(r"^ *```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    assert len(blocks) == 7
    code = "".join(textwrap.dedent(re.sub(r" *\Z", "", block)) for block in blocks)
    code = re.sub(r"\b\d+_000\b", "70", code).replace("episodes=100", "episodes=2")
    envs = [gymnasium.make("CartPole-v1", max_episode_steps=20) for _ in range(2)]
    names = {name: getattr(vtlib, name) for name in vtlib.__all__}
    names |= {"envs": envs, "old_envs": envs, "tuning_envs": envs, "q": vtlib.MLP((4, 4, 2))}
    names |= {"product": itertools.product, "torch": torch, "goal": 0.0}
    names |= {"steps_of_sources": 300, "steps_without": 20, "steps_with": 10}
    names["sources"] = vtlib.solve(envs, names["q"], 70).weights[:, 0]
    exec(code, names)
    assert names["best"].shape == (2,)
    assert names["tasks"] == 30
