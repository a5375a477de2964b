"""Batches of tasks given by a few positive numbers: what they accept, select and copy."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from vtlib.envs import Cartpole, MountainCar

ONES = torch.ones(2)


def test_numbers_and_vectors_make_a_batch() -> None:
    tasks = Cartpole.of(3, cart_mass=1.0, pole_mass=[0.1, 0.2, 0.3], half_length=np.ones(3))
    assert len(tasks) == 3
    assert tasks.cart_mass.tolist() == [1.0] * 3
    assert torch.equal(tasks.pole_mass, torch.tensor([0.1, 0.2, 0.3]))
    assert {value.dtype for value in tasks.parameters().values()} == {torch.float32}


def test_select_takes_and_repeats_tasks() -> None:
    tasks = Cartpole.of(3, cart_mass=[1, 2, 3], pole_mass=[4, 5, 6], half_length=[7, 8, 9])
    chosen = tasks.select([2, 0, 0])
    assert isinstance(chosen, Cartpole)
    assert [value.tolist() for value in chosen.parameters().values()] == [
        [3, 1, 1],
        [6, 4, 4],
        [9, 7, 7],
    ]
    for index in (np.array([-1]), torch.tensor([2])):
        assert tasks.select(index).cart_mass.tolist() == [3]


def test_to_a_device_keeps_the_values() -> None:
    tasks = MountainCar.of(2, speed=[0.001, 0.002])
    assert torch.equal(tasks.to("cpu").speed, tasks.speed)
    assert isinstance(tasks.to("cpu"), MountainCar)


@pytest.mark.parametrize("index", [[2], [-3], [0.5], [[0]], [True]])
def test_bad_index(index: list[object]) -> None:
    with pytest.raises(ValueError, match="index must"):
        MountainCar.of(2, speed=0.001).select(index)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["cart_mass", "pole_mass", "half_length"])
def test_parameters_must_be_positive_and_finite(name: str, value: float) -> None:
    parameters = {"cart_mass": ONES, "pole_mass": ONES, "half_length": ONES}
    with pytest.raises(ValueError, match=f"{name} must be positive and finite, got {value:g}"):
        Cartpole(**{**parameters, name: torch.tensor([1.0, value])})


@pytest.mark.parametrize("wrong", [torch.ones(3), torch.ones(2, 1), torch.tensor(1.0)])
def test_parameters_must_be_vectors_of_one_length(wrong: torch.Tensor) -> None:
    with pytest.raises(ValueError, match="parameters must be vectors of one length"):
        Cartpole(ONES, wrong, ONES)


def test_a_lone_parameter_must_be_a_vector_too() -> None:
    with pytest.raises(ValueError, match="parameters must be vectors"):
        MountainCar(torch.tensor(0.001))


def test_parameters_must_be_float32() -> None:
    with pytest.raises(ValueError, match=r"pole_mass must be float32, got"):
        Cartpole(ONES, ONES.double(), ONES)


@pytest.mark.parametrize("speed", [[0.001], [0.001] * 3, [[0.001] * 2]])
def test_a_vector_needs_one_number_per_task(speed: list[object]) -> None:
    with pytest.raises(ValueError, match=r"speed must be a number or have shape \(2,\), got"):
        MountainCar.of(2, speed=speed)


@pytest.mark.parametrize(
    ("state", "action", "noise"),
    [((1, 2), (2,), (2, 0)), ((2, 2), (1,), (2, 0)), ((2, 2), (2,), (2, 1)), ((2, 2), (2,), (0,))],
)
def test_bad_shapes_of_a_step(
    state: tuple[int, ...], action: tuple[int, ...], noise: tuple[int, ...]
) -> None:
    tasks = MountainCar.of(2, speed=0.001)
    with pytest.raises(ValueError, match="state, action, noise must have shapes"):
        tasks.step(torch.zeros(state), torch.zeros(action, dtype=torch.int64), torch.zeros(noise))
