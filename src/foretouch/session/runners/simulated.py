"""Sessions in simulated time: the same steps, one process, a seeded network, bit-identical on repeat."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.devices import Device, SpatialDevice
from foretouch.errors import InputError, SettingError
from foretouch.errors.checks import require, require_type
from foretouch.messages import CameraImage, Hello, Message, SessionLog, Telemetry
from foretouch.quantities import Columns
from foretouch.robot import Robot, SpatialRobot
from foretouch.session.operators import (
    close_operator,
    felt_texts,
    reach_of,
    require_axes,
    require_simulated_operator,
    require_simulated_time,
    say_on_stderr,
)
from foretouch.session.runners.driven import DrivenFollower, Tick, drive_follower, drive_leader
from foretouch.session.runners.warm_up import warm_up_once
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.setup import setup_of
from foretouch.session.spatial import SimulatedCamera, make_scene, tracker
from foretouch.session.spatial.camera import IMAGE_PERIOD, VIEW
from foretouch.session.spatial.scenes import KnownSurface
from foretouch.session.workspace import unused_setting

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)
PROGRESS_NS = 1_000_000_000

Record = Callable[[Message, int], None]  # with each message to keep and its simulated time [ns]
Progress = Callable[[float], None]  # with the simulated time [s]


@dataclass(frozen=True)
class SimulatedSession(Columns):
    """A simulated session; its columns are those of its log.

    The same settings give an equal one: ``==`` leaves out how long the computer took.

    Attributes:
        log: Messages of the session; its `compute_ns` columns hold the real computing times of the steps on this
            machine, which are the only thing that differs on repeat.
        duration: Simulated time [s].
        elapsed: Real time [s].
    """

    log: SessionLog
    duration: float
    elapsed: float = field(compare=False)

    def columns(self) -> dict[str, NDArray[Any]]:
        """See `SessionLog.columns`."""
        return self.log.columns()


TRACKER_PERIOD_NS = 5_000_000  # Time between two steps of the tracker, as in its process [ns]


class CameraAndTracker:
    """Camera, None for none, and tracker in three dimensions, whose belief of the fixture the follower receives."""

    def __init__(self, settings: SessionSettings, camera: SimulatedCamera | None, follows: DrivenFollower) -> None:
        scene = make_scene(settings.scene, settings.probe_radius)
        self._follows, self._camera = follows, camera
        self._state = tracker.start(
            KnownSurface(scene.surface), scene.nominal, scene.told_by(settings.fusion), view=VIEW
        )
        self._image_period_ns = round(IMAGE_PERIOD / SAMPLE_PERIOD) * _PERIOD_NS
        self._delay_ns = round(settings.camera_delay * 1e9)
        self._coming: deque[tuple[int, CameraImage]] = deque()  # time of reading, and the image
        self._ticks: list[Telemetry] = []

    def look(self, messages: list[Message], now_ns: int) -> list[Message]:
        """One tick, after the robot has moved: from the follower's messages to the further ones to record."""
        seen: list[Message] = []
        telemetry = messages[0]
        assert isinstance(telemetry, Telemetry)
        self._ticks.append(telemetry)
        if self._camera is not None and now_ns % self._image_period_ns == 0:
            sample = self._follows.sample
            image = self._camera.take(
                sample.fixture, sample.exact_place, telemetry.sequence, now_ns * 1e-9, now_ns, telemetry.run
            )
            self._coming.append((now_ns + self._delay_ns, image))
            seen.append(image)
        if now_ns % TRACKER_PERIOD_NS == 0:
            due = []
            while self._coming and self._coming[0][0] <= now_ns:
                due.append(self._coming.popleft()[1])
            belief = tracker.step(self._state, self._ticks, due, now_ns)
            self._ticks = []
            if belief is not None:
                self._follows.beliefs = [belief]
                seen.append(belief)
        return seen

    def counts(self) -> dict[str, int]:
        """Counters, by name."""
        return tracker.counts(self._state)


def run_session(
    settings: SessionSettings,
    operator: Any,
    robot: Any,
    camera: SimulatedCamera | None = None,
    *,
    duration: float,
    description: Mapping[str, str] | None = None,
    record: Record | None = None,
    progress: Progress | None = None,
) -> SimulatedSession:
    """Run a session with machines that are given, as `simulate` does: follower, network, leader, network, tick by tick.

    In three dimensions there may be a camera beside the robot.
    """
    warm_up_once(settings)
    follows, leads = drive_follower(robot, settings, 1), drive_leader(operator, settings, "leader", 1)
    watchers = [CameraAndTracker(settings, camera, follows) for _ in settings.workspace.beside]
    computed: tuple[list[int], list[int]] = [], []  # [ns]
    texts = settings.as_text() | {"operator": operator.name} | dict(description or {})
    kept: list[Message] = []
    if record is not None:
        record(Hello.of("simulation", 1, 0, texts), 0)
    began = time.perf_counter()
    for now_ns in range(0, round(duration / SAMPLE_PERIOD) * _PERIOD_NS, _PERIOD_NS):
        tick = Tick(now_ns, _PERIOD_NS)
        messages = follows.tick(tick)
        for message in follows.crossing(messages):
            leads.arriving.push(now_ns, message)
        follows.exchange()
        for watcher in watchers:
            messages += watcher.look(messages, now_ns)
        command, *records = leads.tick(tick)
        for message in leads.crossing([command, *records])[:1]:
            follows.arriving.push(now_ns, message)
        computed[0].append(leads.computed_ns)
        computed[1].append(follows.computed_ns)
        messages += records
        kept += messages
        if record is not None:
            for message in messages:
                record(message, now_ns)
        if progress is not None and now_ns % PROGRESS_NS == 0:
            progress(now_ns * 1e-9)
    elapsed = time.perf_counter() - began
    counts = leads.counts() | follows.counts()
    for watcher in watchers:
        counts |= watcher.counts()
    log = SessionLog.from_messages(kept, texts, counts)
    log.leader["compute_ns"], log.follower["compute_ns"] = np.array(computed, dtype=np.int64)
    return SimulatedSession(log, duration, elapsed)


def simulate(
    settings: SessionSettings,
    *,
    duration: float = 20.0,
    operator: Device | SpatialDevice | None = None,
    robot: Robot | SpatialRobot | None = None,
    description: Mapping[str, str] | None = None,
    record: Record | None = None,
    progress: Progress | None = None,
    say: Callable[[str], None] = say_on_stderr,
) -> SimulatedSession:
    """Run a session in simulated time, as the command ``foretouch simulate`` does; with a scene, in three dimensions.

    Each tick runs the follower, then the leader. Time is the number of the tick, so that nothing of this machine
    enters; the real computing times are kept out of the messages.

    Args:
        settings: Of the session.
        duration: Simulated [s]; by default as long as on the command line.
        operator: Moves the leader, and has moved none before; with a scene a `SpatialDevice`. It counts as the
            settings' leader frame says. None for the settings' own.
        robot: The follower's, which has not moved before and presses the settings' material, or one of your own; with a
            scene a `SpatialRobot`. It counts as the settings' follower frame says. None for the settings' own.
        description: Further settings for the log, as the sides say in their `Hello`.
        record: Called with each message to keep and its simulated time [ns]; bad input is refused before.
        progress: Called now and then with the simulated time [s].
        say: Told in one line what was assumed or left out where operator and robot are made.

    Raises:
        SettingError: A setting of a scene where there is none; a duration that is negative or not finite; a robot of
            another material than the settings'; an operator or a robot of one axis in a scene, or of three along a
            line; settings whose operator or robot needs real time.
        InputError: An operator or a robot that was used before, as far as it says (`Device.fresh`, `Robot.fresh`).
        ArgumentTypeError: Settings, operator, robot or description that are none.
        MissingExtraError: What the robot needs is not installed.
    """
    require_type("settings", settings, SessionSettings, "SessionSettings: SessionSettings() are the defaults")
    kinds = {"operator": (Device, SpatialDevice), "robot": (Robot, SpatialRobot)}
    for (name, kind), given in zip(kinds.items(), (operator, robot), strict=True):
        kinds_of = f"a {kind[0].__name__}, in a scene a {kind[1].__name__}"
        wanted = f"{kinds_of}, or None for the settings' own: make_{name} gives one"
        require_type(name, given, (*kind, type(None)), wanted)
        if given is not None:
            require_axes(name, given, type(given).__name__, settings)
            if not given.fresh:
                raise InputError(f"the {name} was used before: make a fresh one for each session, or leave it out")
    require_type("description", description, (Mapping, type(None)), "texts by name, or None")
    if unused := unused_setting(settings):
        raise unused
    require("duration", duration, at_least=0.0)
    if operator is None:
        require_simulated_operator(settings)
    with ExitStack() as made:  # closed here is what is made here
        setup = setup_of(settings)
        if robot is not None:
            reach = reach_of(robot, settings)
        else:
            robot, reach = setup.robot()
            made.callback(robot.close)
            if not robot.specification.simulated:
                raise SettingError("robot", settings.robot, "is a real one and needs real time: foretouch teleop")
        texts = setup.texts(robot, reach)
        if operator is None:
            operator = setup.operator(reach, say)
            made.callback(close_operator, operator)
            require_simulated_time(operator)
        camera = setup.camera(robot, say)
        if camera is not None:
            made.callback(camera.close)
        texts = felt_texts(operator, settings) | texts | dict(description or {})
        told: dict[str, Any] = {"description": texts, "record": record, "progress": progress}
        return run_session(settings, operator, robot, camera, duration=duration, **told)
