"""Conformance checks of a robot."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import ForetouchError
from foretouch.robot import Robot, RobotSample, RobotSpecification
from foretouch.session.conformance.finding import Finding, guarded, nobody, percentile_time, skipped, told, too_slow
from foretouch.session.settings import SAMPLE_PERIOD

RANGES: dict[str, tuple[float, float]] = {
    "force_limit": (0.1, 1000.0),
    "encoder_resolution": (0.0, 1e-3),
    "encoder_noise": (0.0, 1e-3),
    "tool_mass": (0.0, 20.0),
    "gravity": (-9.9, 9.9),
    "sensor_noise": (0.0, 10.0),
    "accelerometer_noise": (0.0, 10.0),
    "sensor_bandwidth": (1.0, math.inf),
    "moved_mass": (1e-3, 200.0),
    "sensor_range": (0.1, math.inf),
    "largest_offset": (0.0, math.inf),
}
"""Ranges of a specification's numbers, in SI units: a value outside shows another unit."""
FARTHEST, MOST_FORCE = 2.0, 5000.0
"""Largest values of the sensors [m, N]."""
STEP, SPEED = 0.005, 0.02
"""Distance and speed of the commanded motion, in from the robot's position and back [m, m/s]."""
SWING, SWINGS = 0.001, 3.0
"""Amplitude [m] and frequency [Hz] of the motion that tests the accelerometer."""
STILL = 1e-3
"""Largest motion of a robot that is commanded nothing [m]."""
TOUCH = 0.3
"""Least force that counts as contact [N]."""
FAR_TOO_LONG = 3e-3
"""Median duration of an exchange above which no other check is run [s]."""
STEP_TIME = 3e-4
"""Approximate duration of a follower's step [s], by which a driver that waits for its bus's next cycle waits less."""
ROUND = 1.1 * SAMPLE_PERIOD
"""Longest period of such a driver's exchanges with a step before each: one cycle and a tenth [s]."""
TIME_RULE = (
    f"99 of 100 exchanges take at most the sample period, {1e3 * SAMPLE_PERIOD:g} ms; where they wait for the next "
    f"cycle of a bus, with {1e3 * STEP_TIME:g} ms of other work before each at most {1e3 * ROUND:g} ms in all"
)
HELD = 1.05
"""Largest ratio of the force held in the end to the limit: sensors have noise."""


def check_robot(
    make: Callable[[], Robot], *, move: bool = False, tell: Callable[[Finding], None] = nobody
) -> list[Finding]:
    """Check a robot: specification, units, signs, limits, nonsense, timing.

    A real robot is only read and given no command; with `move` it is also moved, 5 mm in its pointing direction and
    back, which needs free air. Pressing is tried on simulated robots only.

    Args:
        make: Makes a new robot; called several times for a simulated one.
        move: Whether a real one may be moved.
        tell: Called with each finding as soon as it is known.

    Returns:
        One finding per check.

    Raises:
        ForetouchError: It cannot be made here, for the reason in its message.
    """
    try:
        robot: object = make()
    except ForetouchError:
        raise
    except Exception as error:
        return told([Finding("made", False, f"raises {type(error).__name__}: {error}", "it can be made")], tell)
    if not isinstance(robot, Robot):
        return told([Finding("made", False, f"a {type(robot).__name__}", "it is a foretouch.robot.Robot")], tell)
    specification = getattr(robot, "specification", None)
    if not isinstance(specification, RobotSpecification):
        rule = "it has a RobotSpecification from the beginning"
        return told([Finding("specification", False, f"a {type(specification).__name__}", rule)], tell)
    checks = _checks(robot, make, move)
    try:
        return told(_slow(robot, [check for check, _ in checks]), tell) or guarded(checks, tell)
    finally:
        with contextlib.suppress(Exception):  # what it raises has been found
            robot.close()


def _checks(
    robot: Robot, make: Callable[[], Robot], move: bool
) -> list[tuple[str, Callable[[], Finding | list[Finding]]]]:
    simulated = robot.specification.simulated
    pressed = functools.cache(lambda: _pressed(make))

    def if_moved(check: str, make_it: Callable[[], Finding]) -> tuple[str, Callable[[], Finding]]:
        why = "it is a real one: --move lets it move"
        return check, make_it if simulated or move else lambda: skipped(check, why, "see docs/plugins.md")

    def if_simulated(check: str, make_it: Callable[[], Finding]) -> tuple[str, Callable[[], Finding]]:
        why = "it is a real one, which no check drives into anything"
        return check, make_it if simulated else lambda: skipped(check, why, "see docs/plugins.md")

    return [
        ("specification", lambda: _specification(robot.specification)),
        ("units", lambda: _units(robot)),
        ("reading moves nothing", lambda: _reading(robot)),
        ("no command, no motion", lambda: _nonsense(robot)),
        ("exchange time", lambda: _timing(robot)),
        if_moved("sign of position", lambda: _follows(robot)),
        if_moved("sign of acceleration", lambda: _swing(robot)),
        if_simulated("workspace", lambda: _workspace(make)),
        if_simulated("sign of force", lambda: _force_sign(pressed())),
        if_simulated("force limit", lambda: _force_limit(robot, pressed())),
        ("close", lambda: _close(robot)),
    ]


def _slow(robot: Robot, checks: list[str]) -> list[Finding]:
    """Findings of a robot whose exchange is far too slow; it is commanded no motion."""
    others = [other for other in checks if other != "exchange time"]
    with contextlib.suppress(Exception):  # exceptions are reported by the checks themselves
        return too_slow(
            "exchange time", lambda: robot.exchange(math.nan), SAMPLE_PERIOD, FAR_TOO_LONG, TIME_RULE, others
        )
    return []


def _specification(own: RobotSpecification) -> Finding:
    rule = f"SI units, sample_period = {SAMPLE_PERIOD:g} s, workspace from a smaller to a larger place within 2 m"
    wrong = [
        f"{name} = {getattr(own, name):g}"
        for name, (least, most) in RANGES.items()
        if not least <= getattr(own, name) <= most
    ]
    if own.sample_period != SAMPLE_PERIOD:
        wrong.insert(0, f"sample_period = {own.sample_period:g}")
    low, high = own.workspace
    if not -FARTHEST <= low < high <= FARTHEST:
        wrong.append(f"workspace = {own.workspace}")
    return Finding("specification", not wrong, ", ".join(wrong) or "all within their ranges", rule)


def _units(robot: Robot) -> Finding:
    sample: object = robot.read()
    rule = "a RobotSample in m, N and m/s^2 that is finite, at rest about 0 m/s^2, and within the workspace"
    if not isinstance(sample, RobotSample):
        return Finding("units", False, f"a {type(sample).__name__}", rule)
    position, force, acceleration = sample.position, sample.sensor_force, sample.acceleration
    low, high = robot.specification.workspace
    kept = (
        low - STILL <= position <= high + STILL
        and abs(force) <= MOST_FORCE
        and abs(acceleration) <= 2.0 + 6.0 * robot.specification.accelerometer_noise
        and low - STILL <= sample.commanded_position <= high + STILL
    )
    return Finding("units", kept, f"{position:.4g} m, {force:.4g} N, {acceleration:.4g} m/s^2", rule)


def _noise(own: RobotSpecification) -> float:
    """Largest difference of two readings of one position [m]."""
    return 12.0 * own.encoder_noise + 2.0 * own.encoder_resolution + 1e-6


def _reading(robot: Robot) -> Finding:
    positions = [robot.read().position for _ in range(50)]
    moved = max(positions) - min(positions)
    return Finding(
        "reading moves nothing",
        moved <= _noise(robot.specification),
        f"50 reads differ by {1e3 * moved:.4g} mm",
        "read lets no time pass: positions differ by no more than the encoder's noise",
    )


def _nonsense(robot: Robot) -> Finding:
    before = robot.read().position
    samples = [robot.exchange(value) for value in (math.nan, math.inf, -math.inf) * 30]
    moved = max(abs(sample.position - before) for sample in samples)
    rule = "a command that is no finite number is left out: the robot stays where it was told to be"
    return Finding("no command, no motion", moved <= STILL, f"moves by {1e3 * moved:.4g} mm", rule)


def _timing(robot: Robot) -> Finding:
    taken = percentile_time(lambda _: robot.exchange(math.nan), 300, 99.0)
    if taken <= SAMPLE_PERIOD:
        return Finding("exchange time", True, f"{1e3 * taken:.4g} ms", TIME_RULE)
    # A driver that waits for its cycle takes the whole of it by itself, and no longer with a step before it.
    found, round_time = f"{1e3 * taken:.4g} ms", percentile_time(lambda _: _work_and_exchange(robot), 300, 99.0)
    return Finding("exchange time", round_time <= ROUND, f"{found}, {1e3 * round_time:.4g} ms with a step", TIME_RULE)


def _work_and_exchange(robot: Robot) -> None:
    """A round of a loop: something that takes as long as a step, and an exchange."""
    end = time.perf_counter() + STEP_TIME
    while time.perf_counter() < end:
        pass
    robot.exchange(math.nan)


def _follows(robot: Robot) -> Finding:
    here = robot.read().position
    step = min(STEP, 0.5 * (robot.specification.workspace[1] - here))
    ramp = np.arange(0.0, step, SPEED * SAMPLE_PERIOD)
    _drive(robot, (here + ramp).tolist())
    there = _drive(robot, [here + step] * 200)[-1].position
    _drive(robot, (here + ramp[::-1]).tolist() + [here] * 200)
    rule = f"positions grow into the material, in metres: told to go {1e3 * step:g} mm in, it does"
    return Finding("sign of position", 0.7 * step <= there - here <= 1.3 * step, f"{1e3 * (there - here):.4g} mm", rule)


def _swing(robot: Robot) -> Finding:
    own = robot.specification
    rule = "acceleration is in m/s^2, positive into the material, and one exchange is one sample period"
    if own.tool_mass == 0.0:
        return skipped("sign of acceleration", "no tool that would have to be weighed out", rule)
    moment = np.arange(1000) * SAMPLE_PERIOD
    phase = 2.0 * math.pi * SWINGS * moment
    # Begun and ended softly: a jerk would be measured as well.
    path = robot.read().position + SWING * np.sin(phase) * np.sin(math.pi * moment) ** 2
    measured = np.array([sample.acceleration for sample in _drive(robot, path.tolist())])
    asked = np.gradient(np.gradient(path, SAMPLE_PERIOD), SAMPLE_PERIOD)
    # In and out of phase, so that a lag of some ticks does not count.
    late = np.roll(asked, round(0.25 / SWINGS / SAMPLE_PERIOD))
    basis = np.stack([asked, late, np.ones_like(asked)], axis=1)
    in_phase, quadrature, _ = np.linalg.lstsq(basis, measured, rcond=None)[0]
    size = math.hypot(in_phase, quadrature)
    kept = in_phase > 0.0 and 0.6 <= size <= 1.5
    return Finding("sign of acceleration", kept, f"{in_phase:.3g} in phase, {size:.3g} in all, of 1", rule)


def _workspace(make: Callable[[], Robot]) -> Finding:
    worst = 0.0
    for end, beyond in ((0, -0.05), (1, 0.05)):
        robot = make()
        low, high = robot.specification.workspace
        samples = _drive(robot, [robot.specification.workspace[end] + beyond] * 1500)
        robot.close()
        for sample in samples:
            worst = max(worst, low - sample.commanded_position, sample.commanded_position - high)
            worst = max(worst, low - sample.position - STILL, sample.position - high - STILL)
    rule = "commands beyond the workspace are limited to it, and commanded_position says so"
    return Finding("workspace", worst <= 1e-9, f"at most {1e3 * max(worst, 0.0):.4g} mm beyond", rule)


def _pressed(make: Callable[[], Robot]) -> NDArray[np.float64]:
    """Contact force of a press to the workspace's end, from rest in free air on [N], shape (n,)."""
    robot = make()
    here, (_, end) = robot.read().position, robot.specification.workspace
    way = np.minimum(here + np.arange(0.0, min(end - here, 0.2), SPEED * SAMPLE_PERIOD), end)
    samples = _drive(robot, [here] * 200 + way.tolist() + [end] * 700)
    tool = robot.specification.tool_force
    force = np.array([sample.sensor_force - tool(sample.acceleration) for sample in samples])
    robot.close()
    return np.asarray(force - force[50:200].mean())


def _force_sign(force: NDArray[np.float64]) -> Finding:
    rule = "the sensor's force is positive in compression"
    pressed = float(force[-200:].mean())
    if abs(pressed) < TOUCH:
        return skipped("sign of force", f"nothing was touched: {pressed:.4g} N at the workspace's end", rule)
    return Finding("sign of force", pressed > 0.0, f"{pressed:.4g} N pressed at the workspace's end", rule)


def _force_limit(robot: Robot, force: NDArray[np.float64]) -> Finding:
    limit = robot.specification.force_limit
    held = float(force[-200:].mean())
    rule = f"the force that it holds in the end is at most its force_limit, {limit:g} N"
    return Finding("force limit", held <= HELD * limit, f"{held:.4g} N", rule)


def _close(robot: Robot) -> Finding:
    robot.close()
    robot.close()
    return Finding("close", True, "closed twice", "a second close does nothing")


def _drive(robot: Robot, path: Iterable[float]) -> list[RobotSample]:
    return [robot.exchange(position) for position in path]
