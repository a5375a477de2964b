"""The README's example runs as it stands, and does what it says."""

import re
from pathlib import Path

README = Path(__file__).resolve().parent.parent / "README.md"


def test_the_example_transfers(capsys):
    (code,) = re.findall(r"```python\n(.*?)```", README.read_text(), re.S)
    names: dict = {}
    exec(compile(code, str(README), "exec"), names)
    assert "tensor" in capsys.readouterr().out
    # 63.4 is the most that 100 steps can pay; a random policy earns about 20
    assert names["learned"].returns[0, -1] > 45
