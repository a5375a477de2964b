"""The parameters of maze navigation (appendix A.2.3)."""

from __future__ import annotations

from dataclasses import replace

from vtlib.baselines import DDQNSettings
from vtlib.qfunctions import MLP
from vtlib.transfer import Settings

MAZE_ITERATIONS = 20_000
MAZE_LAYERS = (22, 32, 32, 3)
MAZE_GVT = Settings(family="gaussian", lambda_=1e-6, buffer=50_000, alpha_L=1e-7)
MAZE_MGVT = replace(MAZE_GVT, family="mixture", alpha_L=1e-6)
MAZE_DDQN = DDQNSettings(
    epsilon_steps=int(0.1 * MAZE_ITERATIONS), batch=70, buffer=10_000, target_every=100
)


def maze_q() -> MLP:
    """The mazes' Q-function: two hidden layers of 32 units, 1891 weights."""
    return MLP(MAZE_LAYERS)
