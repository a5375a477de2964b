"""The rooms problem as a Gymnasium environment, single and vectorised, over `Rooms.step`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from vtlib.envs.rooms import SIDE, Rooms

DOORS = (5.0, 5.0)
RENDER_MODES = ["rgb_array"]
RENDER_FPS = 5


class RoomsEnv(gymnasium.Env[np.ndarray, np.int64]):
    """A square cut into rooms by walls with doors, to be crossed to its far corner.

    ## Description
    An agent walks from the bottom left corner of a 10 x 10 square to the top right one.  Walls
    cut the square into rooms of equal height; each has one door, 1 wide.  Tasks differ only in
    where the doors are.  Source: section 6.1 of the thesis.

    ## Observation Space
    A `Box(0, 10, (2,), float32)`, in units of length:

    | Num | Observation | Min | Max | Unit   |
    | --- | ----------- | --- | --- | ------ |
    | 0   | x           | 0   | 10  | length |
    | 1   | y           | 0   | 10  | length |

    ## Action Space
    A `Discrete(4)`:

    | Num | Action | Direction |
    | --- | ------ | --------- |
    | 0   | UP     | (0, 1)    |
    | 1   | RIGHT  | (1, 0)    |
    | 2   | DOWN   | (0, -1)   |
    | 3   | LEFT   | (-1, 0)   |

    ## Transition Dynamics
    With *e(a)* the direction above and *z* two independent standard normal numbers,

    *p = clip(s + e(a) + 0.2 z, 0, 10)*

    *s' = s* if the segment from *s* to *p* crosses a wall outside its door, and *s' = p* otherwise.

    ## Reward
    1 on a step that ends within distance 1 of (10, 10), and 0 on any other.  The thesis discounts
    by 0.99 per step.

    ## Starting State
    (0, 0); with `uniform_start` anywhere in the square, uniformly.

    ## Episode End
    1. Termination: the agent is within distance 1 of (10, 10) after a step.
    2. Truncation: `horizon` steps have been made.

    ## Arguments
    - `doors`: centres of the doors, in [0.5, 9.5], lowest wall first; as many as walls, so two
      for three rooms.  Default (5, 5).
    - `uniform_start`: start anywhere in the square.  Default False.
    - `horizon`: steps after which an episode is truncated.  Default 50.
    - `render_mode`: None or "rgb_array".

    Raises ValueError when an argument or an action is out of range.

    ## Version History
    - v0: first version.
    """

    # Gymnasium declares it as a variable of the instance, so it cannot be a ClassVar.
    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": RENDER_FPS}  # noqa: RUF012

    def __init__(
        self,
        doors: Sequence[float] = DOORS,
        uniform_start: bool = False,
        horizon: int = Rooms.horizon,
        render_mode: str | None = None,
    ) -> None:
        self.tasks = _tasks(doors, 1, uniform_start)
        self.horizon = _checked_horizon(horizon)
        self.render_mode = _checked_render_mode(render_mode)
        self.observation_space = spaces.Box(0.0, SIDE, (Rooms.obs_dim,), np.float32)
        self.action_space = spaces.Discrete(Rooms.n_actions)
        self._state: np.ndarray | None = None
        self._steps = 0
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode: observation (2,) float32 and an empty info; no options are known."""
        super().reset(seed=seed)
        self._state = _start(self.tasks, [self.np_random])
        self._steps, self._over = 0, False
        return self._state[0].copy(), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Move once.  Raises ValueError for an unknown action, ResetNeeded after an episode."""
        if not self.action_space.contains(action):
            raise ValueError(f"action must be an integer in 0..3, got {action!r}")
        if self._state is None or self._over:
            raise ResetNeeded("call reset() before step(): no episode is running")
        self._state, reward, terminal = _step(
            self.tasks, self._state, np.array([action]), [self.np_random]
        )
        self._steps += 1
        truncated = self._steps >= self.horizon
        self._over = bool(terminal[0]) or truncated
        return self._state[0].copy(), float(reward[0]), bool(terminal[0]), truncated, {}

    def render(self) -> np.ndarray | None:
        """A picture (400, 400, 3) uint8 of the rooms and the agent, None without a render mode."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise ResetNeeded("call reset() before render(): no episode is running")
        return _frame(self.tasks, 0, self._state[0])


class RoomsVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many rooms environments in one batch; row i behaves exactly as a `RoomsEnv` of seed + i.

    Arguments as for `RoomsEnv`, and `num_envs`; `doors` has shape (W,) for one task everywhere or
    (num_envs, W) for one task per row.  Each row keeps its own random generator, so a row never
    depends on its neighbours.  After an episode's last step a row starts anew on the next step,
    whose action it ignores (Gymnasium's next-step autoreset).
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": RENDER_MODES,
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        doors: ArrayLike = DOORS,
        uniform_start: bool = False,
        horizon: int = Rooms.horizon,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        self.num_envs = num_envs
        self.tasks = _tasks(doors, num_envs, uniform_start)
        self.horizon = _checked_horizon(horizon)
        self.render_mode = _checked_render_mode(render_mode)
        self.single_observation_space = spaces.Box(0.0, SIDE, (Rooms.obs_dim,), np.float32)
        self.single_action_space = spaces.Discrete(Rooms.n_actions)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._generators: list[np.random.Generator] | None = None
        self._state: np.ndarray | None = None
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=bool)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every row: observations (num_envs, 2) float32 and an empty info."""
        super().reset(seed=seed)
        if seed is None and self._generators is None:
            seed = int(self.np_random.integers(2**31))
        if seed is not None:
            self._generators = [seeding.np_random(seed + row)[0] for row in range(self.num_envs)]
        assert self._generators is not None
        self._state = _start(self.tasks, self._generators)
        self._steps[:], self._over[:] = 0, False
        return self._state.copy(), {}

    def step(
        self, actions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Move every row once, or start it anew where its episode had ended.

        `actions` (num_envs,) of integers in 0..3.  Raises ValueError for others, ResetNeeded
        before the first reset.
        """
        actions = np.asarray(actions)
        if not self.action_space.contains(actions):
            raise ValueError(f"actions must be {self.num_envs} integers in 0..3, got {actions!r}")
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
        return state.copy(), reward, terminal, truncated, {}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture (400, 400, 3) uint8 per row, None without a render mode."""
        if self.render_mode is None:
            return None
        if self._state is None:
            raise ResetNeeded("call reset() before render(): no episode is running")
        return tuple(_frame(self.tasks, row, position) for row, position in enumerate(self._state))


def _tasks(doors: ArrayLike, count: int, uniform_start: bool) -> Rooms:
    centres = np.asarray(doors, dtype=np.float32)
    if centres.ndim == 1:
        centres = np.tile(centres, (count, 1))
    tasks = Rooms.from_doors(centres, uniform_start)
    if len(tasks) != count:
        raise ValueError(f"doors must have shape (W,) or ({count}, W), got {centres.shape}")
    return tasks


def _start(tasks: Rooms, generators: Sequence[np.random.Generator]) -> np.ndarray:
    u = np.stack([generator.random(Rooms.start_dim, np.float32) for generator in generators])
    return tasks.start(torch.from_numpy(u)).numpy()


def _step(
    tasks: Rooms, state: np.ndarray, action: np.ndarray, generators: Sequence[np.random.Generator]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    noise = np.stack(
        [generator.standard_normal(Rooms.noise_dim, np.float32) for generator in generators]
    )
    next_state, reward, terminal = tasks.step(
        torch.from_numpy(state), torch.from_numpy(action.astype(np.int64)), torch.from_numpy(noise)
    )
    return next_state.numpy(), reward.numpy(), terminal.numpy()


def _frame(tasks: Rooms, index: int, position: np.ndarray) -> np.ndarray:
    # matplotlib takes most of a second to import and only pictures need it.
    from vtlib.envs.draw import frame

    return frame(tasks, index, position)


def _checked_horizon(horizon: int) -> int:
    if horizon < 1:
        raise ValueError(f"horizon must be at least 1, got {horizon}")
    return horizon


def _checked_render_mode(render_mode: str | None) -> str | None:
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise ValueError(f"render_mode must be None or one of {RENDER_MODES}, got {render_mode!r}")
    return render_mode
