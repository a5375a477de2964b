"""The README's example runs as it stands, and does what it says."""

import re
from pathlib import Path

from vtlib.gym_runs import evaluate
from vtlib.stats import difference_interval, mean_interval

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_example_transfers(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    names: dict = {}
    exec(compile(code, str(README), "exec"), names)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(names["weights"]) == 7
    fresh = {
        name: evaluate(names["targets"], names["q"], w, seed=1).mean(1).numpy()
        for name, w in names["weights"].items()
    }
    best = max((fresh[name] for name in fresh if name.startswith("source")), key=lambda x: x.mean())
    # 63.4 is the most that 100 steps can pay
    assert best.mean() < 55
    gained = difference_interval(fresh["transferred"], best)
    assert gained.centre > 0
    scratch, transferred = (mean_interval(fresh[x]) for x in ("from scratch", "transferred"))
    assert transferred.low > 2 * scratch.high
    # "as well": no difference is seen
    beside = difference_interval(fresh["transferred"], fresh["fine-tuned"])
    assert beside.low < 0 < beside.high
