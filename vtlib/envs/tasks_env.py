"""Tasks of this library as Gymnasium environments: one task, or a batch with one for each row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from vtlib.checks import check_whole, shown
from vtlib.envs.episodes import Tasks

RENDER_MODES = ["rgb_array"]

# A picture (height, width, 3) uint8 of the task at an index, in a state (state_dim,).
Frame = Callable[[Any, int, np.ndarray], np.ndarray]


def env_metadata(render_fps: int) -> dict[str, Any]:
    """What Gymnasium wants to know of a single environment."""
    return {"render_modes": RENDER_MODES, "render_fps": render_fps}


def vector_metadata(render_fps: int) -> dict[str, Any]:
    """What Gymnasium wants to know of a vectorised environment."""
    return {**env_metadata(render_fps), "autoreset_mode": AutoresetMode.NEXT_STEP}


class TasksEnv(gymnasium.Env[np.ndarray, np.int64]):
    """The only task of a batch as an environment; subclasses hold spaces, arguments and words.

    `box` is the space of observations, `horizon` the count of steps after which an episode is
    truncated, `frame` draws a picture.  Raises ValueError on a horizon below 1 or a render mode
    other than None and "rgb_array".
    """

    def __init__(
        self,
        tasks: Tasks,
        box: spaces.Box,
        frame: Frame,
        horizon: int,
        render_mode: str | None,
    ) -> None:
        self.tasks = tasks
        self.horizon = _checked_horizon(horizon)
        self.render_mode = _checked_render_mode(render_mode)
        self.observation_space = box
        self.action_space = spaces.Discrete(tasks.n_actions)
        self._frame = frame
        self._state: np.ndarray | None = None
        self._steps = 0
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: observation (obs_dim,) float32 and an empty info; no options known."""
        super().reset(seed=seed)
        self._state = _start(self.tasks, [self.np_random])
        self._steps, self._over = 0, False
        return _observe(self.tasks, self._state)[0], {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Act once.  Raises ValueError for an unknown action, ResetNeeded after an episode."""
        if not self.action_space.contains(action):
            last = self.tasks.n_actions - 1
            raise ValueError(f"action must be an integer in 0..{last}, got {action!r}")
        if self._state is None or self._over:
            raise ResetNeeded("call reset() before step(): no episode is running")
        self._state, reward, terminal = _step(
            self.tasks, self._state, np.array([action]), [self.np_random]
        )
        self._steps += 1
        truncated = self._steps >= self.horizon
        self._over = bool(terminal[0]) or truncated
        observation = _observe(self.tasks, self._state)[0]
        return observation, float(reward[0]), bool(terminal[0]), truncated, {}

    def render(self) -> np.ndarray | None:
        """A picture (height, width, 3) uint8 of the task now, None without a render mode."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise ResetNeeded("call reset() before render(): no episode is running")
        return self._frame(self.tasks, 0, self._state[0])


class TasksVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """A batch of tasks, one for each row; row i behaves exactly as a `TasksEnv` of seed + i.

    Each row keeps its own random generator, so a row never depends on its neighbours.  After an
    episode's last step a row starts anew on the next step, whose action it ignores (Gymnasium's
    next-step autoreset).  Arguments and errors as for `TasksEnv`.
    """

    def __init__(
        self,
        tasks: Tasks,
        box: spaces.Box,
        frame: Frame,
        horizon: int,
        render_mode: str | None,
    ) -> None:
        self.num_envs = len(tasks)
        self.tasks = tasks
        self.horizon = _checked_horizon(horizon)
        self.render_mode = _checked_render_mode(render_mode)
        self.single_observation_space = box
        self.single_action_space = spaces.Discrete(tasks.n_actions)
        self.observation_space = batch_space(box, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._frame = frame
        self._generators: list[np.random.Generator] | None = None
        self._state: np.ndarray | None = None
        self._steps = np.zeros(self.num_envs, dtype=np.int64)
        self._over = np.zeros(self.num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every row: observations (num_envs, obs_dim), and an empty info."""
        super().reset(seed=seed)
        if seed is None and self._generators is None:
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            self._generators = [seeding.np_random(seed + row)[0] for row in range(self.num_envs)]
        assert self._generators is not None
        self._state = _start(self.tasks, self._generators)
        self._steps[:], self._over[:] = 0, False
        return _observe(self.tasks, self._state), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Act once in every row, or start it anew where its episode had ended.

        `actions` (num_envs,) of integers.  Raises ValueError for unknown ones, ResetNeeded before
        the first reset.
        """
        actions = self._checked_actions(actions)
        if self._state is None or self._generators is None:
            raise ResetNeeded("call reset() before step(): no episode is running")
        ended, live = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        state = np.empty_like(self._state)
        reward = np.zeros(self.num_envs, dtype=np.float64)
        terminal = np.zeros(self.num_envs, dtype=bool)
        if len(live):
            state[live], reward[live], terminal[live] = _step(
                self.tasks.select(live),
                self._state[live],
                actions[live],
                [self._generators[row] for row in live],
            )
        if len(ended):
            state[ended] = _start(
                self.tasks.select(ended), [self._generators[row] for row in ended]
            )
        self._state = state
        self._steps[live] += 1
        self._steps[ended] = 0
        truncated = self._steps >= self.horizon
        self._over = terminal | truncated
        return _observe(self.tasks, state), reward, terminal, truncated, {}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture (height, width, 3) uint8 per row, None without a render mode."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise ResetNeeded("call reset() before render(): no episode is running")
        return tuple(self._frame(self.tasks, row, state) for row, state in enumerate(self._state))

    def _checked_actions(self, actions: np.ndarray) -> np.ndarray:
        actions = np.asarray(actions)
        # older spaces take fractions for members, too
        if actions.dtype.kind not in "iu" or not self.action_space.contains(actions):
            last = self.tasks.n_actions - 1
            raise ValueError(
                f"actions must be {self.num_envs} integers in 0..{last}, got {actions!r}"
            )
        return actions


def checked_count(num_envs: int) -> int:
    """The count of rows of a vectorised environment.  Raises ValueError below 1."""
    check_whole("num_envs", num_envs)
    return num_envs


def _start(tasks: Tasks, generators: Sequence[np.random.Generator]) -> np.ndarray:
    u = np.stack([generator.random(tasks.start_dim, np.float32) for generator in generators])
    return tasks.start(torch.from_numpy(u)).numpy()


def _step(
    tasks: Tasks, state: np.ndarray, action: np.ndarray, generators: Sequence[np.random.Generator]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    noise = np.stack(
        [generator.standard_normal(tasks.noise_dim, np.float32) for generator in generators]
    )
    next_state, reward, terminal = tasks.step(
        torch.from_numpy(state), torch.from_numpy(action.astype(np.int64)), torch.from_numpy(noise)
    )
    return next_state.numpy(), reward.numpy(), terminal.numpy()


def _observe(tasks: Tasks, state: np.ndarray) -> np.ndarray:
    # Copied: an observation may be the state itself, and is the caller's to change.
    return tasks.observe(torch.from_numpy(state)).numpy().copy()


def _checked_horizon(horizon: int) -> int:
    check_whole("horizon", horizon)
    return horizon


def _checked_render_mode(render_mode: str | None) -> str | None:
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise ValueError(
            f"render_mode must be None or one of {RENDER_MODES}, got {shown(render_mode)}"
        )
    return render_mode
