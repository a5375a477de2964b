"""Variational transfer of value functions between reinforcement learning tasks."""

from vtlib.baselines import DDQNSettings, FineTuning, MellowTDSettings
from vtlib.gym_runs import resume, solve, transfer
from vtlib.learned import Learned
from vtlib.playing import evaluate
from vtlib.qfunctions import MLP, ModuleQ
from vtlib.transfer import Settings
from vtlib.trust import Trust

__all__ = [
    "MLP",
    "DDQNSettings",
    "FineTuning",
    "Learned",
    "MellowTDSettings",
    "ModuleQ",
    "Settings",
    "Trust",
    "evaluate",
    "resume",
    "solve",
    "transfer",
]
__version__ = "0.1.0"
