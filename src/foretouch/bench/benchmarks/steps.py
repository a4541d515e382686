"""The steps of leader and follower in a session along a line, in simulated time, with a user's settings, on one core.

The session runs once with the simulated arm, whose samples are kept, and then again with these, so that the robot costs
nothing. Sessions are the same bit by bit on repeat, so the follower meets what it asked for; what is timed is the steps
alone, as the runner times them.
"""

from __future__ import annotations

import gc

import numpy as np

from foretouch.bench.timing import Array, Row, Scope, Spread, one_core, spread
from foretouch.devices import Device
from foretouch.robot import Robot, RobotSample
from foretouch.session import SessionSettings, SimulatedSession, make_operator, make_session_robot, simulate

DURATION, ROUNDS = 10.0, 5

REACHES = {("leader", 50): 15.0, ("follower", 50): 25.0, ("leader", 99): 100.0, ("follower", 99): 100.0}
"""Longest time of each side's step at each percentile [us]."""


class RobotOnTape(Robot):
    """Keeps what a robot shows, and when it is rewound shows it again, whatever is commanded."""

    def __init__(self, robot: Robot) -> None:
        self.specification = robot.specification
        self._robot: Robot | None = robot
        self._first = robot.read()
        self._samples: list[RobotSample] = []
        self._next = 0

    def rewind(self) -> None:
        """Show the samples again, from the first; the robot is released."""
        self._robot = None
        self._next = 0

    def read(self) -> RobotSample:
        """The first sample."""
        return self._first

    def exchange(self, desired_position: float) -> RobotSample:
        """See `Robot.exchange`; on tape, the next sample."""
        if self._robot is not None:
            self._samples.append(self._robot.exchange(desired_position))
            return self._samples[-1]
        self._next += 1
        return self._samples[self._next - 1]


class TapedSession:
    """A session of a simulated duration [s], with default settings or others, whose robot's samples are on tape."""

    def __init__(self, duration: float, settings: SessionSettings | None = None) -> None:
        self._settings = SessionSettings() if settings is None else settings
        self._duration = duration
        arm, self._material = make_session_robot(self._settings)
        self._tape = RobotOnTape(arm)
        simulate(self._settings, duration=duration, operator=self._operator(), robot=self._tape)

    def times(self) -> dict[str, Array]:
        """Run it again: times of the steps [s] of leader and follower, shape (ticks,), and when the probe touched."""
        self._tape.rewind()
        operator = self._operator()
        gc.collect()
        gc.disable()
        try:
            log = simulate(self._settings, duration=self._duration, operator=operator, robot=self._tape).log
        finally:
            gc.enable()
        return {
            "leader": 1e-9 * log.leader["compute_ns"],
            "follower": 1e-9 * log.follower["compute_ns"],
            "contact": log.follower["in_contact"].astype(np.float64),
        }

    def _operator(self) -> Device:
        material = self._material
        surface, depth = material.surface, material.press_depth
        return make_operator(self._settings, surface=surface, press_depth=depth, say=lambda text: None)


def step_times(session: TapedSession, rounds: int) -> dict[tuple[str, int], Spread]:
    """Percentiles of the steps in contact [us], by side and percentile, over rounds after one to warm up."""
    session.times()
    results: dict[tuple[str, int], list[float]] = {key: [] for key in REACHES}
    for _ in range(rounds):
        times = session.times()
        touching = times["contact"] > 0.0
        for side, percentile in results:
            results[side, percentile].append(float(np.percentile(times[side][touching], percentile)))
    return {key: spread(values, 1e6) for key, values in results.items()}


def measure_steps(scope: Scope) -> list[Row]:
    """Percentiles of both steps, in contact."""
    result = step_times(TapedSession(DURATION), ROUNDS)
    return [
        Row.of(f"{side} step in contact, without the robot, {percentile} %", result[side, percentile], "us", reach)
        for (side, percentile), reach in REACHES.items()
    ]


def run_session(duration: float) -> SimulatedSession:
    """A fresh session with default settings, simulated for a duration [s]."""
    return simulate(SessionSettings(), duration=duration, say=lambda text: None)


def measure_simulate(scope: Scope) -> list[Row]:
    """Speed over real time [-]."""
    with one_core():
        run_session(0.5)
        faster = [DURATION / run_session(DURATION).elapsed for _ in range(ROUNDS)]
    what = f"simulate, {DURATION:g} s with default settings on one core, over real time"
    return [Row.of(what, spread(faster), "x", 15.0, at_least=True)]
