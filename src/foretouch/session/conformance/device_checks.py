"""Conformance checks of a device."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import Device, DeviceSpecification
from foretouch.devices.device import FORCE_LIMIT
from foretouch.errors import ForetouchError
from foretouch.session.conformance.finding import Finding, guarded, nobody, percentile_time, skipped, told, too_slow
from foretouch.session.settings import SAMPLE_PERIOD

TICK_NS = round(SAMPLE_PERIOD * 1e9)
FARTHEST, FASTEST = 0.5, 1.0
"""Largest distance from its start [m] and speed [m/s] of a hand; more shows another unit or slow sampling."""
NEAREST = 1e-4
"""Smallest displacement that counts as motion [m]."""
LONGEST_CALL = 2e-4
"""Longest duration of 99 of 100 reads or renders [s]."""
FAR_TOO_LONG = 1e-3
"""Median duration of a call, a whole tick, above which no other check is run [s]."""
TIME_RULE = f"99 of 100 take at most {1e3 * LONGEST_CALL:g} ms"
MOVING_TIME, REAL_TIME = 20.0, 4.0
"""Observation time of a device that moves by itself, and of one that a person moves [s]."""
PUSH = 1.0
"""Force that must move a simulated hand [N]."""


def check_device(
    make: Callable[[], Device],
    *,
    name: str = "",
    watched: float = REAL_TIME,
    tell: Callable[[Finding], None] = nobody,
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
    try:
        device: object = make()
    except ForetouchError:
        raise  # its message states what is missing
    except Exception as error:
        return told([Finding("made", False, f"raises {type(error).__name__}: {error}", "it can be made")], tell)
    if not isinstance(device, Device):
        return told([Finding("made", False, f"a {type(device).__name__}", "it is a foretouch.devices.Device")], tell)
    motion = functools.cache(lambda: _motion(device, watched))
    checks: list[tuple[str, Callable[[], Finding | list[Finding]]]] = [
        ("name", lambda: _name(device, name)),
        ("specification", lambda: _specification(device)),
        ("units", lambda: _units(motion().position)),
        ("rate", lambda: _rate(motion())),
        ("sign of position", lambda: _position_sign(motion().position)),
        ("times that go back", lambda: _times_back(device)),
        ("read time", lambda: _timing(device, "read time")),
        ("render time", lambda: _timing(device, "render time")),
        ("force limit", lambda: _limit(device)),
        ("no force asked, none given", lambda: _nothing(device)),
        ("no number, no force", lambda: _no_number(device)),
    ]
    if not device.real_time:
        checks.append(("same times, same motion", lambda: _repeatable(make)))
        checks.append(("sign of force", lambda: _force_sign(make)))
    else:
        why = "somebody moves it: look yourself"
        checks.append(("sign of force", lambda: skipped("sign of force", why, "force pushes the hand out")))
    checks.append(("closed, no force", lambda: _closed(device)))
    try:
        return told(_slow(device, [check for check, _ in checks]), tell) or guarded(checks, tell)
    finally:
        with contextlib.suppress(Exception):  # an exception of it has been reported
            device.close()


def _slow(device: Device, checks: list[str]) -> list[Finding]:
    """Findings of a device that is far too slow, all at one time, so that its hand stays at its start."""
    calls: dict[str, Callable[[], object]] = {
        "read time": lambda: device.read(0),
        "render time": lambda: device.render(0.0),
    }
    for check, call in calls.items():
        others = [other for other in checks if other != check]
        with contextlib.suppress(Exception):  # exceptions are reported by the checks themselves
            if found := too_slow(check, call, LONGEST_CALL, FAR_TOO_LONG, TIME_RULE, others):
                return found
    return []


class Motion(NamedTuple):
    """Observed motion of a device: positions [m], and time since the previous one [s], both of shape (n,)."""

    position: NDArray[np.float64]
    period: NDArray[np.float64]


def _motion(device: Device, watched: float) -> Motion:
    """Motion of the device at every tick; in real time where a person moves it, and then as late as this machine is."""
    ticks = round((watched if device.real_time else MOVING_TIME) / SAMPLE_PERIOD)
    positions, times = np.empty(ticks), np.arange(ticks) * SAMPLE_PERIOD
    begin = time.monotonic()
    for tick in range(ticks):
        if device.real_time:
            time.sleep(max(begin + tick * SAMPLE_PERIOD - time.monotonic(), 0.0))
            times[tick] = time.monotonic() - begin
        positions[tick] = device.read(tick * TICK_NS)
        device.render(0.0)
    return Motion(positions, np.maximum(np.diff(times, prepend=-SAMPLE_PERIOD), SAMPLE_PERIOD))


def _name(device: Device, name: str) -> Finding:
    own = getattr(device, "name", None)
    kept = isinstance(own, str) and bool(own) and (not name or own == name)
    return Finding("name", kept, f"name = {own!r}", f"name is {name!r}" if name else "name is a text")


def _specification(device: Device) -> Finding:
    own, felt = device.specification, device.closed_loop
    kept = isinstance(own, DeviceSpecification) if felt else own is None
    rule = "a DeviceSpecification where the force moves the hand (closed_loop), else None"
    said = "none" if own is None else type(own).__name__
    return Finding("specification", kept, f"closed_loop = {felt}, specification = {said}", rule)


def _units(motion: NDArray[np.float64]) -> Finding:
    rule = f"positions are finite and in metres: at most {FARTHEST:g} m from 0, which is where the hand starts"
    if not np.isfinite(motion).all():
        return Finding("units", False, f"{np.count_nonzero(~np.isfinite(motion))} positions are no numbers", rule)
    farthest = float(np.abs(motion).max())
    return Finding("units", farthest <= FARTHEST, f"at most {farthest:.4g} m from 0", rule)


def _rate(motion: Motion) -> Finding:
    fastest = float(np.nanmax(np.abs(np.diff(motion.position)) / motion.period[1:]))
    rule = f"positions are new at every tick of {1e3 * SAMPLE_PERIOD:g} ms: no step is faster than {FASTEST:g} m/s"
    return Finding("rate", fastest <= FASTEST, f"fastest step {fastest:.4g} m/s", rule)


def _position_sign(motion: NDArray[np.float64]) -> Finding:
    inwards, outwards = float(np.nanmax(motion) - motion[0]), float(motion[0] - np.nanmin(motion))
    rule = "positions grow into the material: it goes further in than out of where it starts"
    if max(inwards, outwards) < NEAREST:
        return skipped("sign of position", "it did not move: push it in while it is watched", rule)
    found = f"{1e3 * inwards:.4g} mm in, {1e3 * outwards:.4g} mm out"
    return Finding("sign of position", inwards > outwards, found, rule)


def _times_back(device: Device) -> Finding:
    now = round(3600e9)
    there = device.read(now)
    moved = max(abs(device.read(then) - there) for then in (now, now - 10**9, 0))
    after = abs(device.read(now + TICK_NS) - there)
    most = FASTEST * SAMPLE_PERIOD
    rule = "a time that goes back counts as the newest: the hand stays, and goes on from there"
    found = f"moved by {1e3 * moved:.4g} mm, then by {1e3 * after:.4g} mm"
    return Finding("times that go back", moved <= most and after <= most, found, rule)


def _timing(device: Device, check: str) -> Finding:
    begin = round(7200e9)
    if check == "read time":
        taken = percentile_time(lambda index: device.read(begin + index * TICK_NS), 1000, 99.0)
    else:
        taken = percentile_time(lambda index: device.render(0.0), 1000, 99.0)
    return Finding(check, taken <= LONGEST_CALL, f"{1e3 * taken:.4g} ms", TIME_RULE)


def _limit(device: Device) -> Finding:
    own = device.specification
    limit = FORCE_LIMIT if own is None else own.force_limit
    given = []
    for force in (1e6, math.inf):
        given.append(device.render(force))
        device.render(0.0)
    kept = all(math.isfinite(force) and 0.0 <= force <= limit * (1.0 + 1e-9) for force in given)
    rule = f"render returns what was really given, at most {limit:g} N"
    return Finding("force limit", kept, f"{max(given):.4g} N of 1e6 N", rule)


def _nothing(device: Device) -> Finding:
    given = [device.render(force) for force in (0.0, -3.0, -math.inf)]
    device.render(0.0)
    rule = "a force of 0 or less is rendered as 0: nothing pulls a hand in"
    return Finding("no force asked, none given", given == [0.0] * 3, f"{given} N of 0, -3 and -inf N", rule)


def _no_number(device: Device) -> Finding:
    given = device.render(math.nan)
    device.render(0.0)
    return Finding(
        "no number, no force", given == 0.0, f"{given} N of NaN", "a force that is no number is rendered as 0"
    )


def _repeatable(make: Callable[[], Device]) -> Finding:
    first, second = (_short(make()) for _ in range(2))
    apart = float(np.abs(first - second).max())
    rule = "motion depends on nothing but the times: two that are made alike move alike"
    return Finding("same times, same motion", apart == 0.0, f"{1e3 * apart:.4g} mm apart", rule)


def _short(device: Device, force: float = 0.0, begin: int = 2000) -> NDArray[np.float64]:
    """Positions over 3 s [m], with a force from the tick `begin` on."""
    positions = np.empty(3000)
    for tick in range(positions.size):
        positions[tick] = device.read(tick * TICK_NS)
        device.render(force if tick >= begin else 0.0)
    device.close()
    return positions


def _force_sign(make: Callable[[], Device]) -> Finding:
    device = make()
    felt = device.closed_loop
    moved = _short(device, PUSH)[-1] - _short(make())[-1]
    rule = "force pushes the hand out, to smaller positions; where closed_loop is False it moves nothing"
    kept = moved < 0.0 if felt else moved == 0.0
    return Finding("sign of force", kept, f"{PUSH:g} N for 1 s moves the hand by {1e3 * moved:.4g} mm", rule)


def _closed(device: Device) -> Finding:
    rule = "after close, and a second close, nothing raises and a device in somebody's hand gives no force"
    device.render(PUSH)
    device.close()
    device.close()
    position, given = device.read(round(7300e9)), device.render(PUSH)
    held = device.real_time or (device.closed_loop and _holds(device))
    if not held and math.isfinite(position):
        return Finding("closed, no force", True, "nobody holds it: there is no force to end", rule)
    kept = math.isfinite(position) and given == 0.0
    found = f"{given:.4g} N of {PUSH:g} N after close, at {position:.4g} m"
    return Finding("closed, no force", kept, found, rule)


def _holds(device: Device) -> bool:
    """Whether there is anything to close: a simulated device of this package holds nothing."""
    return type(device).close is not Device.close
