"""What every material keeps to."""

from __future__ import annotations

import itertools
import math
import tracemalloc
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.models import ContactModel, advance
from foretouch.robot import Material
from foretouch.session.conformance.finding import Checks, Finding, Result, ignore, name_result
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


class Subject(NamedTuple):
    """A material, its law, the depth of its presses [m], and the name that it is to have; without one, any."""

    material: Material
    model: ContactModel
    depth: float
    name: str


def _subject(material: Material, _: object, name: str) -> Subject:
    return Subject(material, material.model, min(material.press_depth, DEEPEST), name)


checked = Checks(Material, "foretouch.robot.Material", _subject)


def check_material(
    make: Callable[[], Material], *, name: str = "", tell: Callable[[Finding], None] = ignore
) -> list[Finding]:
    """Check a material: units, no force outside, loading that grows, passivity over closed cycles, no allocation.

    Args:
        make: Makes it.
        name: That it is to have; without one, any.
        tell: Called with each finding as soon as it is known.

    Returns:
        One finding a check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    return checked.run(make, tell, name=name)


@checked("name")
def _name(it: Subject) -> Result:
    lines = all("\n" not in text and text for text in (it.material.description, it.material.provenance))
    kept, result, rule = name_result(it.material.name, it.name, ", description and provenance are one line each")
    return kept and lines, result, rule


@checked(
    "units",
    f"in metres and newtons: press depth at most {DEEPEST:g} m, surface within {FARTHEST:g} m, and "
    f"{LEAST_FORCE:g} to {MOST_FORCE:g} N at the end of a slow press",
)
def _units(it: Subject) -> Result:
    depth, surface = it.material.press_depth, it.material.surface
    if not (0.0 < depth <= DEEPEST and 0.0 < surface <= FARTHEST):
        return False, f"press depth {depth:g} m, surface {surface:g} m"
    force = float(_forces(it.model, _way(depth, SLOW)).max())
    return LEAST_FORCE <= force <= MOST_FORCE, f"{force:.4g} N at {1e3 * depth:.4g} mm"


@checked(
    "force is a number", "the force is finite and, unless it pulls, never negative, for smooth motion and for jumps"
)
def _finite(it: Subject) -> Result:
    jumps = np.random.default_rng(1).uniform(-it.depth, 1.5 * it.depth, 400)
    force = _forces(it.model, np.concatenate([_cycle(it.depth, FAST), jumps]))
    bad = int(np.count_nonzero(~(np.isfinite(force) & ((force >= 0.0) | it.material.pulls))))
    return bad == 0, f"{bad} of {force.size} are not"


@checked(
    "no force outside",
    "no force at depths of 0 or less, before a press and after it, or 10 mm away after one if it pulls",
)
def _outside(it: Subject) -> Result:
    path = np.concatenate([np.linspace(-0.01, 0.0, 200), _cycle(it.depth, FAST), np.linspace(0.0, -0.01, 200)])
    outside = path <= 0.0
    if it.material.pulls:
        outside[200:-1] = False
    largest = float(np.abs(_forces(it.model, path)[outside]).max())
    return largest == 0.0, f"{largest:.4g} N at most"


@checked("loading grows", "in a press at one slow speed the force never falls, but to the pull of the first touch")
def _monotone(it: Subject) -> Result:
    force = _forces(it.model, _way(it.depth, SLOW))[int(it.material.pulls) :]
    fall = float(np.max(np.maximum.accumulate(force) - force))
    return fall <= ROUNDING * float(force.max()), f"falls by {fall:.4g} N of {force.max():.4g} N"


@checked("passive", "over a closed cycle, in and out again, no more energy comes back than went in")
def _passive(it: Subject) -> Result:
    worst, text = math.inf, "no energy went in"
    for speed, fraction in itertools.product((SLOW, 0.05, FAST), (0.3, 1.0)):
        path = _cycle(fraction * it.depth, speed)
        power = _forces(it.model, path)[1:] * np.diff(path)
        put_in, left = float(power[power > 0.0].sum()), float(power.sum())
        if put_in > 0.0 and left / put_in < worst:
            worst = left / put_in
            text = f"{100.0 * worst:.4g} % of {1e3 * put_in:.4g} mJ stays, at {1e3 * speed:g} mm/s"
    return worst >= -ROUNDING, text


@checked(
    "no allocation",
    f"{CALLS} steps leave no more than {LARGEST_GROWTH} bytes behind: the state has one size, nothing is kept",
)
def _allocation(it: Subject) -> Result:
    path = np.resize(_cycle(it.depth, 0.05), CALLS)
    _forces(it.model, path)  # what is compiled or cached is so now
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        state = it.model.initial_state()
        for here in path.tolist():
            state = advance(it.model, state, here, 0.01, SAMPLE_PERIOD)[0]
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    return grown <= LARGEST_GROWTH, f"{grown} bytes more"


def _way(depth: float, speed: float) -> NDArray[np.float64]:
    """Depths of a press at one speed from the surface on [m]."""
    return np.asarray(np.arange(1, max(round(depth / (speed * SAMPLE_PERIOD)), 2) + 1) * (speed * SAMPLE_PERIOD))


def _cycle(depth: float, speed: float) -> NDArray[np.float64]:
    """Three closed cycles from the surface to a depth and back, at most so fast, in steps of a tick or less [m]."""
    count = max(round(math.pi * depth / (speed * SAMPLE_PERIOD)), 400)
    phase = np.linspace(0.0, 6.0 * math.pi, 3 * count + 1)
    return np.asarray(0.5 * depth * (1.0 - np.cos(phase)))


def _forces(model: ContactModel, path: NDArray[np.float64]) -> NDArray[np.float64]:
    """The law's force along a path, one depth a tick [N], shape (n,)."""
    state, force = model.initial_state(), np.empty(path.size)
    velocity = np.diff(path, prepend=path[0]) / SAMPLE_PERIOD
    for index, (here, speed) in enumerate(zip(path.tolist(), velocity.tolist(), strict=True)):
        state, force[index], _ = advance(model, state, here, speed, SAMPLE_PERIOD)
    return force
