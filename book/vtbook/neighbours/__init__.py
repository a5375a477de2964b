"""Other ways to carry value functions from task to task, on the loop of ``vtlib.training``.

Each is a frozen attrs class of settings whose ``agent`` is given the sources' weights, as
``vtlib.transfer.Settings``: an experiment runs it, stores it and verifies it like any algorithm.
"""

from vtbook.neighbours.anchored import AnchoredSettings
from vtbook.neighbours.guided import GuidedSettings
from vtbook.neighbours.langevin import LangevinSettings
from vtbook.neighbours.picked import PickedSettings
from vtbook.neighbours.repeated import RepeatedSettings
from vtbook.neighbours.reused import ReusedSettings
from vtbook.neighbours.tried import TriedTrust
from vtbook.neighbours.unstarted import UnstartedSettings
from vtbook.neighbours.untouched import UntouchedSettings
from vtbook.neighbours.varied import VariedTrust

__all__ = [
    "AnchoredSettings",
    "GuidedSettings",
    "LangevinSettings",
    "PickedSettings",
    "RepeatedSettings",
    "ReusedSettings",
    "TriedTrust",
    "UnstartedSettings",
    "UntouchedSettings",
    "VariedTrust",
]
