"""The pages that the illustrations stand on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.fixture(scope="session")
def page(cells_of: Callable[[str], dict[str, Any]]) -> Callable[[str], dict[str, Any]]:
    """The names of a page after its cells were run, and its figures by theirs."""
    return cells_of
