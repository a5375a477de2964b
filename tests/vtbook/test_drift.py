"""How far weights move: not at all where they are held, and less where they are pulled."""

from vtbook.drift import drift
from vtbook.experiments.controls import WHERE_PULLED

ROOMS = WHERE_PULLED["rooms_evaluation"]
RUNS, STEPS = 2, 60


def test_what_is_held_does_not_move():
    seen, unseen = drift(ROOMS, "unseen held", RUNS, STEPS)
    assert unseen == 0 < seen


def test_the_first_steps_move_weights_by_at_most_their_number():
    alpha = ROOMS.algorithms["no pull"].alpha
    seen, unseen = drift(ROOMS, "no pull", RUNS, STEPS)
    pulled = drift(ROOMS, "pull", RUNS, STEPS)
    assert 0 < pulled[1] < unseen < seen < 1.5 * STEPS * alpha  # a step of Adam is about alpha
