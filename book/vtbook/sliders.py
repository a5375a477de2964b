"""Sliders over stored settings: a picture of each, and in words what it comes to."""

import functools
from collections.abc import Mapping

from ipywidgets import VBox
from xarray import Dataset

from vtbook import widgets
from vtbook.claims import Runs
from vtbook.experiments.grids import slider_name
from vtbook.experiments.protocols import transfer_settings
from vtbook.plots import look, power_of_ten, returns_figure
from vtbook.setting_curves import Frame
from vtbook.tables import words
from vtlab.experiment import Experiment
from vtlib.transfer import Settings

LEARNING, NARROW = {"learning return": "learning"}, 4.1  # inches, to be read on a phone
Setting = tuple[float, float, str]  # lambda, psi and the posterior, such as "3-MGVT"


def setting_sliders(
    grid: Experiment,
    thesis: Mapping[str, Settings],
    references: Mapping[str, Dataset],
) -> VBox:
    """Sliders over the stored settings of a grid, each a picture with a sentence below it.

    thesis: the settings of "GVT" and "1-MGVT" in the thesis. references: stored returns to
    draw beside a setting's returns; their first runs must be the grid's runs, in the same order.
    """
    lambdas = sorted({transfer_settings(grid, label).lambda_ for label in grid.algorithms})
    axes, frames = widgets.parameter_axes(thesis, lambdas), dict[str, Frame]()

    @functools.cache
    def stored(setting: Setting) -> Runs:
        return Runs.of(grid, slider_name(*setting))

    def picture(lambda_: float, psi: float, posterior: str) -> str:
        own = thesis["GVT" if posterior == "GVT" else "1-MGVT"]
        setting, usual = (lambda_, psi, posterior), (own.lambda_, own.psi, posterior)
        mine, theirs = stored(setting), stored(usual)
        title = f"λ = {power_of_ten(lambda_)}, ψ = {psi:g}, {posterior}"
        text = setting_words(setting, usual, mine, theirs)
        if posterior not in frames:
            name, limits = f"{grid.name}-{posterior}", grid.family.limits
            frames[posterior] = setting_frame(name, references, mine, posterior, limits)
        return f"{setting_picture(frames[posterior], mine, setting)}<p>{title}. {text}</p>"

    def shared() -> str:
        return "".join(frame.symbol for frame in frames.values())

    return widgets.still_sliders(axes, picture, shared)


def setting_words(setting: Setting, usual: Setting, mine: Runs, theirs: Runs) -> str:
    """What a setting earns, and its distance from the thesis' setting."""
    end = int(mine.stored.iteration[-1])
    earns = f"After {end:,} iterations: {words(mine.share(end), 'z.0%')} of the optimum."
    if setting == usual:
        return f"{earns} This is the thesis' setting."
    gap = mine.gain_until(theirs, end)
    beside = f"Averaged over the run, {words(gap, '+z.0%')} against the thesis' setting"
    none = ": no difference that these runs can show" * bool(gap.low <= 0 <= gap.high)
    return f"{earns} {beside}{none}."


def setting_frame(
    name: str,
    references: Mapping[str, Dataset],
    mine: Runs,
    posterior: str,
    limits: tuple[float, float],
) -> Frame:
    """What all pictures of one posterior share: its references, axes and legend."""
    runs = {label: first_runs(x, mine.stored) for label, x in references.items()}
    runs[posterior] = mine.stored
    with look():
        figure = returns_figure(runs, limits, LEARNING, NARROW)
        return Frame(figure, name, posterior)


def setting_picture(frame: Frame, mine: Runs, setting: Setting) -> str:
    """A setting's learning returns as an HTML picture in its posterior's frame."""
    (lambda_, psi, posterior), stored = setting, mine.stored
    end = float(stored.learning[:, -1].mean())
    alt = f"Learning return with lambda = {lambda_:.0e}, psi = {psi:g}, {posterior}; "
    return frame.picture(stored, f"{alt}final learning return {end:.2f}.")


def first_runs(runs: Dataset, other: Dataset) -> Dataset:
    """As many runs and iterations as another result has; both count from the same first run."""
    sizes = other.learning.sizes
    return runs.isel(run=slice(sizes["run"]), iteration=slice(sizes["iteration"]))
