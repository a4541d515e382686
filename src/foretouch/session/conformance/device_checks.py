"""Conformance checks of a device."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import Device, DeviceSpecification
from foretouch.devices.device import FORCE_LIMIT
from foretouch.session.conformance.finding import (
    Checks,
    Finding,
    Result,
    ignore,
    name_result,
    percentile_time,
    too_slow,
)
from foretouch.session.settings import SAMPLE_PERIOD

TICK_NS = round(SAMPLE_PERIOD * 1e9)
FARTHEST, FASTEST = 0.5, 1.0
"""Largest distance from its start [m] and speed [m/s] of a hand; more shows another unit or slow sampling."""
NEAREST = 1e-4  # Smallest displacement that counts as motion [m]
LONGEST_CALL = 2e-4  # Longest duration of 99 of 100 reads or renders [s]
FAR_TOO_LONG = 1e-3  # Median duration of a call, a whole tick, above which no other check is run [s]
TIME_RULE = f"99 of 100 take at most {1e3 * LONGEST_CALL:g} ms"
MOVING_TIME, REAL_TIME = 20.0, 4.0
"""Observation time of a device that moves by itself, and of one that a person moves [s]."""
PUSH = 1.0  # Force that must move a simulated hand [N]


class Motion(NamedTuple):
    """Observed motion of a device: positions [m] of shape (n,), and the longest that each step may have taken [s]."""

    position: NDArray[np.float64]
    period: NDArray[np.float64]  # of shape (n - 1,)


@dataclass(frozen=True, eq=False)
class Subject:
    """A device, how to make another, the name that it must have, and how long one in a hand is watched [s]."""

    device: Device
    make: Callable[[], Device]
    name: str
    watched: float

    @property
    @functools.lru_cache(maxsize=1)  # noqa: B019  # without a lock: a driver that hangs stops no later check
    def motion(self) -> Motion:
        """Its motion at every tick; in real time where a person moves it, and then as late as this machine is."""
        real = self.device.real_time
        ticks = round((self.watched if real else MOVING_TIME) / SAMPLE_PERIOD)
        positions, asked, read = np.empty(ticks), np.zeros(ticks), np.zeros(ticks)
        begin = time.monotonic()
        for tick in range(ticks):
            if real:
                time.sleep(max(begin + tick * SAMPLE_PERIOD - time.monotonic(), 0.0))
                asked[tick] = time.monotonic()
            positions[tick] = self.device.read(tick * TICK_NS)
            if real:
                read[tick] = time.monotonic()
            self.device.render(0.0)
        # A position is of some time within its read, so that a machine that stops there makes no hand look fast.
        return Motion(positions, np.maximum(read[1:] - asked[:-1], SAMPLE_PERIOD))


def _slow(it: Subject, checks: list[str]) -> list[Finding]:
    """Findings of a device that is far too slow, all at one time, so that its hand stays at its start."""
    calls: dict[str, Callable[[], object]] = {
        "read time": lambda: it.device.read(0),
        "render time": lambda: it.device.render(0.0),
    }
    for check, call in calls.items():
        others = [other for other in checks if other != check]
        with contextlib.suppress(Exception):  # exceptions are reported by the checks themselves
            if result := too_slow(check, call, LONGEST_CALL, FAR_TOO_LONG, TIME_RULE, others):
                return result
    return []


checked = Checks(Device, "foretouch.devices.Device", Subject, _slow)


def check_device(
    make: Callable[[], Device], *, name: str = "", watched: float = REAL_TIME, tell: Callable[[Finding], None] = ignore
) -> list[Finding]:
    """Check a device: rate, units, signs, limits, truth, fail to zero, times that go back, timing.

    A `Device.real_time` device is watched for some seconds of real time, in which a person moves it in and out. No
    force above 0 is rendered except in the check of its limits, in single ticks that end at once. Of one that is far
    too slow only the time is reported.

    Args:
        make: Makes a new device; called several times for a simulated one, once for one in real time.
        name: Name that it must have; without one, any.
        watched: Observation time of a device that a person moves [s].
        tell: Called with each finding as soon as it is known.

    Returns:
        One finding per check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    return checked.run(make, tell, name=name, watched=watched)


@checked("name")
def _name(it: Subject) -> Result:
    return name_result(getattr(it.device, "name", None), it.name)


@checked("specification", "a DeviceSpecification where the force moves the hand (closed_loop), else None")
def _specification(it: Subject) -> Result:
    own, felt = it.device.specification, it.device.closed_loop
    kept = isinstance(own, DeviceSpecification) if felt else own is None
    return kept, f"closed_loop = {felt}, specification = {'none' if own is None else type(own).__name__}"


@checked("units", f"positions are finite and in metres: at most {FARTHEST:g} m from 0, which is where the hand starts")
def _units(it: Subject) -> Result:
    motion = it.motion.position
    if not np.isfinite(motion).all():
        return False, f"{np.count_nonzero(~np.isfinite(motion))} positions are no numbers"
    farthest = float(np.abs(motion).max())
    return farthest <= FARTHEST, f"at most {farthest:.4g} m from 0"


@checked(
    "rate", f"positions are new at every tick of {1e3 * SAMPLE_PERIOD:g} ms: no step is faster than {FASTEST:g} m/s"
)
def _rate(it: Subject) -> Result:
    fastest = float(np.nanmax(np.abs(np.diff(it.motion.position)) / it.motion.period))
    return fastest <= FASTEST, f"fastest step {fastest:.4g} m/s"


@checked("sign of position", "positions grow into the material: it goes further in than out of where it starts")
def _position_sign(it: Subject) -> Result:
    motion = it.motion.position
    inwards, outwards = float(np.nanmax(motion) - motion[0]), float(motion[0] - np.nanmin(motion))
    if max(inwards, outwards) < NEAREST:
        return None, "it did not move: push it in while it is watched"
    return inwards > outwards, f"{1e3 * inwards:.4g} mm in, {1e3 * outwards:.4g} mm out"


@checked("times that go back", "a time that goes back counts as the newest: the hand stays, and goes on from there")
def _times_back(it: Subject) -> Result:
    now = round(3600e9)
    there = it.device.read(now)
    moved = max(abs(it.device.read(then) - there) for then in (now, now - 10**9, 0))
    after = abs(it.device.read(now + TICK_NS) - there)
    kept = moved <= FASTEST * SAMPLE_PERIOD and after <= FASTEST * SAMPLE_PERIOD
    return kept, f"moved by {1e3 * moved:.4g} mm, then by {1e3 * after:.4g} mm"


@checked("read time", TIME_RULE)
def _read_time(it: Subject) -> Result:
    begin = round(7200e9)
    taken = percentile_time(lambda index: it.device.read(begin + index * TICK_NS), 1000, 99.0)
    return taken <= LONGEST_CALL, f"{1e3 * taken:.4g} ms"


@checked("render time", TIME_RULE)
def _render_time(it: Subject) -> Result:
    taken = percentile_time(lambda index: it.device.render(0.0), 1000, 99.0)
    return taken <= LONGEST_CALL, f"{1e3 * taken:.4g} ms"


def _given(device: Device, *asked: float) -> list[float]:
    """What a device says that it gave of forces, each in a single tick [N]."""
    given = []
    for force in asked:
        given.append(device.render(force))
        device.render(0.0)
    return given


@checked("force limit")
def _limit(it: Subject) -> Result:
    own = it.device.specification
    limit = FORCE_LIMIT if own is None else own.force_limit
    given = _given(it.device, 1e6, math.inf)
    kept = all(math.isfinite(force) and 0.0 <= force <= limit * (1.0 + 1e-9) for force in given)
    return kept, f"{max(given):.4g} N of 1e6 N", f"render returns what was really given, at most {limit:g} N"


@checked("no force asked, none given")
def _nothing(it: Subject) -> Result:
    own, given = it.device.specification, _given(it.device, 0.0, -3.0, -math.inf)
    text = f"{given} N of 0, -3 and -inf N"
    if own is None or not own.pulls:
        return given == [0.0] * 3, text, "a force of 0 or less is rendered as 0: nothing pulls a hand in"
    kept = given[0] == 0.0 and all(-own.force_limit * (1.0 + 1e-9) <= force <= 0.0 for force in given)
    return kept, text, f"it pulls: what is below 0 is rendered as that, and by at most {own.force_limit:g} N"


@checked("no number, no force", "a force that is no number is rendered as 0")
def _no_number(it: Subject) -> Result:
    (given,) = _given(it.device, math.nan)
    return given == 0.0, f"{given} N of NaN"


def _short(device: Device, force: float = 0.0, begin: int = 2000) -> NDArray[np.float64]:
    """Positions over 3 s [m], with a force from the tick `begin` on."""
    positions = np.empty(3000)
    for tick in range(positions.size):
        positions[tick] = device.read(tick * TICK_NS)
        device.render(force if tick >= begin else 0.0)
    device.close()
    return positions


@checked("same times, same motion", "motion depends on nothing but the times: two that are made alike move alike")
def _repeatable(it: Subject) -> Result:
    if it.device.real_time:
        return None
    apart = float(np.abs(_short(it.make()) - _short(it.make())).max())
    return apart == 0.0, f"{1e3 * apart:.4g} mm apart"


@checked(
    "sign of force", "force pushes the hand out, to smaller positions; where closed_loop is False it moves nothing"
)
def _force_sign(it: Subject) -> Result:
    if it.device.real_time:
        return None, "somebody moves it: look yourself", "force pushes the hand out"
    device = it.make()
    felt = device.closed_loop
    moved = _short(device, PUSH)[-1] - _short(it.make())[-1]
    kept = moved < 0.0 if felt else moved == 0.0
    return kept, f"{PUSH:g} N for 1 s moves the hand by {1e3 * moved:.4g} mm"


@checked("closed, no force", "after it is closed once or twice, nothing raises, and a device in a hand gives no force")
def _closed(it: Subject) -> Result:
    device = it.device
    device.render(PUSH)
    device.close()
    device.close()
    position, given = device.read(round(7300e9)), device.render(PUSH)
    # A simulated device of this package holds nothing.
    held = device.real_time or (device.closed_loop and type(device).close is not Device.close)
    if not held and math.isfinite(position):
        return True, "not held in a hand: there is no force to end"
    text = f"{given:.4g} N of {PUSH:g} N after close, at {position:.4g} m"
    return math.isfinite(position) and given == 0.0, text
