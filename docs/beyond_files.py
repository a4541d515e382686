"""What is asked of the prediction beyond the measured files, and how far each of it is met.

Forces are 0.3 s late and all settings the default ones. Nothing was chosen on the seeds. The generators are those of the
tests. `docs/measure_results.py reach-simulated` writes the table.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from measure_changes import FACTORS, MATERIALS, MOMENTS, PERIOD, pressed, said
from measuring import Row, figure, table

from foretouch.comparison import SIMULATED, simulate, unforeseeable
from foretouch.comparison.combination import score_outside
from foretouch.identification import Learner, predict
from foretouch.quantities import Array, Flags, Recording
from foretouch.report import delayed_force, forces_under_delay, score_prediction

TESTS = Path(__file__).resolve().parents[1] / "tests" / "identification"
sys.path.insert(0, str(TESTS))  # the presses are the tests' own

import test_identification_drift as drift  # noqa: E402
import test_identification_pulls as pulls  # noqa: E402
import test_identification_surface_error as surfaces  # noqa: E402
import test_identification_walls as walls  # noqa: E402

__all__ = ["beyond"]

DELAY = 0.3  # [s]
SEEDS = range(100, 110)
LAWS = range(100, 120)
"""Of the presses by which laws are identified: 19 of 20 are asked for."""


class Asked(NamedTuple):
    """One line of the table.

    Attributes:
        what: Is asked.
        unit: Of the numbers.
        middle: Largest median, NaN where none is asked for.
        most: Largest value, NaN where none is asked for.
        measure: The values of a seed.
        seeds: On which it is measured.
    """

    what: str
    unit: str
    middle: float
    most: float
    measure: Callable[[int], list[float]]
    seeds: range = SEEDS


def late(recording: Recording) -> Array:
    """The force that is predicted from forces of the last delay and before [N]."""
    return predict(recording, Learner(), delay=DELAY).force


def relative(predicted: Array, force: Array, where: Flags) -> float:
    """RMS error relative to the RMS of the true force [%]."""
    return float(100.0 * np.sqrt(np.mean((predicted - force)[where] ** 2) / np.mean(force[where] ** 2)))


def simulated(name: str) -> Callable[[int], list[float]]:
    """As `foretouch compare --simulated`, without what nothing before t - delay could tell."""

    def measure(seed: int) -> list[float]:
        one = simulate(name, seed=seed)
        forces = forces_under_delay(one.recording, Learner(contact_floor=one.recording.contact_floor), DELAY)
        hidden = unforeseeable(one.recording.time, one.truth.depth, DELAY, one.truth.changes)
        error = score_outside(forces, hidden, score_from=3.0).prediction_error_percent
        return [math.inf if error is None else error]

    return measure


def changed(seed: int) -> Iterator[tuple[Recording, Array, float]]:
    """Presses of two materials that become softer or harder, each at another moment; and when."""
    cases = [(material, factor) for material in MATERIALS for factor in FACTORS]
    for index, (material, factor) in enumerate(cases):
        at = MOMENTS[(seed + index) % len(MOMENTS)]
        yield *pressed(material, factor, at, seed), at


def noticed(seed: int) -> list[float]:
    """After how much contact each change is said [s]."""
    found = []
    for recording, force, at in changed(seed):
        times = [time for time in said(recording) if time >= at]
        felt = (recording.time >= at) & (recording.time < times[0]) & (force > 0.05) if times else np.array([])
        found.append(PERIOD * float(felt.sum()) if times else math.inf)
    return found


def after_change(seed: int) -> list[float]:
    """Errors in contact from 1 s after each change on [%]."""
    return [
        relative(late(recording), force, (recording.time > at + 1.0) & (force > 0.05))
        for recording, force, at in changed(seed)
    ]


LAYER = 0.005
"""Depth of the hard layer below the surface of soft tissue of 400 N/m [m]."""


def layered(hardness: float, deepest: float, below: bool) -> Callable[[int], list[float]]:
    """Error above a layer that is reached from 12 s on, after its first touch, or below from the second touch on [%]."""

    def measure(seed: int) -> list[float]:
        depth = walls.pressed((0.004, deepest), seed, 0.05)
        force = 400.0 * (np.maximum(depth, 0.0) + (hardness - 1.0) * np.maximum(depth - LAYER, 0.0))
        predicted = late(walls.felt(walls.WALL + depth, force, seed))
        inside = depth > LAYER
        touches = np.cumsum(np.diff(inside.astype(int), prepend=0) > 0)
        above = (touches > 0) & (depth > 0.0005) & (depth < 0.0048)
        return [relative(predicted, force, inside & (touches > 1) if below else above)]

    return measure


def moved(way: float) -> Callable[[int], list[float]]:
    """Error on a wall of 20 kN/m from 7 s after it moved on, in contact or where contact is predicted [%]."""

    def measure(seed: int) -> list[float]:
        recording, force = walls.touched(way, seed)
        predicted, after = late(recording), walls.MOVED + 7.0 < walls.TIME
        scored, felt = after & ((force > 0.4) | (predicted > 0.4)), after & (force > 0.4)
        return [float(100.0 * np.sqrt(np.mean((predicted - force)[scored] ** 2) / np.mean(force[felt] ** 2)))]

    return measure


def sensed(sensor: Callable[[Array, Array], Array], noise: float = 0.02) -> Callable[[int], list[float]]:
    """Error [%] of presses whose sensor adds this, of position and force, to the true force; and white noise [N]."""

    def measure(seed: int) -> list[float]:
        position, force = drift.pressed(seed)
        noises = np.random.default_rng(seed).normal(0.0, noise, drift.TIME.size)
        felt = sensor(position, force) + noises
        felt[:100] = 0.0 if sensor is begins_late else felt[:100]
        rubbing = sensor(position, force) - force - 0.3 if isinstance(sensor, Rubbing) else 0.0
        return [drift.error(late(Recording(drift.TIME, position, felt)), force + np.where(force > 0.0, rubbing, 0.0))]

    return measure


class Rubbing(NamedTuple):
    """A mechanism that rubs against its motion."""

    friction: float  # [N]

    def __call__(self, position: Array, force: Array) -> Array:
        """What the sensor shows [N]."""
        return force + 0.3 + self.friction * np.tanh(np.gradient(position, drift.TIME) / 2e-3)


class Drifting(NamedTuple):
    """A zero that drifts."""

    rate: float  # [N/s]

    def __call__(self, _: Array, force: Array) -> Array:
        """What the sensor shows [N]."""
        return force + 0.3 + self.rate * drift.TIME


def begins_late(_: Array, force: Array) -> Array:
    """A zero of half a newton, of which a sensor says nothing at first [N]."""
    return force + 0.5


def adhesive(scored: bool) -> Callable[[int], list[float]]:
    """Error of what pulls against the true force from 6 s on [%], or by how much the score differs from it [points]."""

    def measure(seed: int) -> list[float]:
        position, time = pulls.pressed(seed), pulls.TIME
        true = pulls.sticky(position)
        sensor = pulls.sensed(true, seed)
        predicted = late(Recording(time, position, sensor))
        error = relative(predicted, true, time > 6.0)
        if not scored:
            return [error]
        known = delayed_force(time, sensor, DELAY)
        scores = score_prediction(time, sensor, predicted, known, contact_floor=0.05, score_from=6.0, position=position)
        given = scores.prediction_error_percent
        return [math.inf if given is None else abs(given - error)]

    return measure


def surface(seed: int) -> list[float]:
    """How far the surface that is found lies from the true one [mm]."""
    return [1e3 * abs(surfaces.found(surfaces.press(surfaces.LAWS["1.35"], seed)).surface)]


def law(seed: int) -> list[float]:
    """Errors of the parameters of a law of exponent 1.35, and of its surface, in their standard errors."""
    own = surfaces.LAWS["1.35"]
    return list(surfaces.errors_of(surfaces.found(surfaces.press(own, seed), "hunt-crossley", "offline"), own).values())


NONE = math.nan

ASKED: tuple[Asked, ...] = (
    *(Asked(f"`{name}`", "%", 4.0, 7.0, simulated(name)) for name in SIMULATED),
    Asked("stiffness 0.3 to 3 times as large: noticed after", "s of contact", 0.3, 0.3, noticed),
    Asked("the same: error from 1 s after", "%", 4.0, 4.0, after_change),
    Asked("layer 10 times as hard: above it", "%", 5.0, 5.0, layered(10.0, 0.0056, False)),
    Asked("the same: in it, from the second touch", "%", 5.0, 5.0, layered(10.0, 0.0056, True)),
    Asked("layer 66 times as hard: above it", "%", 5.0, 5.0, layered(66.0, 0.0053, False)),
    Asked("the same: in it, from the second touch", "%", 8.0, 8.0, layered(66.0, 0.0053, True)),
    Asked("wall 3 mm further in", "%", 1.5, 1.5, moved(0.003)),
    Asked("wall 3 mm further out", "%", 1.5, 1.5, moved(-0.003)),
    Asked("zero that drifts by 0.05 N/s", "%", 2.0, 2.0, sensed(Drifting(0.05))),
    Asked("zero that drifts by -0.05 N/s", "%", 2.0, 2.0, sensed(Drifting(-0.05))),
    Asked("sensor that says 0 for its first 0.1 s", "%", 1.5, 1.5, sensed(begins_late)),
    Asked("noise of 0.1 N", "%", 1.2, 1.2, sensed(Drifting(0.0), noise=0.1)),
    Asked("friction of the mechanism of 0.1 N", "%", NONE, NONE, sensed(Rubbing(0.1))),
    Asked("friction of the mechanism of 0.3 N", "%", NONE, NONE, sensed(Rubbing(0.3))),
    Asked("`adhesive`, against the true force", "%", 4.0, 4.0, adhesive(False)),
    Asked("the same: score of the report less that", "points", 1.0, 1.0, adhesive(True)),
    Asked("surface found, off by", "mm", 0.1, 0.1, surface, range(100, 108)),
    Asked("`identify`, exponent 1.35", "", NONE, NONE, law, LAWS),
)
"""The lines of the table but for the last, which is counted otherwise."""


def values(number: int, seed: int) -> list[float]:
    """Of a line, for a seed: by its number, for a function made here cannot be sent to another process."""
    return ASKED[number].measure(seed)


def limit(value: float) -> str:
    """What is asked for."""
    return "–" if math.isnan(value) else f"{value:g}"


def row(asked: Asked, found: list[float]) -> Row:
    """A line of the table."""
    middle, most = median(found), max(found)
    kept = not middle > asked.middle, not most > asked.most
    met = "not asked" if math.isnan(asked.most) else {(True, True): "yes", (True, False): "in the median"}.get(kept, "no")
    words = f" [{asked.unit}]" if asked.unit else ""
    shown = [figure(value) if math.isfinite(value) else "never" for value in (middle, most)]
    asked_for = limit(asked.middle) if asked.middle == asked.most else f"{limit(asked.middle)} / {limit(asked.most)}"
    return [f"{asked.what}{words}", str(len(found)), asked_for, *shown, met]


def counted(found: list[list[float]]) -> Row:
    """Of how many laws each parameter lies inside two standard errors, of that which does least."""
    inside = [sum(error <= 2.0 for error in errors) for errors in zip(*found, strict=True)]
    met = "yes" if min(inside) >= 19 else "no"
    head = "`identify`, exponent 1.35: seeds with a parameter inside two standard errors"
    return [head, str(len(found)), "at least 19", figure(median(inside)), f"{min(inside)}", met]


def beyond() -> str:
    """The table, two seeds at a time."""
    from joblib import Parallel, delayed

    late(simulate("tapping").recording)  # compiled once
    jobs = [(number, seed) for number, asked in enumerate(ASKED) for seed in asked.seeds]
    done = dict(zip(jobs, Parallel(n_jobs=2)(delayed(values)(*job) for job in jobs), strict=True))
    rows = []
    for number, asked in enumerate(ASKED):
        found = [done[number, seed] for seed in asked.seeds]
        rows.append(counted(found) if asked.measure is law else row(asked, [one for seed in found for one in seed]))
    return table(("Beyond the files", "Cases", "Asked", "Median", "Worst", "Met"), rows)
