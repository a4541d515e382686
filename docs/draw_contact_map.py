"""Draw a learnt contact map on one measured foam: force over depth with its band, and over time under a delay.

Usage: `.venv/bin/python docs/draw_contact_map.py`; the image goes to `docs/images`. It takes some
seconds.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from foretouch.identification import Learner, predict
from foretouch.identification.learner import LearntModel
from foretouch.models import advance
from foretouch.quantities.colours import DELAYED, css
from foretouch.recordings import excerpt, read_recording
from foretouch.report import COLOURS, delayed_force, lowest_mean, new_figure

IMAGE = Path(__file__).parent / "images" / "contact-map-foam.png"
NAME = "tue/d-foam2"
DELAY = 0.3
"""Of the forces [s]."""
SPEEDS = (0.005, 0.03)
"""Of the presses that the map is asked about [m/s]."""
WINDOW = (2.5, 4.5)
"""Of the plot over time [s]."""


def main() -> None:
    """Draw the figure."""
    recording = read_recording(excerpt(NAME))
    force = recording.force - lowest_mean(recording.time, recording.force)
    figure = new_figure(4.2)
    depths, times = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    draw_depths(depths, recording.time, recording.position, force, learnt(recording))
    draw_times(times, recording, force)
    figure.tight_layout()
    figure.savefig(IMAGE, dpi=90)


def learnt(recording: Any) -> LearntModel:
    """What is known after the whole file."""
    learner = Learner(contact_floor=recording.contact_floor)
    for time, position, force in zip(
        recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True
    ):
        learner.update(time, position, force)
    return learner.learnt()


def press(found: LearntModel, deepest: float, speed: float) -> np.ndarray:
    """One press in and out at an even speed: depth [m], force and its standard deviation [N], shape (3, n)."""
    assert found.model is not None
    period = 1e-3
    down = np.arange(-0.001, deepest, speed * period)
    state, rows = found.model.initial_state(), []
    for depth, velocity in [(x, speed) for x in down] + [(x, -speed) for x in down[::-1]]:
        state, force, deviation = advance(found.model, state, float(depth), velocity, period)
        rows.append((depth, force, deviation))
    return np.array(rows).T


def draw_depths(axes: Any, time: np.ndarray, position: np.ndarray, force: np.ndarray, found: LearntModel) -> None:
    """Measured forces, and what the map says of presses in and out, a millimetre deeper than ever too."""
    depth = position - found.surface
    axes.plot(1e3 * depth, force, color="0.8", linewidth=0.6, label="measured")
    deepest = float(depth.max())
    for speed, colour in zip(SPEEDS, COLOURS, strict=False):
        x, f, deviation = press(found, deepest + 0.001, speed)
        axes.plot(1e3 * x, f, color=colour, label=f"map, {1e3 * speed:g} mm/s")
        half = x.size // 2
        band = slice(0, half)
        axes.fill_between(
            1e3 * x[band], f[band] - deviation[band], f[band] + deviation[band], color=colour, alpha=0.2, linewidth=0.0
        )
    axes.axvline(1e3 * deepest, color="0.6", linestyle=":", linewidth=0.8)
    axes.text(1e3 * deepest, 0.02, "deepest ", ha="right", transform=axes.get_xaxis_transform(), color="0.4")
    axes.set(xlabel="depth [mm]", ylabel="force [N]", title=f"{NAME}: what is learnt by the end")
    axes.legend(fontsize="small", frameon=False, loc="upper left")


def draw_times(axes: Any, recording: Any, force: np.ndarray) -> None:
    """True, predicted and delayed force."""
    learner = Learner(contact_floor=recording.contact_floor)
    found = predict(recording, learner, delay=DELAY)
    time = recording.time - recording.time[0]
    late = delayed_force(recording.time, force, DELAY)
    predicted, deviation = found.force, found.standard_deviation
    axes.plot(time, late, color=css(DELAYED), linewidth=0.9, label=f"felt, {1e3 * DELAY:g} ms late")
    axes.plot(time, force, color="black", linewidth=1.2, label="felt")
    axes.plot(time, predicted, color=COLOURS[0], linewidth=1.0, label="predicted")
    axes.fill_between(time, predicted - deviation, predicted + deviation, color=COLOURS[0], alpha=0.2, linewidth=0.0)
    axes.set(xlabel="time [s]", ylabel="force [N]", xlim=WINDOW, title="predicted under a delay of 300 ms")
    axes.legend(fontsize="small", frameon=False, loc="upper right", ncols=3)


if __name__ == "__main__":
    main()
