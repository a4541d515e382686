"""What every material keeps to."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import ForetouchError
from foretouch.models import ContactModel, advance
from foretouch.robot import Material
from foretouch.session.conformance.finding import Finding, guarded
from foretouch.session.settings import SAMPLE_PERIOD

SLOW, FAST = 0.01, 0.2
"""Speeds of a press [m/s]."""
LEAST_FORCE, MOST_FORCE = 0.02, 1e4
"""Range of the force of a slow press to the press depth [N]: a force outside shows another unit."""
DEEPEST, FARTHEST = 0.1, 0.2
"""Largest press depth and surface position that a session takes [m]."""
ROUNDING = 2e-3
"""Tolerances as fractions of the energy that went in, and of the largest force, for the error of sampling."""
CALLS, LARGEST_GROWTH = 5000, 16384
"""Calls of a law after which no more memory than this is in use [bytes]."""


def check_material(make: Callable[[], Material], *, name: str = "") -> list[Finding]:
    """Check a material: units, no force outside, loading that grows, passivity over closed cycles, no allocation.

    Args:
        make: Makes it.
        name: That it is to have; without one, any.

    Returns:
        One finding a check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    try:
        material: object = make()
    except ForetouchError:
        raise  # its message states what is missing
    except Exception as error:
        return [Finding("made", False, f"raises {type(error).__name__}: {error}", "it can be made")]
    if not isinstance(material, Material):
        return [Finding("made", False, f"a {type(material).__name__}", "it is a foretouch.robot.Material")]
    model, depth = material.model, min(material.press_depth, DEEPEST)
    return guarded(
        [
            ("name", lambda: _name(material, name)),
            ("units", lambda: _units(material)),
            ("force is a number", lambda: _finite(model, depth)),
            ("no force outside", lambda: _outside(model, depth)),
            ("loading grows", lambda: _monotone(model, depth)),
            ("passive", lambda: _passive(model, depth)),
            ("no allocation", lambda: _allocation(model, depth)),
        ]
    )


def _name(material: Material, name: str) -> Finding:
    kept = isinstance(material.name, str) and bool(material.name) and (not name or material.name == name)
    lines = all("\n" not in text and text for text in (material.description, material.provenance))
    rule = f"name is {name!r}, " if name else "name is a text, "
    rule += "description and provenance are one line each"
    return Finding("name", kept and lines, f"name = {material.name!r}", rule)


def _units(material: Material) -> Finding:
    rule = (
        f"in metres and newtons: press depth at most {DEEPEST:g} m, surface within {FARTHEST:g} m, and "
        f"{LEAST_FORCE:g} to {MOST_FORCE:g} N at the end of a slow press"
    )
    if not (0.0 < material.press_depth <= DEEPEST and 0.0 < material.surface <= FARTHEST):
        return Finding("units", False, f"press depth {material.press_depth:g} m, surface {material.surface:g} m", rule)
    force = float(_forces(material.model, _way(material.press_depth, SLOW)).max())
    found = f"{force:.4g} N at {1e3 * material.press_depth:.4g} mm"
    return Finding("units", LEAST_FORCE <= force <= MOST_FORCE, found, rule)


def _finite(model: ContactModel, depth: float) -> Finding:
    force = _forces(model, np.concatenate([_cycle(depth, FAST), _jumps(depth)]))
    bad = int(np.count_nonzero(~(np.isfinite(force) & (force >= 0.0))))
    rule = "the force is finite and never negative, for smooth motion and for jumps"
    return Finding("force is a number", bad == 0, f"{bad} of {force.size} are not", rule)


def _outside(model: ContactModel, depth: float) -> Finding:
    path = np.concatenate([np.linspace(-0.01, 0.0, 200), _cycle(depth, FAST), np.linspace(0.0, -0.01, 200)])
    force = _forces(model, path)
    largest = float(np.abs(force[path <= 0.0]).max())
    rule = "no force at depths of 0 or less, before a press and after it"
    return Finding("no force outside", largest == 0.0, f"{largest:.4g} N at most", rule)


def _monotone(model: ContactModel, depth: float) -> Finding:
    force = _forces(model, _way(depth, SLOW))
    fall = float(np.max(np.maximum.accumulate(force) - force))
    rule = "in a press at one slow speed the force never falls"
    kept = fall <= ROUNDING * float(force.max())
    return Finding("loading grows", kept, f"falls by {fall:.4g} N of {force.max():.4g} N", rule)


def _passive(model: ContactModel, depth: float) -> Finding:
    worst, found = math.inf, ""
    for speed in (SLOW, 0.05, FAST):
        for share in (0.3, 1.0):
            path = _cycle(share * depth, speed)
            force = _forces(model, path)
            power = force[1:] * np.diff(path)
            put_in, left = float(power[power > 0.0].sum()), float(power.sum())
            if put_in > 0.0 and left / put_in < worst:
                worst = left / put_in
                found = f"{100.0 * worst:.4g} % of {1e3 * put_in:.4g} mJ stays, at {1e3 * speed:g} mm/s"
    rule = "over a closed cycle, in and out again, no more energy comes back than went in"
    return Finding("passive", worst >= -ROUNDING, found or "no energy went in", rule)


def _allocation(model: ContactModel, depth: float) -> Finding:
    path = np.resize(_cycle(depth, 0.05), CALLS)
    _forces(model, path)  # what is compiled or cached is so now
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        state = model.initial_state()
        for here in path.tolist():
            state = advance(model, state, here, 0.01, SAMPLE_PERIOD)[0]
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    rule = f"{CALLS} steps leave no more than {LARGEST_GROWTH} bytes behind: the state has one size, nothing is kept"
    return Finding("no allocation", grown <= LARGEST_GROWTH, f"{grown} bytes more", rule)


def _way(depth: float, speed: float) -> NDArray[np.float64]:
    """Depths of a press at one speed from the surface on [m]."""
    return np.asarray(np.arange(1, max(round(depth / (speed * SAMPLE_PERIOD)), 2) + 1) * (speed * SAMPLE_PERIOD))


def _cycle(depth: float, speed: float) -> NDArray[np.float64]:
    """Three closed cycles from the surface to a depth and back, at most so fast, in steps of a tick or less [m]."""
    count = max(round(math.pi * depth / (speed * SAMPLE_PERIOD)), 400)
    phase = np.linspace(0.0, 6.0 * math.pi, 3 * count + 1)
    return np.asarray(0.5 * depth * (1.0 - np.cos(phase)))


def _jumps(depth: float) -> NDArray[np.float64]:
    return np.asarray(np.random.default_rng(1).uniform(-depth, 1.5 * depth, 400))


def _forces(model: ContactModel, path: NDArray[np.float64]) -> NDArray[np.float64]:
    """The law's force along a path, one depth a tick [N], shape (n,)."""
    state, force = model.initial_state(), np.empty(path.size)
    velocity = np.diff(path, prepend=path[0]) / SAMPLE_PERIOD
    for index, (here, speed) in enumerate(zip(path.tolist(), velocity.tolist(), strict=True)):
        state, force[index], _ = advance(model, state, here, speed, SAMPLE_PERIOD)
    return force
