"""The steps of leader and follower in sessions along a line and in a scene, in simulated time, on one core.

The session runs once with the simulated arm, whose samples are kept, and then again with these, so that the robot costs
nothing. Sessions are the same bit by bit on repeat, so the follower meets what it asked for; what is timed is the steps
alone, as the runner times them.
"""

from __future__ import annotations

import gc
import itertools
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.bench.benchmarks.updates import growth
from foretouch.bench.timing import Array, Row, Scope, Spread, one_core, resident_bytes, spread
from foretouch.models import make_model
from foretouch.rendering import Renderer
from foretouch.robot import AnyRobot, SpatialRobot, WrappedRobot, WrappedSpatialRobot
from foretouch.robot.robot import Wrapped
from foretouch.session import SessionSettings, SimulatedSession, make_operator, make_session_robot, simulate
from foretouch.session.spatial import make_scene, make_spatial_operator, make_spatial_robot
from foretouch.session.steps import leader

DURATION, ROUNDS = 10.0, 5

REACHES = {("leader", 50): 8.0, ("follower", 50): 10.0, ("leader", 99): 30.0, ("follower", 99): 40.0}
REACHES_IN_SPACE = {("leader", 50): 12.0, ("follower", 50): 15.0, ("leader", 99): 45.0, ("follower", 99): 60.0}
"""Longest time of each side's step at each percentile, along a line and on the phantom [us]."""

PHANTOM: dict[str, Any] = {"scene": "phantom", "material": "hunt-crossley", "fusion": "contact"}
"""Settings of a session on the phantom without a camera, which would cost more than all the rest."""

TICKS = 10_000  # Number of ticks of rendering in a round
GROWN_TICKS = 100_000  # and of those over which memory may not grow


class _OnTape(Wrapped[Any, Any]):
    """Keeps what a robot shows, or, once it was rewound, shows it again, whatever is commanded."""

    def __init__(self, robot: AnyRobot[Any, Any]) -> None:
        super().__init__(robot)
        self._first = robot.read()
        self._samples: list[Any] = []
        self._next = -1

    def rewind(self) -> None:
        """Show the samples again, from the first."""
        self._next = 0

    @property
    def fresh(self) -> bool:
        """True: it can be rewound."""
        return True

    def read(self) -> Any:
        """The first sample."""
        return self._first

    def exchange(self, desired_position: Any) -> Any:
        """See `Robot.exchange`; on tape, the next sample."""
        if self._next < 0:
            self._samples.append(self.robot.exchange(desired_position))
            return self._samples[-1]
        self._next += 1
        return self._samples[self._next - 1]


class RobotOnTape(_OnTape, WrappedRobot):
    """Keeps what a robot along a line shows, and shows it again."""


class SpatialRobotOnTape(_OnTape, WrappedSpatialRobot):
    """The same in three dimensions."""

    def __init__(self, robot: SpatialRobot) -> None:
        _OnTape.__init__(self, robot)
        self.reach = robot.reach


class TapedSession:
    """A session of a simulated duration [s], with default settings or others, whose robot's samples are on tape."""

    def __init__(self, duration: float, settings: SessionSettings | None = None) -> None:
        self._settings = SessionSettings() if settings is None else settings
        self._duration = duration
        self._tape: RobotOnTape | SpatialRobotOnTape
        if self._settings.scene:
            self._tape = SpatialRobotOnTape(make_spatial_robot(self._settings, make_scene(self._settings.scene)))
        else:
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

    def _operator(self) -> Any:
        settings = self._settings
        if settings.scene:
            scene = make_scene(settings.scene)
            return make_spatial_operator(settings, scene, scene.nominal, say=_quiet)
        material = self._material
        return make_operator(settings, surface=material.surface, press_depth=material.press_depth, say=_quiet)


def _quiet(text: str) -> None:
    """Say nothing."""


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
    """Percentiles of both steps, in contact, along a line and on the phantom; a tick alone; memory that ticks leave."""
    rows = []
    sessions = ("", SessionSettings(), REACHES), (" on the phantom", SessionSettings(**PHANTOM), REACHES_IN_SPACE)
    for where, settings, reaches in sessions:
        result = step_times(TapedSession(DURATION, settings), ROUNDS)
        rows += [
            Row.of(f"{side} step in contact{where}, without the robot, {percentile} %", result[key], "us", reach)
            for key, reach in reaches.items()
            for side, percentile in (key,)
        ]
    render, times = _rendering(), []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        render(TICKS)
        times.append((time.perf_counter() - began) / TICKS)
    rows.append(Row.of("leader's tick alone, with a contact map", spread(times, 1e6), "us", 3.0))
    rows.append(Row("leader's step without a message, blocks of memory that it leaves", _blocks_left(), "", 10.0))
    if resident_bytes():
        rows.append(
            Row("leader's tick, memory that 10^5 ticks leave", float(growth(lambda: render(GROWN_TICKS))), "B", 0.0)
        )
    return rows


def _blocks_left() -> float:
    """Blocks of memory that the outputs of a leader's step hold, without a message: it has freed all others."""
    kept: list[Any] = [None] * TICKS
    state, inputs = leader.start(), leader.Inputs(1e-3, (), 1_000_000, 0)
    before = sys.getallocatedblocks()
    for tick in range(TICKS):
        kept[tick] = leader.step(state, inputs, 1_000_000 * tick)
    return (sys.getallocatedblocks() - before) / TICKS


def _rendering() -> Callable[[int], None]:
    """So many more ticks of a hand with a device in the contact map that a default session learnt."""
    model = run_session(6.0).log.models[-1]
    renderer, period = Renderer(SessionSettings(grip="normal").device), 1e-3
    renderer.engage(0.0, model.surface + 2e-3)
    renderer.adopt(make_model(model.law, model.parameters, model.map), model.surface)
    ticks = itertools.count(1)

    def render(count: int) -> None:
        for tick in itertools.islice(ticks, count):
            renderer.update(period * tick, 1e-3 * math.sin(6.0 * period * tick), period)

    render(TICKS)
    return render


def run_session(duration: float, **settings: Any) -> SimulatedSession:
    """A fresh session with these settings, simulated for a duration [s]."""
    return simulate(SessionSettings(**settings), duration=duration, say=_quiet)


def measure_simulate(scope: Scope) -> list[Row]:
    """Speed over real time [-]."""
    rows = []
    for what, settings, reach in (
        ("with default settings", {}, 35.0),
        ("on the phantom, without a camera", PHANTOM, 20.0),
    ):
        with one_core():
            run_session(0.5, **settings)
            faster = [DURATION / run_session(DURATION, **settings).elapsed for _ in range(ROUNDS)]
        what = f"simulate, {DURATION:g} s {what} on one core, over real time"
        rows.append(Row.of(what, spread(faster), "x", reach, at_least=True))
    return rows
