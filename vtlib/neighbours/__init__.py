"""Other ways to carry value functions from task to task, on the loop of ``vtlib.training``.

Each is a frozen attrs class of settings whose ``agent`` is given the sources' weights, as
``vtlib.transfer.Settings``: an experiment runs it, stores it and verifies it like any algorithm.
"""

from vtlib.neighbours.drifting import DriftingSettings
from vtlib.neighbours.heads import HeadsSettings
from vtlib.neighbours.hierarchical import HierarchicalSettings
from vtlib.neighbours.ivon import IVONSettings
from vtlib.neighbours.langevin import LangevinSettings
from vtlib.neighbours.regression import RegressionSettings

__all__ = [
    "DriftingSettings",
    "HeadsSettings",
    "HierarchicalSettings",
    "IVONSettings",
    "LangevinSettings",
    "RegressionSettings",
]
