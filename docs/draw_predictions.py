"""Draw true, predicted and delayed force of measured presses, and how honest the standard deviation is.

Usage: `.venv/bin/python docs/draw_predictions.py [forces | rigid | calibration]`, without a name for all; the images go
to `docs/images`. It takes about two minutes, `rigid` alone some seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from io import BytesIO
from math import erf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from PIL import Image

from foretouch.comparison import SIMULATED, simulate, unforeseeable
from foretouch.identification import Learner
from foretouch.quantities import Recording
from foretouch.recordings import DATASETS, excerpt, read_recording
from foretouch.report import Forces, Scores, finished, forces_under_delay, new_figure, score_prediction
from foretouch.report.drawing import DELAYED, PREDICTED, RENDERED, TRUE

IMAGES = Path(__file__).parent / "images"
SEEDS = (1, 2, 3)
"""Of the simulated recordings: everything was chosen on seed 0."""


class Shown(NamedTuple):
    """A measured press: file, delay [s], scoring window and close-up [s after the first sample], and what it is."""

    name: str
    delay: float
    window: tuple[float, float | None]
    near: tuple[float, float]
    title: str


SHOWN = (
    Shown("tue/b-foam", 0.3, (1.5, None), (2.0, 4.0), "foam (b-foam)"),
    Shown("tue/e-foam2", 0.3, (1.5, None), (2.0, 4.0), "another foam (e-foam2)"),
    Shown("tue/a-rigid", 0.3, (1.5, None), (2.0, 4.0), "something rigid (a-rigid)"),
    Shown(
        "tue/d-spring", 0.3, (1.5, None), (2.0, 4.0), "spring that is never let go, zero of its force given (d-spring)"
    ),
    Shown("aurora/600-mN", 0.02, (0.5, 1.6), (0.85, 1.3), "skin, touched once (600-mN)"),
)


def predicted(recording: Recording, delay: float, offset: float | None = None) -> Forces:
    """With the estimator that is taken where none is named."""
    learner = Learner(force_offset=offset, contact_floor=recording.contact_floor)
    return forces_under_delay(recording, learner, delay)


def forces() -> Any:
    """True, delayed and predicted force with its standard deviation, a panel for each press."""
    figure = new_figure(13.5)
    panels = figure.subplots(len(SHOWN), 1)
    for panel, shown in zip(panels, SHOWN, strict=True):
        recording = read_recording(excerpt(shown.name))
        offset = zero_of(recording) if "spring" in shown.name else None
        found = predicted(recording, shown.delay, offset)
        scores = scored(found, *shown.window)
        draw(panel, found, scores, shown.near)
        errors = scores.prediction_error_percent, scores.delayed_force_error_percent
        panel.set_title(
            f"{shown.title}, {1e3 * shown.delay:.0f} ms: predicted {errors[0]:.1f} %, delayed {errors[1]:.0f} %",
            loc="left",
        )
    panels[-1].set_xlabel("time [s]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=4, frameon=False)
    return finished(figure, len(SHOWN), above=0.75, gap=0.55)


def draw(panel: Any, found: Forces, scores: Scores, near: tuple[float, float]) -> None:
    """True, delayed and predicted force with its standard deviation, between two times after the first sample [s]."""
    time = found.time - found.time[0]
    shown = (time >= near[0]) & (time <= near[1])
    time, force, spread = time[shown], found.predicted[shown], found.standard_deviation[shown]
    true, delayed = scores.measured_force[shown], found.delayed[shown]
    for share, label in ((2.0, None), (1.0, "predicted, ± 1 and ± 2 standard deviations")):
        low, high = np.maximum(force - share * spread, 0.0), force + share * spread
        panel.fill_between(time, low, high, color=PREDICTED, alpha=0.18, linewidth=0.0)
        panel.plot([], [], color=PREDICTED, linewidth=6.0, alpha=0.3, label=label)
    panel.plot(time, true, color=TRUE, linewidth=1.8, label="true (measured)")
    panel.plot(time, delayed, color=DELAYED, linewidth=1.2, linestyle=(0, (5, 2)), label="delayed")
    panel.plot(time, force, color=PREDICTED, linewidth=1.2, label="predicted")
    top = max(1.3 * true.max(), 1.3 * delayed.max(), 1.05 * force.max())
    panel.set_ylim(-0.05 * top, top)
    panel.set_xlim(near)
    panel.set_ylabel("force [N]")


def rigid() -> Any:
    """The same of every measured rigid contact: its median two seconds, and the scores of the whole file."""
    names = [name for name, entry in DATASETS.items() if entry.kind == "rigid"]
    figure = narrow_figure(9.0)
    panels = figure.subplots(len(names), 1)
    for panel, name in zip(panels, names, strict=True):
        recording = read_recording(excerpt(name))
        found = predicted(recording, 0.3)
        scores = scored(found)
        draw(panel, found, scores, median_window(found))
        within = scores.coverage(found.predicted, found.standard_deviation)
        panel.set_title(
            f"{name.split('/')[1]}: error {scores.prediction_error_percent:.1f} %, within one / two deviations "
            f"{within['within_one_percent']:.0f} / {within['within_two_percent']:.0f} %",
            loc="left",
        )
    panels[-1].set_xlabel("time [s]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=2, frameon=False)
    return finished(figure, len(names), above=0.85, gap=0.55, right=0.965)


def narrow_figure(height: float) -> Any:
    """An empty figure of a page's width, 7 inches, whose letters can be read on a phone."""
    figure = new_figure(height)
    figure.set_figwidth(7.0)
    return figure


def scored(found: Forces, begin: float = 1.5, end: float | None = None) -> Scores:
    """As the page scores it, between two times after the first sample [s]."""
    return score_prediction(
        found.time,
        found.measured,
        found.predicted,
        found.delayed,
        contact_floor=found.contact_floor,
        score_from=begin,
        score_to=end,
        position=found.position,
        delayed_offset=0.0,
    )


def median_window(found: Forces, length: float = 2.0) -> tuple[float, float]:
    """Of all windows of a length [s] from 1.5 s on, every 0.05 s, the first whose error is nearest to their median."""
    begins = np.arange(1.5, found.time[-1] - found.time[0] - length, 0.05)
    errors = [scored(found, begin, begin + length).prediction_error_percent for begin in begins]
    known = np.array([np.nan if error is None else error for error in errors])
    begin = float(begins[np.nanargmin(np.abs(known - np.nanmedian(known)))])
    return begin, begin + length


def zero_of(recording: Recording) -> float:
    """The zero that scoring takes [N]."""
    from foretouch.report import lowest_mean

    return lowest_mean(recording.time, recording.force)


def calibration() -> Any:
    """Share of true forces within k standard deviations, against the Gaussian."""
    multiples = np.linspace(0.0, 3.0, 61)
    figure = new_figure(5.2)
    groups = (
        ("simulated, other seeds than what was chosen on", list(held_out())),
        ("measured files", list(measured())),
    )
    gauss = np.array([100.0 * erf(k / 2**0.5) for k in multiples])
    for panel, (title, group) in zip(figure.subplots(1, 2, sharey=True), groups, strict=True):
        curves = np.array([[100.0 * float(np.mean(ratio <= k)) for k in multiples] for _, ratio in group])
        for curve in curves:
            panel.plot(multiples, curve, color=RENDERED, linewidth=0.7, alpha=0.6)
        panel.plot([], [], color=RENDERED, linewidth=0.7, label="one recording")
        panel.plot(multiples, curves.mean(axis=0), color=PREDICTED, linewidth=2.4, label="mean of all")
        panel.plot(multiples, gauss, color=TRUE, linewidth=1.6, linestyle=(0, (4, 2)), label="Gaussian")
        panel.set_title(title)
        panel.set_xlabel("k standard deviations")
        panel.legend(loc="lower right", frameon=False)
        panel.set_xlim(0.0, 3.0)
        panel.set_ylim(0.0, 101.0)
        within = {k: float(np.interp(k, multiples, curves.mean(axis=0))) for k in (1.0, 2.0)}
        print(f"{title}: {within[1.0]:.1f} % within one, {within[2.0]:.1f} % within two")
        for (name, ratio), curve in zip(group, curves, strict=True):
            print(f"  {name:28} {curve[20]:5.1f} {curve[40]:5.1f}  ({ratio.size} samples)")
    figure.axes[0].set_ylabel("true forces within [%]")
    return finished(figure, 1, above=0.5)


def held_out() -> Iterator[tuple[str, Any]]:
    """Errors in standard deviations, in contact, of simulated recordings, where anything could tell."""
    for name in SIMULATED:
        for seed in SEEDS:
            made = simulate(name, seed=seed)
            found = predicted(made.recording, 0.3)
            hidden = unforeseeable(found.time, made.truth.depth, 0.3, made.truth.changes)
            chosen = (found.time >= 3.0) & (made.truth.force > 0.0) & ~hidden & (found.standard_deviation > 0.0)
            yield f"{name}, seed {seed}", ratio(found.predicted - made.truth.force, found.standard_deviation, chosen)


def measured() -> Iterator[tuple[str, Any]]:
    """The same of the measured presses, in the windows that are scored."""
    for name, entry in DATASETS.items():
        if entry.kind == "free" or not entry.seen:
            continue
        recording = read_recording(excerpt(name))
        skin = entry.kind == "skin"
        offset = zero_of(recording) if entry.kind == "spring" else None
        found = predicted(recording, 0.02 if skin else 0.3, offset)
        window = {"score_from": 0.5, "score_to": 1.6} if skin else {}
        scores = score_prediction(
            found.time,
            found.measured,
            found.predicted,
            found.delayed,
            contact_floor=found.contact_floor,
            delayed_offset=0.0,
            **window,
        )
        since = found.time - found.time[0]
        inside = (since >= 0.5) & (since <= 1.6) if skin else since >= 1.5
        chosen = scores.in_contact & inside & (found.standard_deviation > 0.0)
        yield name, ratio(found.predicted - scores.measured_force, found.standard_deviation, chosen)


def ratio(error: Any, spread: Any, chosen: Any) -> Any:
    """Sizes of errors in standard deviations."""
    return np.abs(error[chosen]) / spread[chosen]


FIGURES: dict[str, tuple[str, Callable[[], Any]]] = {
    "forces": ("predicted-forces", forces),
    "rigid": ("predicted-rigid", rigid),
    "calibration": ("calibration", calibration),
}


def save(figure: Any, name: str) -> None:
    """Write it 900 pixels across; a palette of 128 colours looks the same and takes a third of the bytes."""
    drawn = BytesIO()
    figure.savefig(drawn, dpi=900.0 / figure.get_figwidth())
    Image.open(drawn).convert("RGB").quantize(128).save(IMAGES / f"{name}.png", optimize=True)


def main(names: list[str]) -> None:
    """Draw these, or all."""
    unknown = set(names) - FIGURES.keys()
    if unknown:
        raise SystemExit(f"no such figure: {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    for name in names or FIGURES:
        file, drawn = FIGURES[name]
        save(drawn(), file)


if __name__ == "__main__":
    main(sys.argv[1:])
