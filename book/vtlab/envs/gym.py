"""Tasks of the laboratory as Gymnasium environments, one task each."""

from pkgutil import resolve_name
from typing import Any, ClassVar

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from torch import Tensor

from vtlib.checks import shown


class TasksEnv(gymnasium.Env[np.ndarray, np.int64]):
    """The only task of a batch as an environment; subclasses hold arguments, space and words.

    Gymnasium's `make` truncates its episodes and sees to it that they begin with a reset. The
    subclasses raise ValueError when an argument is out of range.
    """

    metadata = gymnasium.Env.metadata | {"render_modes": ["rgb_array"]}
    # A function of axes, tasks, index and state, by its name, "module:function": matplotlib takes
    # most of a second to import, and only pictures need it.
    drawing: ClassVar[str]
    picture_size: ClassVar[tuple[int, int]] = (400, 400)  # width and height in pixels

    def __init__(self, tasks: Any, space: spaces.Box, render_mode: str | None = None) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode must be None or 'rgb_array', got {shown(render_mode)}")
        self.tasks, self.render_mode = tasks, render_mode
        self.observation_space, self.action_space = space, spaces.Discrete(tasks.n_actions)
        self._state = torch.empty(0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: observation (obs_dim,) float32 and an empty info; no options known."""
        super().reset(seed=seed)
        u = self.np_random.random((1, self.tasks.start_dim), np.float32)
        self._state = self.tasks.start(torch.from_numpy(u))
        return self._observation(), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Act once. Raises ValueError for an unknown action."""
        if not self.action_space.contains(action):
            last = self.tasks.n_actions - 1
            raise ValueError(f"action must be an integer in 0..{last}, got {action!r}")
        noise = self.np_random.standard_normal((1, self.tasks.noise_dim), np.float32)
        self._state, reward, terminated = self.tasks.step(
            self._state, torch.tensor([int(action)]), torch.from_numpy(noise)
        )
        return self._observation(), float(reward), bool(terminated), False, {}

    def render(self) -> np.ndarray | None:
        """A picture (height, width, 3) uint8 of the task now, None without a render mode."""
        if self.render_mode is None:
            return None
        picture, draw = resolve_name("vtlab.envs.draw:picture"), resolve_name(self.drawing)
        state = self._state[0].numpy()
        pixels: np.ndarray = picture(lambda ax: draw(ax, self.tasks, 0, state), self.picture_size)
        return pixels

    def _observation(self) -> np.ndarray:
        # A copy, because the caller may change it, and an observation may be the state itself.
        obs: Tensor = self.tasks.observe(self._state)[0]
        return obs.numpy().copy()
