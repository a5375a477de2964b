"""The claims on few and many sources, on stored returns as they are and with them exchanged."""

from __future__ import annotations

import numpy as np

from vtlib.claims import NOT, PARTLY, REPRODUCED, Claim, earns_half, gap_closes
from vtlib.experiments.reading import returns
from vtlib.experiments.rooms import count_name


def learned(label: str, count: int) -> np.ndarray:
    return returns("rooms-number-of-sources", count_name(label, count)).at(1_950)


def test_stored_returns_from_two_sources_exchanged_are_not_half():
    a, b = learned("GVT-span", 2), learned("1-MGVT", 2)
    assert earns_half("GVT-span", "1-MGVT", {"at 1,950": (a, b)}).verdict == REPRODUCED
    exchanged = earns_half("GVT-span", "1-MGVT", {"at 1,950": (b, a)})
    assert exchanged.verdict == NOT
    assert f"at 1,950 {b.mean():.2f} against {a.mean():.2f}" in exchanged.evidence
    both = {"at 1,950": (a, b), "exchanged": (b, a)}
    assert earns_half("GVT-span", "1-MGVT", both).verdict == PARTLY


def test_a_stored_gap_closes_partly_as_none_was_clear_and_not_if_it_stays():
    def claim(first: str) -> Claim:
        few, many = ((learned(first, n), learned("1-MGVT", n)) for n in (2, 10))
        return gap_closes(first, few, "1-MGVT", many, "At 1,950")

    prior, span = claim("GVT"), claim("GVT-span")
    assert (prior.verdict, span.verdict) == (PARTLY, NOT)
    for first, stored in (("GVT", prior), ("GVT-span", span)):
        few, many = ((learned(first, n) - learned("1-MGVT", n)).mean() for n in (2, 10))
        before, after = stored.evidence.split("with the fewest")
        assert f"{few:.3f} (95% interval" in before
        assert f"{many:.3f} (95% interval" in after
