"""What parts are worth where `trust` is judged, on the same tasks and streams, run by run.

In every place Trust is run once more with sources that never play: it learns from the first step,
and plays what it learns. The difference is what playing the sources adds. Learning from nothing and
fine-tuning of the best source are run with as many gradient steps as Trust takes. In both kinds of
rooms, where mixtures with eight updates are ahead, 1-MGVT with eight is run once more with a
covariance that stays the prior's, as a point under a prior of the same strength, and as a point
without one. Settings were fixed before any run was looked at; the point without a prior, and the
rivals with eight updates, were added when the others had been seen. Last came, on cartpole and on
mountain car, sources that overestimate: all their values are too high by half of the way from the
worst return to the best; and on the same cartpoles sources that DDQN solved, or each from first
weights of its own. In both kinds of rooms 1-MGVT, 3-MGVT and fine-tuning of the mean also run as
published, since tuning over eight runs may have chosen worse settings. Policy reuse, which draws a
source for each episode by what sources have earned and learns nothing, was added after all others,
and then Trust as `vtlib.transfer` runs it: in the last fifth of its steps a trial decides what is
kept. Until then each of its runs is the judged one. The trial ran once before, in which both always
played in turn; it cost up to three points, and its rule was changed.
"""

from attrs import evolve

from vtbook.experiments.cartpole import CARTPOLE_OTHER_SOURCES
from vtbook.experiments.controls import without_parts
from vtbook.experiments.protocols import FROM_MEAN
from vtbook.experiments.rooms import ROOMS_EVALUATION
from vtbook.experiments.trust import EIGHT, OURS, PICKED, PLACES, Place
from vtbook.neighbours import RepeatedSettings, ReusedSettings, TriedTrust, VariedTrust
from vtlab.experiment import Algorithm, Experiment
from vtlib.gym_runs import TRIAL
from vtlib.trust import Trust

ALONE, OPTIMISTIC, REUSE = "sources never play", "values too high", "policy reuse"
TRIED = "with the trial"
TOO_HIGH = {"cartpole": 32.0, "mountain car": 17.0}
_PARTS = ("", ", frozen", ", point", ", start alone")
MIXTURE, STILL, AS_POINT, UNPULLED = (f"1-MGVT{part}{EIGHT}" for part in _PARTS)


def _eight(algorithm: Algorithm) -> Algorithm:
    return RepeatedSettings(getattr(algorithm, "settings", algorithm), 8)


def _algorithms(place: Place) -> dict[str, Algorithm]:
    parts: dict[str, Algorithm] = {ALONE: Trust(sources_play=False), REUSE: ReusedSettings()}
    last = place.experiment.iterations // TRIAL
    parts[TRIED] = TriedTrust(trial=place.experiment.iterations - last)
    for rival in ("NT", PICKED):
        parts[f"{rival}{EIGHT}"] = _eight(place.experiment.algorithms[rival])
    if place.title in TOO_HIGH:
        parts[OPTIMISTIC] = VariedTrust(optimism=TOO_HIGH[place.title])
    mixture = place.experiment.algorithms.get(MIXTURE)
    if isinstance(mixture, RepeatedSettings):
        published = ROOMS_EVALUATION.algorithms
        parts |= {f"{x}, as published": published[x] for x in ("1-MGVT", "3-MGVT", FROM_MEAN)}
        for part, settings in without_parts(mixture.settings).items():
            parts[f"1-MGVT, {part}{EIGHT}"] = evolve(mixture, settings=settings)
    return parts


#: By the title of a place.
PARTS: dict[str, Experiment] = {
    place.title: evolve(
        place.experiment, name=f"{place.experiment.name}-parts", algorithms=_algorithms(place)
    )
    for place in PLACES
}

_POLES = PLACES[2].experiment
#: On cartpole, by what is different about the sources.
OTHER_SOURCES: dict[str, Experiment] = {
    key: evolve(
        _POLES,
        name=f"cartpole-trust-{key}",
        pool=other.pool,
        algorithms={x: _POLES.algorithms[x] for x in (OURS, "untouched", "1-MGVT", PICKED)},
    )
    for key, other in CARTPOLE_OTHER_SOURCES.items()
}
