"""Other ways to carry value functions from task to task, on the loop of ``vtlib.training``.

Each is a frozen attrs class of settings whose ``agent`` is given the sources' weights, as
``vtlib.transfer.Settings``: an experiment runs it, stores it and verifies it like any algorithm.
"""

from vtbook.neighbours.heads import HeadsSettings
from vtbook.neighbours.hierarchical import HierarchicalSettings
from vtbook.neighbours.ivon import IVONSettings
from vtbook.neighbours.langevin import LangevinSettings
from vtbook.neighbours.regression import RegressionSettings
from vtbook.neighbours.unstarted import UnstartedSettings

__all__ = [
    "HeadsSettings",
    "HierarchicalSettings",
    "IVONSettings",
    "LangevinSettings",
    "RegressionSettings",
    "UnstartedSettings",
]
