"""Fit of the hysteretic contact law to recordings of one foam."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, SettingError
from foretouch.quantities import Recording
from foretouch.robot.materials.contacts import Branch, HystereticContact, Spring

Array = NDArray[np.float64]

FOAM_DATASETS = ("tue/a-foam", "tue/b-foam", "tue/b-foam3", "tue/d-foam2", "tue/e-foam2")
"""The measured recordings that the shipped coefficients are fitted to, by their names in the recordings room."""

FOAM_PROVENANCE = (
    "TU/e course 4SC040 Haptics 2018, GitHub Ohara124c41/Haptics-Bilateral_Teleoperation-1DOF_Experiments, "
    "commit 2ae23ed4f6e6b9726be4153a1f094085124c0c57, folder m2_question1, MIT licence; force = raw bridge, "
    "its absolute scale is undocumented; fitted again by: foretouch materials fit foam-measured"
)

PERIOD = 1e-3  # of the samples that the fit uses [s]
APPROACH = 0.2  # time in which the untouched material is brought to the first sample [s]
SETTLING = 0.2  # first part of a file, not scored: what was done to the foam before it is not known [s]
SPRING_KNOTS = (0.0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 7e-3, 9e-3, 17e-3)  # the last ramp is open beyond the data [m]
RAMPS = ((0.0, 1e-3), (0.0, 3e-3), (2e-3, 4e-3), (5e-3, 11e-3))  # where branches engage [m]
SLIP = 0.7e-3  # deflection at which a branch slips [m]
RELAXATIONS = (0.004, 0.3)  # the short one is the damping [s]
SMALLEST_OFFSET = -0.1  # the true zero may lie this far below the lowest 50 ms mean [N]
TYPICAL_DEPTH = 3.5e-3  # first guess of the deflection at 2 N, where the steep part is [m]
SEARCH_STEPS = (1e-3, 0.5e-3, 0.25e-3)  # of the surfaces [m]


class FittedFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What belongs to one recording alone.

    Attributes:
        name: The recording's name.
        surface: Position of the undeformed surface [m].
        force_offset: What the sensor shows in free air [N].
        residual_percent: RMS error of the law over the contact samples, in percent of their RMS force.
    """

    name: str
    surface: float
    force_offset: float
    residual_percent: float


class FoamFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Coefficients of a `HystereticContact` and where they come from.

    Attributes:
        provenance: Origin of the recordings, one line.
        measured_depth: Deepest deflection in the recordings [m].
        springs: (start [m], end [m], force [N]) each.
        branches: (start [m], end [m], stiffness [N/m], slip force [N], relaxation time [s]) each; None is infinite.
        files: One entry for each recording.
    """

    provenance: str
    measured_depth: float
    springs: tuple[Spring, ...]
    branches: tuple[tuple[float, float, float, float | None, float | None], ...]
    files: tuple[FittedFile, ...]

    def model(self) -> HystereticContact:
        """The contact law."""
        branches = tuple((a, b, k, _unbounded(r), _unbounded(tau)) for a, b, k, r, tau in self.branches)
        return HystereticContact(self.springs, branches)


def _unbounded(value: float | None) -> float:
    return math.inf if value is None else value


def fit_foam(recordings: Sequence[Recording], *, provenance: str = FOAM_PROVENANCE) -> FoamFit:
    """Fit one law to several recordings of one foam; each has its own surface and force offset.

    For given surfaces the law is linear in its strengths, and all are found at once as a non-negative least squares
    problem (so that the result is passive); the surfaces are found by a coordinate search. Whole files are used:
    this makes a material, it predicts nothing.

    Args:
        recordings: Presses of the same foam; every one must pass 2 N.
        provenance: Goes into the result.

    Returns:
        The coefficients. `FittedFile.residual_percent` comes from the law itself, run through `advance`.

    Raises:
        SettingError: No recordings.
        RecordingError: A recording that never passes 2 N.
    """
    if not recordings:
        raise SettingError("recordings", 0, "at least one recording is needed")
    presses = [_Press(recording) for recording in recordings]
    surfaces = [press.first_surface() for press in presses]
    best, cost = _solve(presses, surfaces)
    for size in SEARCH_STEPS:
        improved = True
        while improved:
            improved = False
            for trial in _neighbours(surfaces, size):
                strengths, trial_cost = _solve(presses, trial)
                if trial_cost < 0.999 * cost:
                    best, cost, surfaces, improved = strengths, trial_cost, trial, True
                    break
    return _result(recordings, presses, surfaces, best, provenance)


def replay(model: HystereticContact, recording: Recording, surface: float) -> tuple[Array, Array]:
    """Times [s] (1 kHz, from the first sample) and force of the law [N] along the motion of a recording."""
    path = _with_approach(_Press(recording).position - surface)
    state, force = model.initial_state(), np.empty(path.size)
    for k, depth in enumerate(path.tolist()):
        state, force[k], _ = model.advance(state, depth, math.nan, PERIOD)
    force = force[round(APPROACH / PERIOD) :]
    times = np.arange(force.size, dtype=np.float64) * PERIOD
    return times, force


def foam_fit_json(fit: FoamFit) -> bytes:
    """A fit as JSON, as it is shipped."""
    return msgspec.json.format(msgspec.json.encode(fit), indent=1) + b"\n"


class _Press:
    """A recording on a 1 kHz grid, its force less the lowest 50 ms mean."""

    def __init__(self, recording: Recording) -> None:
        time = recording.time - recording.time[0]
        grid = np.arange(1, int(time[-1] / PERIOD) - 1) * PERIOD
        steps = np.diff(time) * 0.5 * (recording.force[1:] + recording.force[:-1])
        impulse = np.concatenate(([0.0], np.cumsum(steps)))
        edges = [np.interp(grid + side, time, impulse) for side in (-PERIOD / 2, PERIOD / 2)]
        force = (edges[1] - edges[0]) / PERIOD  # mean over each grid interval: no lag
        self.position = np.interp(grid, time, recording.position)
        self.zero = float(np.convolve(force, np.full(50, 0.02), "valid").min())
        self.force = force - self.zero
        self.contact = self.force > max(recording.contact_floor, 0.05 * float(np.percentile(self.force, 98)))
        self.contact[: round(SETTLING / PERIOD)] = False
        self.scale = float(np.sqrt(np.mean(self.force[self.contact] ** 2))) if self.contact.any() else math.nan
        self.name = Path(recording.name).name

    def first_surface(self) -> float:
        upward = (self.force[:-1] < 2.0) & (self.force[1:] >= 2.0)
        if not upward.any():
            raise RecordingError(self.name, "the force never rises past 2 N: too light a press to fit a foam to")
        return float(np.mean(self.position[1:][upward])) - TYPICAL_DEPTH


def _neighbours(surfaces: list[float], size: float) -> Iterator[list[float]]:
    for index in range(len(surfaces)):
        for change in (-size, size):
            trial = list(surfaces)
            trial[index] += change
            yield trial


def _with_approach(depth: Array) -> Array:
    """The path of deflections, led to from the untouched surface by half a cosine."""
    count = round(APPROACH / PERIOD)
    rise = 0.5 - 0.5 * np.cos(np.pi * np.arange(count) / count)
    return np.concatenate((max(depth[0], 0.0) * rise, depth))


def _ramp(y: Array, start: float, end: float) -> Array:
    return np.clip((y - start) / (end - start), 0.0, 1.0)


def _parts() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Candidates, in the order of the columns of `_columns`; slip per unit stiffness [m]."""
    for start, end in pairwise(SPRING_KNOTS):
        yield "spring", (start, end)
    for start, end in RAMPS:
        yield "branch", (start, end, SLIP, math.inf)
        for relaxation in RELAXATIONS:
            yield "branch", (start, end, math.inf, relaxation)
            yield "branch", (start, end, SLIP, relaxation)


def _columns(press: _Press, surface: float) -> Array:
    """Force of every candidate at unit strength along a press, shape (samples, candidates)."""
    from foretouch.robot.materials.kernels import branch_response

    path = np.maximum(_with_approach(press.position - surface), 0.0)
    columns = []
    for kind, numbers in _parts():
        if kind == "spring":
            columns.append(_ramp(path, *numbers))
        else:
            columns.append(branch_response(path, PERIOD, *numbers))
    return np.column_stack(columns)[round(APPROACH / PERIOD) :]


def _solve(presses: Sequence[_Press], surfaces: Sequence[float]) -> tuple[Array, float]:
    """Strengths (then one offset for each press, above the smallest) and the cost, by normal equations."""
    from scipy.optimize import nnls

    count = sum(1 for _ in _parts())
    size = count + len(presses)
    gram, right, square = np.zeros((size, size)), np.zeros(size), 0.0
    for index, (press, surface) in enumerate(zip(presses, surfaces, strict=True)):
        rows = np.zeros((press.force.size, size))
        rows[:, :count] = _columns(press, surface)
        rows[:, count + index] = 1.0
        rows = rows[round(SETTLING / PERIOD) :] / press.scale
        force = (press.force[round(SETTLING / PERIOD) :] - SMALLEST_OFFSET) / press.scale
        gram += rows.T @ rows / force.size
        right += rows.T @ force / force.size
        square += float(force @ force) / force.size
    width = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    factor = np.linalg.cholesky(gram / np.outer(width, width) + 1e-9 * np.eye(size))
    strengths = nnls(factor.T, np.linalg.solve(factor, right / width))[0] / width
    return strengths, float(strengths @ gram @ strengths - 2.0 * strengths @ right + square)


def _result(
    recordings: Sequence[Recording],
    presses: Sequence[_Press],
    surfaces: Sequence[float],
    strengths: Array,
    provenance: str,
) -> FoamFit:
    """Round, drop what is nothing, and score the law as it will run."""
    springs: list[Spring] = []
    branches: list[Branch] = []
    for (kind, numbers), strength in zip(_parts(), strengths.tolist(), strict=False):
        rounded = float(f"{strength:.4g}")
        if kind == "branch" and rounded > 0.1:  # N/m
            start, end, slip, relaxation = numbers
            branches.append((start, end, rounded, float(f"{strength * slip:.4g}"), relaxation))
        elif kind == "spring" and rounded > 1e-3:  # N
            springs.append((numbers[0], numbers[1], rounded))
    model = HystereticContact(tuple(springs), tuple(branches))
    offsets = strengths[-len(presses) :] + SMALLEST_OFFSET
    files = []
    for recording, press, surface, offset in zip(recordings, presses, surfaces, offsets.tolist(), strict=True):
        error = (replay(model, recording, surface)[1] + offset - press.force)[press.contact]
        residual = 100.0 * float(np.sqrt(np.mean(error**2))) / press.scale
        files.append(FittedFile(press.name, round(surface, 6), round(press.zero + offset, 4), round(residual, 2)))
    return FoamFit(
        provenance=provenance,
        measured_depth=round(max(float(p.position.max()) - s for p, s in zip(presses, surfaces, strict=True)), 6),
        springs=model.springs,
        branches=tuple((a, b, k, _bounded(r), _bounded(tau)) for a, b, k, r, tau in model.branches),
        files=tuple(files),
    )


def _bounded(value: float) -> float | None:
    return None if math.isinf(value) else value
