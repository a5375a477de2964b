"""Numbers of the pages, drawn at random, computed again with NumPy and the stored files alone."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from vtbook.claims import Runs
from vtbook.experiments import THESIS

RESULTS = Path(__file__).resolve().parents[2] / "book" / "results"
FLOOR = -(1 - 0.99**200) / (1 - 0.99)  # the return of a car that never arrives
DRAWN = 30


def arrays(name: str, label: str) -> dict[str, np.ndarray]:
    with np.load(RESULTS / name / f"{label}.npz") as stored:
        return dict(stored)


def shares(name: str, label: str) -> tuple[np.ndarray, np.ndarray]:
    """The iterations and the learning return (R, T), of the way from a floor to the optimum."""
    stored, floor = arrays(name, label), FLOOR if name.startswith("mountain-car") else 0.0
    optimum = arrays(name, "tasks")["optimum"].mean()
    return stored["iterations"], (stored["learning"] - floor) / (optimum - floor)


def interval(values: np.ndarray) -> list[float]:
    half = stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / len(values) ** 0.5
    return [values.mean(), values.mean() - half, values.mean() + half]


@pytest.mark.parametrize("number", range(DRAWN))
def test_a_number_of_a_page_is_what_the_stored_file_says(number):
    rng = np.random.default_rng([2026, number])
    name = rng.choice(list(THESIS))
    labels = [path.stem for path in sorted((RESULTS / name).glob("*.npz")) if path.stem != "tasks"]
    a, b = rng.choice(labels, 2, replace=False)
    iterations, ours = shares(name, a)
    _, others = shares(name, b)
    at = int(rng.integers(1, len(iterations)))
    t = int(iterations[at])
    experiment = THESIS[name]
    first, second = (Runs.of(experiment, label) for label in (a, b))
    for found, values in (
        (first.share(t), ours[:, at]),
        (first.gain(second, t), ours[:, at] - others[:, at]),
        (first.gain_until(second, t), (ours - others)[:, : at + 1].mean(1)),
    ):
        np.testing.assert_allclose(found, interval(values), atol=2e-6)
