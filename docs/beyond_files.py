"""What is asked of the prediction beyond the measured files, and how far each of it is met.

Forces are 0.3 s late and all settings the default ones. Nothing was chosen on the seeds. The generators are those of
the tests. `docs/measure_results.py reach-simulated` writes the table.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
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


def changes(seed: int) -> list[tuple[str, float, float]]:
    """Materials, factors of their force, and moments of the change [s]: another one for each factor."""
    cases = [(material, factor) for material in MATERIALS for factor in FACTORS]
    return [(*case, MOMENTS[(seed + index) % len(MOMENTS)]) for index, case in enumerate(cases)]


def noticed(seed: int) -> list[float]:
    """After how much contact each change is said [s]."""
    found = []
    for material, factor, at in changes(seed):
        recording, force = pressed(material, factor, at, seed)
        times = [time for time in said(recording) if time >= at]
        felt = (recording.time >= at) & (recording.time < min(times, default=at)) & (force > 0.05)
        found.append(PERIOD * int(felt.sum()) if times else math.inf)
    return found


class Case(NamedTuple):
    """A recording, and the error [%] of a force that is predicted for it."""

    recording: Recording
    error: Callable[[Array], float]


Made = Callable[[int], Case]
"""A case of a seed."""


def of(made: Made) -> Callable[[int], list[float]]:
    """The error of what the default learner predicts [%]."""

    def measure(seed: int) -> list[float]:
        case = made(seed)
        return [case.error(late(case.recording))]

    return measure


def harder(material: str, factor: float, at: float) -> Made:
    """Presses of a material that becomes softer or harder at a moment [s]: error in contact from 1 s after it."""

    def make(seed: int) -> Case:
        recording, force = pressed(material, factor, at, seed)
        where = (recording.time > at + 1.0) & (force > 0.05)
        return Case(recording, lambda predicted: relative(predicted, force, where))

    return make


def after_change(seed: int) -> list[float]:
    """Errors from 1 s after each change on [%]."""
    return [error for change in changes(seed) for error in of(harder(*change))(seed)]


LAYER = 0.005
"""Depth of the hard layer below the surface of soft tissue of 400 N/m [m]."""


def layered(hardness: float, deepest: float, below: bool) -> Made:
    """Error above a layer that is reached from 12 s on, after its first touch, or in it from the second touch on."""

    def make(seed: int) -> Case:
        depth = walls.pressed((0.004, deepest), seed, 0.05)
        force = 400.0 * (np.maximum(depth, 0.0) + (hardness - 1.0) * np.maximum(depth - LAYER, 0.0))
        inside = depth > LAYER
        touches = np.cumsum(np.diff(inside.astype(int), prepend=0) > 0)
        where = inside & (touches > 1) if below else (touches > 0) & (depth > 0.0005) & (depth < 0.0048)
        felt = walls.felt(walls.WALL + depth, force, seed)
        return Case(felt, lambda predicted: relative(predicted, force, where))

    return make


def moved(way: float) -> Made:
    """Error on a wall of 20 kN/m from 7 s after it moved on, in contact or where contact is predicted."""

    def make(seed: int) -> Case:
        recording, force = walls.touched(way, seed)
        after = walls.MOVED + 7.0 < walls.TIME

        def error(predicted: Array) -> float:
            scored, felt = after & ((force > 0.4) | (predicted > 0.4)), after & (force > 0.4)
            return float(100.0 * np.sqrt(np.mean((predicted - force)[scored] ** 2) / np.mean(force[felt] ** 2)))

        return Case(recording, error)

    return make


def sensed(
    *, zero: float = 0.3, rate: float = 0.0, noise: float = 0.02, silent: float = 0.0, rubs: float = 0.0
) -> Made:
    """Presses that a sensor shows with a zero [N] that drifts [N/s], noise [N], and the friction [N] of a mechanism.

    It says 0 for its first seconds. Friction is a part of what is felt in contact.
    """

    def make(seed: int) -> Case:
        position, force = drift.pressed(seed)
        rubbing = rubs * np.tanh(np.gradient(position, drift.TIME) / 2e-3)
        noises = np.random.default_rng(seed).normal(0.0, noise, drift.TIME.size)
        sensor = np.where(silent > drift.TIME, 0.0, force + rubbing + zero + rate * drift.TIME + noises)
        true = force + np.where(force > 0.0, rubbing, 0.0)
        return Case(Recording(drift.TIME, position, sensor), lambda predicted: drift.error(predicted, true))

    return make


def sticking(seed: int) -> Case:
    """What pulls: error against the true force from 6 s on."""
    position = pulls.pressed(seed)
    true = pulls.sticky(position)
    felt = Recording(pulls.TIME, position, pulls.sensed(true, seed))
    return Case(felt, lambda predicted: relative(predicted, true, pulls.TIME > 6.0))


def reported(seed: int) -> list[float]:
    """By how much the error that a report gives of what pulls differs from that against the true force [points]."""
    (recording, error), time = sticking(seed), pulls.TIME
    predicted, known = late(recording), delayed_force(time, recording.force, DELAY)
    motion = {"position": recording.position, "contact_floor": recording.contact_floor}
    given = score_prediction(time, recording.force, predicted, known, score_from=6.0, **motion).prediction_error_percent
    return [math.inf if given is None else abs(given - error(predicted))]


def surface(seed: int) -> list[float]:
    """How far the surface that is found lies from the true one [mm]."""
    return [1e3 * abs(surfaces.found(surfaces.press(surfaces.LAWS["1.35"], seed)).surface)]


def law(seed: int) -> list[float]:
    """Errors of the parameters of a law of exponent 1.35, and of its surface, in their standard errors."""
    own = surfaces.LAWS["1.35"]
    return list(surfaces.errors_of(surfaces.found(surfaces.press(own, seed), "hunt-crossley", "offline"), own).values())


NONE = math.nan

CASES: dict[str, tuple[float, Made]] = {
    "layer 10 times as hard, above it": (5.0, layered(10.0, 0.0056, False)),
    "layer 10 times as hard, in it from the second touch": (5.0, layered(10.0, 0.0056, True)),
    "layer 66 times as hard, above it": (5.0, layered(66.0, 0.0053, False)),
    "layer 66 times as hard, in it from the second touch": (8.0, layered(66.0, 0.0053, True)),
    "wall 3 mm further in": (1.5, moved(0.003)),
    "wall 3 mm further out": (1.5, moved(-0.003)),
    "zero that drifts by 0.05 N/s": (2.0, sensed(rate=0.05)),
    "zero that drifts by -0.05 N/s": (2.0, sensed(rate=-0.05)),
    "sensor that says 0 for its first 0.1 s": (1.5, sensed(zero=0.5, silent=0.1)),
    "noise of 0.1 N": (1.2, sensed(noise=0.1)),
    "friction of the mechanism, 0.1 N": (NONE, sensed(rubs=0.1)),
    "friction of the mechanism, 0.3 N": (NONE, sensed(rubs=0.3)),
    "`adhesive`, against the true force": (4.0, sticking),
}
"""Presses whose true force is known, and the largest error that is asked for [%]."""

ASKED: tuple[Asked, ...] = (
    *(Asked(f"`{name}`", "%", 4.0, 7.0, simulated(name)) for name in SIMULATED),
    Asked("stiffness times 0.3 to 3, noticed after", "s of contact", 0.3, 0.3, noticed),
    Asked("stiffness times 0.3 to 3, from 1 s after", "%", 4.0, 4.0, after_change),
    *(Asked(what, "%", most, most, of(made)) for what, (most, made) in CASES.items()),
    Asked("error that a report gives of `adhesive`, off by", "points", 1.0, 1.0, reported),
    Asked("surface found, off by", "mm", 0.1, 0.1, surface, range(100, 108)),
    Asked("`identify`, exponent 1.35", "", NONE, NONE, law, LAWS),
)
"""The lines of the table; of the last it is counted how often it holds."""


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
    met = (
        "not asked" if math.isnan(asked.most) else {(True, True): "yes", (True, False): "in the median"}.get(kept, "no")
    )
    words = f" [{asked.unit}]" if asked.unit else ""
    shown = [figure(value) if math.isfinite(value) else "never" for value in (middle, most)]
    asked_for = (
        limit(asked.middle)
        if asked.middle == asked.most or math.isnan(asked.most)
        else f"{limit(asked.middle)} / {limit(asked.most)}"
    )
    return [f"{asked.what}{words}", str(len(found)), asked_for, *shown, met]


def counted(found: list[list[float]]) -> Row:
    """Of how many laws each parameter lies inside two standard errors, of that which does least."""
    inside = [sum(error <= 2.0 for error in errors) for errors in zip(*found, strict=True)]
    met = "yes" if min(inside) >= 19 else "no"
    head = "`identify`, exponent 1.35: seeds with each parameter inside two standard errors"
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
