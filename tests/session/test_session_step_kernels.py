"""What is compiled of the follower's step: the same numbers as interpreted, and nothing compiled in a loop."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys

import numpy as np
import pytest
from motion_limits import UNBOUNDED, MotionLimits
from numpy.typing import NDArray
from pressed import keep_safe

from foretouch.core import kernel
from foretouch.identification import SensorWatch
from foretouch.identification.conditioning import watch as sensor_watch_kernel
from foretouch.session.safety import kernel as safety_kernel
from foretouch.session.safety import motion as motion_limits_kernel
from foretouch.session.safety.force_guard import PATIENCE, SOFTEST, ForceGuard, allowed_speed, observe
from foretouch.session.safety.safety import Safety, SafetyLimits

TICK = 1e-3


@kernel("f8(ForceGuard[::1], f8, f8, b1, f8, f8)")
def guarded_speed(
    guards: NDArray[np.void], position: float, force: float, in_contact: bool, limit: float, damping: float
) -> float:
    """What a tick asks a guard: to take a sample, and how fast the robot may go deeper after it."""
    observe(guards[0], position, force, in_contact)
    return allowed_speed(guards[0], limit, damping)


KERNELS = (
    guarded_speed,
    motion_limits_kernel.begin,
    motion_limits_kernel.limited,
    motion_limits_kernel.go_on,
    safety_kernel.keep_safe,
    safety_kernel.limit,
    sensor_watch_kernel.look,
)


def pressed(seed: int, ticks: int = 1500) -> list[object]:
    numbers, output = random.Random(seed), []
    watch, safety = SensorWatch((-40.0, 40.0)), Safety(SafetyLimits(workspace=(-0.02, 0.05), retreats=True), TICK)
    guard, motion = ForceGuard.new(), MotionLimits(0.25, 40.0, 1e5, TICK)
    space = MotionLimits(0.25, 40.0, 1e5, TICK)
    motion.begin(0.0)
    space.begin(0.0, 0.0, 0.0)
    place = wanted = offset = silence = 0.0
    for tick in range(ticks):
        trouble = numbers.random()
        if trouble < 0.01:
            wanted = numbers.uniform(-0.01, 0.03)
        elif trouble < 0.013:
            silence = numbers.choice((0.0, 0.03, 0.1, 1.0))
        elif trouble < 0.015:
            offset = numbers.choice((0.0, 3.0))
        elif trouble < 0.016:
            watch.reset()
        elif trouble < 0.0165:
            safety.stop("pressed")
        elif trouble < 0.02:
            safety.release(0.0, 0.0)
        silence += TICK if silence else 0.0
        force = 8e3 * max(place - 0.01, 0.0) + offset + numbers.gauss(0.0, 0.01)
        force = math.nan if numbers.random() < 1e-3 else force + 10.0 * (numbers.random() < 2e-3)
        state = watch.update(tick * TICK, place, force)
        deeper = guarded_speed(guard, place, force, force > 0.05, 15.0, 20.0)
        surface = 0.01 if tick > ticks // 3 else math.nan
        told = keep_safe(safety, wanted, (place, force, force > 0.05, bool(state)), surface, silence)
        path = motion.update(wanted, deeper if tick % 2 else math.inf)
        output += [int(state), told, int(safety.status), safety.pressing, float(guard[0].stiffness)]
        output += [path, *motion.velocity, *motion.acceleration]
        bound = (0.6, 0.0, -0.8, max(deeper, 0.0))
        output += space.move((wanted, place, -wanted), (UNBOUNDED, UNBOUNDED, bound), (0.0, 0.0, 1e-6))
        place += 0.3 * (told - place)
    return output


INTERPRETED = """
import sys
sys.path.insert(0, {folder!r})
from test_session_step_kernels import pressed
assert not hasattr(__import__("foretouch.session.safety.kernel").session.safety.kernel.keep_safe, "signatures")
print(repr([pressed(seed) for seed in range(3)]))
"""


@pytest.mark.long
def test_compiled_and_interpreted_are_equal() -> None:
    script = INTERPRETED.format(folder=os.path.dirname(__file__))
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    output = [pressed(seed) for seed in range(3)]
    assert done.stdout.strip() == repr(output)  # the types too: what is sent is of Python's own
    states = {number for run in output for number in run[::15]}
    statuses = {number for run in output for number in run[2::15]}
    assert len(states) > 3
    assert len(statuses) > 4


SESSIONS = """
import hashlib
from foretouch.session import SessionSettings, simulate
guarded = dict(first_touch="guarded", approach_speed=0.2, material="hunt-crossley", sensor_fault="stuck:1.3:1.5")
for changes in ({}, guarded, dict(model="kelvin-voigt", estimator="rls")):
    log = simulate(SessionSettings(**changes), duration=1.6, say=lambda text: None).log
    for rows in (log.follower, log.leader):
        numbers = [rows[name].tobytes() for name in rows.dtype.names if name != "compute_ns"]
        print(hashlib.sha256(b"".join(numbers)).hexdigest(), int(log.follower["in_contact"].sum()) > 100)
"""


@pytest.mark.long
def test_a_session_is_the_same_compiled_and_interpreted() -> None:
    told = [
        subprocess.run(
            [sys.executable, "-c", SESSIONS],
            env={**os.environ, "NUMBA_DISABLE_JIT": interpreted},
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        ).stdout
        for interpreted in ("0", "1")
    ]
    assert told[0] == told[1]
    assert told[0].count("True") == 6


def test_a_whole_number_compiles_nothing_and_is_the_same() -> None:
    output = []
    for kind in (int, float):
        safety, watch, guard = Safety(SafetyLimits(), TICK), SensorWatch(), ForceGuard.new()
        motion, answers = MotionLimits(0.25, 40.0, 1e5, TICK), []
        motion.begin(kind(0))
        for tick in range(50):
            number = kind(tick // 40)
            answers += [watch.update(number, number, number), motion.update(number)]
            answers.append(guarded_speed(guard, number, number, False, number, number))
            answers += motion.move((number, number, number))
            answers.append(keep_safe(safety, number, (number, number, False), number, kind(0)))
        output.append(answers)
    assert output[0] == output[1]
    assert [len(getattr(kernel, "signatures", [None])) for kernel in KERNELS] == [1] * len(KERNELS)


def test_an_array_that_is_shared_disturbs_nobody_and_a_guard_without_a_contact_reckons_with_the_softest() -> None:
    limits = SafetyLimits(workspace=(-1.0, 1.0))
    safety, alone = Safety(limits, TICK), MotionLimits(limits.speed, limits.acceleration, limits.jerk, TICK)
    aims = [0.005 * math.sin(tick / 400) for tick in range(2000)]
    told = [keep_safe(safety, aim, (aim, 0.0, False), 0.5, 0.0) for aim in aims]
    alone.begin(0.0)
    reckoned = [alone.update(aim) for aim in aims]
    assert told[400:] == pytest.approx(reckoned[400:], abs=1e-9)
    guard = ForceGuard.new()
    assert guarded_speed(guard, 0.0, math.nan, False, 15.0, 0.0) == 0.0
    assert guarded_speed(guard, 0.0, 1.0, False, 15.0, 0.0) == pytest.approx(14.0 / (SOFTEST * PATIENCE))
    assert guard[0].stiffness == SOFTEST
    assert math.isnan(guard[0].onset)
