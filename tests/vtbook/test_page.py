"""What the page of an experiment counts from, and what its costs are compared with."""

from vtbook.costs import cost
from vtbook.experiments.mountain_car import CAR, FLOOR
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtbook.page import Page


def test_on_mountain_car_nothing_is_never_to_arrive_and_costs_are_beside_ddqn():
    cars = Page(CAR)
    assert (cars["GVT"].floor, Page(ROOMS_EVALUATION)["GVT"].floor) == (FLOOR, 0)
    beside = cars.runs["GVT"], cars.runs["DDQN"], FLOOR
    assert cars.cost("GVT").saved == cost(cars.sources, cars.experiment.sources, *beside).saved
