"""Conformance checks of a robot."""

from __future__ import annotations

import contextlib
import functools
import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.robot import Robot, RobotSample, RobotSpecification
from foretouch.session.conformance.finding import Checks, Finding, Result, ignore, percentile_time, too_slow
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
STILL = 1e-3  # Largest motion of a robot that is commanded nothing [m]
TOUCH = 0.3  # Least force that counts as contact [N]
FAR_TOO_LONG = 3e-3  # Median duration of an exchange above which no other check is run [s]
STEP_TIME = 3e-4
"""Approximate duration of a follower's step [s], by which a driver that waits for its bus's next cycle waits less."""
ROUND = 1.1 * SAMPLE_PERIOD
"""Longest period of such a driver's exchanges with a step before each: one cycle and a tenth [s]."""
TIME_RULE = (
    f"99 of 100 exchanges take at most the sample period, {1e3 * SAMPLE_PERIOD:g} ms; where they wait for the next "
    f"cycle of a bus, with {1e3 * STEP_TIME:g} ms of other work before each at most {1e3 * ROUND:g} ms in all"
)
HELD = 1.05  # Largest ratio of the force held in the end to the limit: sensors have noise


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot, how to make another, and whether a real one may be moved."""

    robot: Robot
    make: Callable[[], Robot]
    move: bool

    @property
    @functools.lru_cache(maxsize=1)  # noqa: B019  # without a lock, as in `device_checks`
    def pressed(self) -> NDArray[np.float64]:
        """Contact force of a press to the workspace's end, from rest in free air on [N], shape (n,)."""
        robot = self.make()
        here, (_, end) = robot.read().position, robot.specification.workspace
        way = np.minimum(here + np.arange(0.0, min(end - here, 0.2), SPEED * SAMPLE_PERIOD), end)
        samples = _drive(robot, [here] * 200 + way.tolist() + [end] * 700)
        tool = robot.specification.tool_force
        force = np.array([sample.sensor_force - tool(sample.acceleration) for sample in samples])
        robot.close()
        return np.asarray(force - force[50:200].mean())


def _subject(robot: Robot, make: Callable[[], Robot], move: bool) -> Subject | Finding:
    own = getattr(robot, "specification", None)
    if isinstance(own, RobotSpecification):
        return Subject(robot, make, move)
    rule = "it has a RobotSpecification from the beginning"
    return Finding("specification", False, f"a {type(own).__name__}", rule)


def _slow(it: Subject, checks: list[str]) -> list[Finding]:
    """Findings of a robot whose exchange is far too slow; it is commanded no motion."""
    others = [other for other in checks if other != TIME]
    with contextlib.suppress(Exception):  # exceptions are reported by the checks themselves
        return too_slow(TIME, lambda: it.robot.exchange(math.nan), SAMPLE_PERIOD, FAR_TOO_LONG, TIME_RULE, others)
    return []


TIME = "exchange time"
checked = Checks(Robot, "foretouch.robot.Robot", _subject, _slow)


def check_robot(
    make: Callable[[], Robot], *, move: bool = False, tell: Callable[[Finding], None] = ignore
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
    return checked.run(make, tell, move=move)


def _if_moved(look: Callable[[Subject], Result]) -> Callable[[Subject], Result]:
    """The check where the robot may be moved."""
    unseen = (None, "it is a real one: --move lets it move", "see docs/plugins.md")
    return lambda it: look(it) if it.move or it.robot.specification.simulated else unseen


def _if_simulated(look: Callable[[Subject], Result]) -> Callable[[Subject], Result]:
    """The check where the robot is simulated."""
    unseen = (None, "it is a real one, which no check drives into anything", "see docs/plugins.md")
    return lambda it: look(it) if it.robot.specification.simulated else unseen


@checked(
    "specification",
    f"SI units, sample_period = {SAMPLE_PERIOD:g} s, workspace from a smaller to a larger place within 2 m",
)
def _specification(it: Subject) -> Result:
    own = it.robot.specification
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
    return not wrong, ", ".join(wrong) or "all within their ranges"


@checked("units", "a RobotSample in m, N and m/s^2 that is finite, at rest about 0 m/s^2, and within the workspace")
def _units(it: Subject) -> Result:
    sample: object = it.robot.read()
    if not isinstance(sample, RobotSample):
        return False, f"a {type(sample).__name__}"
    position, force, acceleration = sample.position, sample.sensor_force, sample.acceleration
    own = it.robot.specification
    low, high = own.workspace
    kept = (
        low - STILL <= position <= high + STILL
        and abs(force) <= MOST_FORCE
        and abs(acceleration) <= 2.0 + 6.0 * own.accelerometer_noise
        and low - STILL <= sample.commanded_position <= high + STILL
    )
    return kept, f"{position:.4g} m, {force:.4g} N, {acceleration:.4g} m/s^2"


@checked("reading moves nothing", "read lets no time pass: positions differ by no more than the encoder's noise")
def _reading(it: Subject) -> Result:
    own = it.robot.specification
    moved = float(np.ptp([it.robot.read().position for _ in range(50)]))
    most = 12.0 * own.encoder_noise + 2.0 * own.encoder_resolution + 1e-6
    return moved <= most, f"50 reads differ by {1e3 * moved:.4g} mm"


@checked(
    "no command, no motion", "a command that is no finite number is left out: the robot stays where it was told to be"
)
def _nonsense(it: Subject) -> Result:
    before = it.robot.read().position
    samples = _drive(it.robot, (math.nan, math.inf, -math.inf) * 30)
    moved = max(abs(sample.position - before) for sample in samples)
    return moved <= STILL, f"moves by {1e3 * moved:.4g} mm"


@checked(TIME, TIME_RULE)
def _timing(it: Subject) -> Result:
    taken = percentile_time(lambda _: it.robot.exchange(math.nan), 300, 99.0)
    if taken <= SAMPLE_PERIOD:
        return True, f"{1e3 * taken:.4g} ms"

    def work_and_exchange(_: int) -> None:
        """A round of a loop: something that takes as long as a step, and an exchange."""
        end = time.perf_counter() + STEP_TIME
        while time.perf_counter() < end:
            pass
        it.robot.exchange(math.nan)

    # A driver that waits for its cycle takes the whole of it by itself, and no longer with a step before it.
    in_all = percentile_time(work_and_exchange, 300, 99.0)
    return in_all <= ROUND, f"{1e3 * taken:.4g} ms, {1e3 * in_all:.4g} ms with a step"


@checked("sign of position")
@_if_moved
def _follows(it: Subject) -> Result:
    here = it.robot.read().position
    step = min(STEP, 0.5 * (it.robot.specification.workspace[1] - here))
    ramp = np.arange(0.0, step, SPEED * SAMPLE_PERIOD)
    _drive(it.robot, (here + ramp).tolist())
    moved = _drive(it.robot, [here + step] * 200)[-1].position - here
    _drive(it.robot, (here + ramp[::-1]).tolist() + [here] * 200)
    rule = f"positions grow into the material, in metres: told to go {1e3 * step:g} mm in, it does"
    return 0.7 * step <= moved <= 1.3 * step, f"{1e3 * moved:.4g} mm", rule


@checked(
    "sign of acceleration",
    "acceleration is in m/s^2, positive into the material, and one exchange is one sample period",
)
@_if_moved
def _swing(it: Subject) -> Result:
    if it.robot.specification.tool_mass == 0.0:
        return None, "no tool that would have to be weighed out"
    moment = np.arange(1000) * SAMPLE_PERIOD
    phase = 2.0 * math.pi * SWINGS * moment
    # Begun and ended softly: a jerk would be measured as well.
    path = it.robot.read().position + SWING * np.sin(phase) * np.sin(math.pi * moment) ** 2
    measured = np.array([sample.acceleration for sample in _drive(it.robot, path.tolist())])
    asked = np.gradient(np.gradient(path, SAMPLE_PERIOD), SAMPLE_PERIOD)
    # In and out of phase, so that a lag of some ticks does not count.
    late = np.roll(asked, round(0.25 / SWINGS / SAMPLE_PERIOD))
    basis = np.stack([asked, late, np.ones_like(asked)], axis=1)
    in_phase, quadrature, _ = np.linalg.lstsq(basis, measured, rcond=None)[0]
    size = math.hypot(in_phase, quadrature)
    return in_phase > 0.0 and 0.6 <= size <= 1.5, f"{in_phase:.3g} in phase, {size:.3g} in all, of 1"


@checked("workspace", "commands beyond the workspace are limited to it, and commanded_position says so")
@_if_simulated
def _workspace(it: Subject) -> Result:
    worst = 0.0
    for end, beyond in ((0, -0.05), (1, 0.05)):
        robot = it.make()
        low, high = robot.specification.workspace
        samples = _drive(robot, [robot.specification.workspace[end] + beyond] * 1500)
        robot.close()
        for sample in samples:
            worst = max(worst, low - sample.commanded_position, sample.commanded_position - high)
            worst = max(worst, low - sample.position - STILL, sample.position - high - STILL)
    return worst <= 1e-9, f"at most {1e3 * worst:.4g} mm beyond"


@checked("sign of force", "the sensor's force is positive in compression")
@_if_simulated
def _force_sign(it: Subject) -> Result:
    pressed = float(it.pressed[-200:].mean())
    if abs(pressed) < TOUCH:
        return None, f"nothing was touched: {pressed:.4g} N at the workspace's end"
    return pressed > 0.0, f"{pressed:.4g} N pressed at the workspace's end"


@checked("force limit")
@_if_simulated
def _force_limit(it: Subject) -> Result:
    limit = it.robot.specification.force_limit
    held = float(it.pressed[-200:].mean())
    rule = f"the force that it holds in the end is at most its force_limit, {limit:g} N"
    return held <= HELD * limit, f"{held:.4g} N", rule


def _drive(robot: Robot, path: Iterable[float]) -> list[RobotSample]:
    """Exchange along a path, in real time where the robot is real: its `exchange` need not wait for that."""
    samples, due = [], time.perf_counter()
    for position in path:
        samples.append(robot.exchange(position))
        due += SAMPLE_PERIOD
        if not robot.specification.simulated:
            time.sleep(max(due - time.perf_counter(), 0.0))
    return samples
