"""The README's example runs as it stands, and does what the README says of it."""

import re
from pathlib import Path

from vtlib.gym_runs import evaluate, transfer
from vtlib.stats import difference_interval, mean_interval

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_example_transfers(capsys):
    text = README.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict = {}
    exec(compile(code, str(README), "exec"), names)
    targets, q, weights = (names[x] for x in ("targets", "q", "weights"))
    earned = {name: evaluate(targets, q, w).mean(1).numpy() for name, w in weights.items()}
    printed = [f"{name} {mean_interval(x)}" for name, x in earned.items()]
    assert capsys.readouterr().out.splitlines() == printed
    assert len(printed) == 7
    # "no source can balance the target's pole": 63.4 is the most that 100 steps can pay
    alone = [x for name, x in earned.items() if name.startswith("source")]
    assert all(mean_interval(x).high < 50 for x in alone)
    # "Transfer earns more than the best source untouched"
    ours, tuned, scratch = (earned[x] for x in ("transferred", "fine-tuned", "from scratch"))
    assert difference_interval(ours, max(alone, key=lambda x: x.mean())).low > 0
    # "more than twice what is learned from scratch"
    assert mean_interval(ours).low > 2 * mean_interval(scratch).high
    # "no difference is seen"
    beside = difference_interval(ours, tuned)
    assert beside.low < 0 < beside.high
    # "from the source with the nearest pole fine-tuning does better than either": from the first
    sources, tuning = names["sources"][:, 0], names["tuning"]
    nearest = transfer(targets, q, sources, 1000, tuning, trials=0).weights
    best = evaluate(targets, q, nearest).mean(1).numpy()
    assert min(difference_interval(best, x).low for x in (ours, tuned)) > 0


def test_nothing_in_it_needs_the_files_beside_it():
    # an index of packages shows it without them
    text = README.read_text(encoding="utf-8")
    assert not re.findall(r"\]\((?!https://)|<img|\]:", text)
