"""Checks of arguments and of fields: what passes, and the one line that refuses the rest."""

import math
from typing import Any

import attrs
import numpy as np
import pytest
import torch

from vtlib import checks
from vtlib.checks import LARGEST, SHOWN, check_weights, one_line, shown

LONG = 10**5000  # more digits than Python writes down
NO_NUMBER = [None, "3", (), [1], 1j, True, False, math.nan, math.inf, LONG, np.float32(1)]
# the validator of a field, which calls the check of its name; further arguments; good, bad
TABLE: list[tuple[str, tuple[Any, ...], list[Any], list[Any]]] = [
    ("whole", (), [1, LARGEST], [*NO_NUMBER, 0, -1, 1.0, LARGEST + 1, np.int64(3)]),
    ("whole", (2, 5), [2, 5], [1, 6]),
    ("positive", (), [1, 1e-37, 1e38], [*NO_NUMBER, 0, 0.0, -1.0, 9e-38, 1.1e38]),
    ("between", (0, 1), [0, 1, 0.0, 0.5], [*NO_NUMBER, -1e-9, 1.0000001]),
    ("between", (0, 1, True), [0, 0.999], [1, 1.0, -1]),
    ("one_of", (("a", "bc"),), ["a", "bc"], ["b", "", None, 1, ["a"]]),
    ("kind", (int | str,), [1, "x"], [None, 1.0, ()]),
    ("kind", (dict,), [{}], [[], dict]),
    ("name", (), ["a b", "λ", "1.5"], [None, 3, b"x", "", " ", "..", "a/b", "a\nb", "\u2028"]),
]


@pytest.mark.parametrize(("check", "more", "good", "bad"), TABLE)
def test_checks_by_their_validators(check, more, good, bad):
    field = attrs.field(validator=getattr(checks, check)(*more))
    configuration = attrs.make_class("Configuration", {"thing": field}, frozen=True)
    for value in good:
        configuration(value)
    for value in bad:
        with pytest.raises(ValueError, match=r"^thing must ") as refused:
            configuration(value)
        assert str(refused.value).endswith(f", got {shown(value)}")
        assert str(refused.value).isprintable()


def test_values_are_shown_in_one_line_that_is_not_too_long():
    assert shown("a\nb") == r"'a\nb'"
    assert shown(LONG) == "a value of type int"
    assert shown("x" * 999) == "'" + "x" * (SHOWN - 1) + "..."
    assert one_line("a\n\u2028λ") == r"a\n\u2028λ"


@pytest.mark.parametrize("convert", [lambda x: x, lambda x: x.numpy()], ids=["torch", "numpy"])
def test_weights(convert):
    rows = torch.zeros(2, 3)
    check_weights("w", convert(rows), "run", 3)
    check_weights("w", convert(rows.double()), 2, "weight", kinds=("float64",))
    for bad, message in [
        (rows[:0], r"shape \(at least 1 run, 3\), got \(0, 3\)"),
        (rows[:, :2], r"shape \(at least 1 run, 3\), got \(2, 2\)"),
        (rows[0], r"got \(3,\)"),
        (rows.double(), "be float32, got .*float64"),
        (rows + math.nan, "be finite, got NaN or infinity"),
        (rows - math.inf, "be finite"),
    ]:
        with pytest.raises(ValueError, match=f"^w must .*{message}"):
            check_weights("w", convert(bad), "run", 3)
    with pytest.raises(ValueError, match=r"^w must be a tensor or an array, got \[\[0.0\]\]"):
        check_weights("w", [[0.0]], "run", 1)
