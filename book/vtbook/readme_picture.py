"""The README's picture; ``python -m vtbook.readme_picture`` draws it from the stored runs."""

from vtbook import plots
from vtbook.browser_panel import STATIC
from vtbook.experiments.mountain_car import floor_of
from vtbook.experiments.trust import OURS, PLACES
from vtlab.store import returns

FILE = STATIC / "readme.svg"
SHOWN = {
    "three rooms": "Three rooms: old policies fail",
    "mountain car": "Mountain car: old policies succeed",
}
NAMES = {OURS: "this library", "fine-tuned": "fine-tuned", "NT": "no transfer"}


def picture() -> str:
    """Learning in a place where the sources fail and in one where they do not, as SVG."""
    with plots.look():
        figure = plots.BookFigure(figsize=(7.6, 2.9), facecolor="white")
        axes = figure.subplots(1, 2, sharey=True)
        for ax, place in zip(axes, [x for x in PLACES if x.title in SHOWN], strict=True):
            curves = []
            for label, name in NAMES.items():
                stored, floor = returns(place.experiment, label), floor_of(place.experiment)
                stored = stored.sel(iteration=slice(place.first, None))
                scale = float(stored.optimum.mean()) - floor
                earned = 100 * (stored.learning.values - floor) / scale
                curves.append(plots.curve(name, label, stored.iteration.values, earned))
            plots.draw_curves(ax, curves)
            for curve in curves:
                last = curve.returns[:, -1].mean()
                below = curve.label == "fine-tuned"  # else its label lies in our band
                place_of = {"ha": "right", "va": "top" if below else "bottom"}
                at = curve.iterations[-1], last + (-9 if below else 1)
                ax.text(*at, curve.label, color=curve.colour, fontweight="bold", **place_of)
            ax.set(title=SHOWN[place.title], ylim=(-4, 112), xlabel="thousand steps")
        axes[0].set_ylabel("% of the optimum")
    return figure.svg()


if __name__ == "__main__":
    FILE.write_text(picture(), encoding="utf-8")
