"""Draw what is predicted of a hard layer that soft tissue hides: `docs/images/hidden-layer.png`.

Usage: `.venv/bin/python docs/draw_hidden_layer.py`; it takes some ten seconds. The presses are those of the table
"Beyond the files": of its ten seeds the one whose error in the layer is nearest to their median.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from beyond_files import CASES, DELAY, LAYER, SEEDS, late, relative, walls
from draw_predictions import narrow_figure, save

from foretouch.quantities import Array, Flags
from foretouch.report import delayed_force, finished
from foretouch.report.drawing import DELAYED, PREDICTED, TRUE

HARDNESS = (10, 66)
AROUND = 0.3
"""What is shown before the first hit and after the second [s]."""
SHADE = {"color": "0.88", "linewidth": 0.0}


class Pressed(NamedTuple):
    """Presses of one seed, and the errors that the table has of it.

    Attributes:
        depth: Of the probe below the surface [m].
        true: Measured force less its zero [N].
        predicted: From forces of the last delay and before [N].
        hits: How often the layer was hit so far.
        above: Error above the layer, after the first hit [%].
        inside: Error in the layer, from the second hit on [%].
    """

    depth: Array
    true: Array
    predicted: Array
    hits: Array
    above: float
    inside: float

    def error(self, where: Flags) -> float:
        """In the layer, at some of the samples [%]."""
        return relative(self.predicted, self.true, where & (self.depth > LAYER))

    def hit_before(self) -> Flags:
        """Where an earlier hit was as deep."""
        deepest = [self.depth[self.hits < hit].max(initial=0.0) for hit in range(int(self.hits.max()) + 1)]
        return self.depth <= np.array(deepest)[self.hits]


def pressed(hardness: int) -> Pressed:
    """Presses into a layer so many times as hard as the tissue."""
    layer = f"layer {hardness} times as hard"
    above, inside = CASES[f"{layer}, above it"][1], CASES[f"{layer}, in it from the second touch"][1]
    cases = [inside(seed) for seed in SEEDS]
    predictions = [late(case.recording) for case in cases]
    errors = np.array([case.error(force) for case, force in zip(cases, predictions, strict=True)])
    one = int(np.argmin(np.abs(errors - np.median(errors))))
    recording, predicted = cases[one].recording, predictions[one]
    depth = recording.position - walls.WALL
    true = recording.force - np.mean(recording.force[depth < 0.0])
    hits = np.cumsum(np.diff((depth > LAYER).astype(int), prepend=0) > 0)
    return Pressed(depth, true, predicted, hits, above(SEEDS[one]).error(predicted), float(errors[one]))


def over_depth(axes: Any, found: Pressed, hits: Flags, title: str) -> None:
    """True and predicted force against the depth, of some hits."""
    depth = np.where(hits, 1e3 * found.depth, np.nan)
    axes.axvspan(1e3 * LAYER, 10.0, **SHADE)
    axes.plot(depth, found.true, color=TRUE, linewidth=2.4)
    axes.plot(depth, found.predicted, color=PREDICTED, linewidth=1.2)
    axes.set_xlim(2.0, 1.01e3 * found.depth.max())
    axes.set_ylim(-0.05 * found.true.max(), 1.1 * found.true.max())
    axes.set_title(title, loc="left")
    axes.set_xlabel("depth [mm]")


def over_time(axes: Any, found: Pressed) -> None:
    """True, predicted and delayed force from before the first hit until the second one has arrived."""
    time = walls.TIME - walls.TIME[found.hits == 1][0]
    seen = (time > -AROUND) & (time < time[found.hits == 2][0] + AROUND + DELAY)
    delayed = delayed_force(walls.TIME, found.true, DELAY)
    across = axes.get_xaxis_transform()
    axes.fill_between(
        time, 0.0, 1.0, where=seen & (found.depth > LAYER), transform=across, label="in the layer", **SHADE
    )
    axes.plot(time[seen], found.true[seen], color=TRUE, linewidth=2.4, label="true")
    axes.plot(time[seen], found.predicted[seen], color=PREDICTED, linewidth=1.2, label="predicted")
    axes.plot(time[seen], delayed[seen], color=DELAYED, linewidth=1.2, linestyle=(0, (5, 2)), label="delayed")
    axes.set_title("first and second hit", loc="left")
    axes.set_xlabel("time since the first hit [s]")


def main() -> None:
    """Draw it: a column for each layer."""
    figure = narrow_figure(8.8)
    rows = figure.subplots(3, len(HARDNESS))
    for (top, middle, bottom), hardness in zip(rows.T, HARDNESS, strict=True):
        found = pressed(hardness)
        first = found.hits == 1
        over_depth(
            top, found, first, f"{hardness} times as hard, first hit:\nerror {found.error(first):.0f} % in the layer"
        )
        errors = (
            f"later hits: error {found.inside:.1f} % in the layer,",
            f"{found.error(found.hit_before()):.1f} % in it as deep as hit before,",
            f"{found.above:.1f} % above it",
        )
        over_depth(middle, found, found.hits > 1, "\n".join(errors))
        over_time(bottom, found)
    for axes in rows[:, 0]:
        axes.set_ylabel("force [N]")
    handles, labels = bottom.get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=4, frameon=False)
    save(finished(figure, 3, above=0.9, gap=1.15), "hidden-layer")


if __name__ == "__main__":
    main()
