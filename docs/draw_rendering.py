"""Draw how a model change is let in, and the energy account of it: `docs/images/rendering-mediation.png`.

Usage: `.venv/bin/python docs/draw_rendering.py`; it takes a few seconds.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

from foretouch.devices import DeviceSpecification
from foretouch.models import KelvinVoigt
from foretouch.rendering import Renderer

mpl.use("Agg")
IMAGE = Path(__file__).parent / "images" / "rendering-mediation.png"
TICK = 1e-3
SOFT, STIFF, WEAK = KelvinVoigt(300.0, 4.0), KelvinVoigt(900.0, 4.0), KelvinVoigt(200.0, 4.0)
CHANGES = {0: SOFT, 700: STIFF, 1900: WEAK}
"""Models by the tick in which they come."""


def hand(time: float) -> float:
    """Depth of a hand that presses, holds with a tremor, presses on and leaves [m]."""
    knots = (0.0, 0.2, 0.5, 1.0, 1.5, 2.2, 2.6, 3.0)
    depths = (-1e-3, -1e-3, 4e-3, 4e-3, 6e-3, 6e-3, -1e-3, -1e-3)
    return float(np.interp(time, knots, depths)) + 1.5e-4 * np.sin(2.0 * np.pi * 3.0 * time)


def run() -> np.ndarray:
    """Time, wanted, mediated and rendered force, energy, and its bound, a row a tick."""
    renderer, rows = Renderer(DeviceSpecification(damping=2.0)), []
    renderer.engage(hand(0.0), hand(0.0))
    for tick in range(3000):
        if tick in CHANGES:
            renderer.adopt(CHANGES[tick], 0.0, message=tick + 1)
        force = renderer.update(tick * TICK, hand(tick * TICK), TICK)
        wanted, mediated = renderer.predictor.force, renderer.mediation.force
        rows.append((tick * TICK, wanted, mediated, force, *renderer.booked[:2]))
    return np.array(rows)


def main() -> None:
    """Draw it."""
    import matplotlib.pyplot as plt

    time, wanted, _, rendered, energy, bound = run().T
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8.0, 5.0), layout="constrained")
    above.plot(time, wanted, color="0.6", label="newest model, F")
    above.plot(time, rendered, color="C0", label="given to the hand, f")
    above.set_ylabel("force [N]")
    below.plot(time, 1e3 * energy, color="C2", label="energy that the hand has put in, E")
    below.plot(time, -1e3 * bound, color="C3", label="-F D: never below")
    below.set_ylabel("energy [mJ]")
    below.set_xlabel("time [s]")
    for axes in (above, below):
        for tick in list(CHANGES)[1:]:
            axes.axvline(tick * TICK, color="0.8", linestyle=":")
        axes.legend(loc="upper left")
    figure.savefig(IMAGE, dpi=90)


if __name__ == "__main__":
    main()
