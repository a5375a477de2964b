"""Cartpoles and mountain cars that differ from those of the thesis in one respect each."""

import torch

from vtlab.envs.cartpole import Cartpole
from vtlab.envs.cartpole.noisy import NOISE, NoisyCartpoleFamily
from vtlab.envs.cartpole.wired import SWAPPED, WiredCartpoleFamily
from vtlab.envs.mountain_car import MountainCar
from vtlab.envs.mountain_car.steep import SteepCar, SteepCarFamily

RUNS = 6
NONE = torch.zeros(RUNS, 0)
ACTION = torch.arange(RUNS) % 2


def plain(tasks):
    return Cartpole(tasks.cart_mass, tasks.pole_mass, tasks.half_length)


def test_half_of_the_wired_cartpoles_exchange_their_actions():
    tasks = WiredCartpoleFamily().draw_tasks("wired", range(RUNS))
    swapped = tasks.wiring == SWAPPED
    assert 0 < swapped.sum() < RUNS
    state = tasks.start(torch.rand(RUNS, 4))
    expected = plain(tasks).step(state, torch.where(swapped, 1 - ACTION, ACTION), NONE)
    for got, wanted in zip(tasks.step(state, ACTION, NONE), expected, strict=True):
        assert torch.equal(got, wanted)


def test_a_noisy_cartpole_is_pushed_late_and_measured_with_noise():
    tasks = NoisyCartpoleFamily().draw_tasks("noisy", range(RUNS))
    start, noise = tasks.start(torch.rand(RUNS, 4)), torch.randn(RUNS, 4)
    assert torch.equal(tasks.observe(start), start[:, :4])
    first, _, _ = tasks.step(start, ACTION, noise)
    left, _, _ = plain(tasks).step(start[:, :4], torch.zeros_like(ACTION), NONE)
    assert torch.equal(first[:, :4], left)
    assert torch.equal(tasks.observe(first), left + NOISE * noise)
    second, reward, terminated = tasks.step(first, 1 - ACTION, noise)
    assert torch.equal(second[:, :4], plain(tasks).step(left, ACTION, NONE)[0])
    assert reward.shape == terminated.shape == (RUNS,)


def test_a_steep_car_is_pulled_by_its_own_gravity():
    tasks = SteepCarFamily(last_reward=-1.0).draw_tasks("steep", range(RUNS))
    assert ((tasks.steepness > 0.8) & (tasks.steepness < 1.2)).all()
    state = tasks.start(torch.rand(RUNS, 1))
    usual = SteepCar(tasks.speed, -1.0, torch.ones(RUNS)).step(state, ACTION, NONE)
    for got, wanted in zip(
        MountainCar(tasks.speed, -1.0).step(state, ACTION, NONE), usual, strict=True
    ):
        torch.testing.assert_close(got, wanted)
    moved = tasks.step(state, ACTION, NONE)[0][:, 1] - usual[0][:, 1]
    expected = (1 - tasks.steepness) * 0.0025 * (3 * state[:, 0]).cos()
    torch.testing.assert_close(moved, expected, atol=1e-6, rtol=0)
