"""What two parts are worth where `trust` is judged, on the same tasks and streams, run by run.

In every place Trust is run once more with sources that never play: it learns from the first step,
and plays what it learns. The difference is what playing the sources adds. In both kinds of rooms,
where mixtures with eight updates are ahead, 1-MGVT with eight is run once more with a covariance
that stays the prior's, and as a point under a prior of the same strength. The differences are what
its posterior adds at as many updates. Settings were fixed before any run was looked at.
"""

from attrs import evolve

from vtbook.experiments.controls import FROZEN, POINT
from vtbook.experiments.trust import EIGHT, PLACES, Place
from vtbook.neighbours import RepeatedSettings
from vtlab.experiment import Algorithm, Experiment
from vtlib.trust import Trust

ALONE = "sources never play"
MIXTURE, STILL, AS_POINT = (f"1-MGVT{part}{EIGHT}" for part in ("", ", frozen", ", point"))


def _algorithms(place: Place) -> dict[str, Algorithm]:
    parts: dict[str, Algorithm] = {ALONE: Trust(sources_play=False)}
    mixture = place.experiment.algorithms.get(MIXTURE)
    if isinstance(mixture, RepeatedSettings):
        still = evolve(mixture.settings, alpha_L=FROZEN)
        share = POINT**2 / still.sigma_p2  # the prior's weight on the mean is lambda / sigma^2
        point = evolve(still, sigma_p2=POINT**2, lambda_=still.lambda_ * share)
        parts |= {STILL: evolve(mixture, settings=still), AS_POINT: evolve(mixture, settings=point)}
    return parts


#: By the title of a place.
PARTS: dict[str, Experiment] = {
    place.title: evolve(
        place.experiment, name=f"{place.experiment.name}-parts", algorithms=_algorithms(place)
    )
    for place in PLACES
}
