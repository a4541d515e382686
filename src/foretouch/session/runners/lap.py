"""One session in simulated time, along a line and in three dimensions, with the sides driven as in real time."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.messages import CameraImage, Hello, Message, SessionLog, Telemetry
from foretouch.quantities import Columns
from foretouch.session.runners.driven import SpaceFollower, Tick, drive_follower, drive_leader
from foretouch.session.runners.warm_up import warm_up_once
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import tracker
from foretouch.session.spatial.camera import IMAGE_PERIOD, VIEW, SimulatedCamera
from foretouch.session.spatial.scenes import KnownSurface, make_scene

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)
PROGRESS_NS = 1_000_000_000

Record = Callable[[Message, int], None]
"""Called with each message to keep and its simulated time [ns]."""

Progress = Callable[[float], None]
"""Called now and then with the simulated time [s]."""


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

    def __init__(self, settings: SessionSettings, camera: SimulatedCamera | None, follows: SpaceFollower) -> None:
        scene = make_scene(settings.scene)
        self._follows, self._camera = follows, camera
        self._state = tracker.start(KnownSurface(scene.surface), scene.nominal, settings.fusion, view=VIEW)
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
    """Run a session in simulated time: follower, network, leader, network, tick by tick.

    Args:
        settings: Session settings.
        operator: Moves the leader: a `Device`, or with a scene a `SpatialDevice`.
        robot: The follower's: a `Robot`, or with a scene a `SpatialRobot`.
        camera: Camera beside a robot in three dimensions; None for none.
        duration: Simulated time [s].
        description: Further settings for the log.
        record: Called with each message to keep.
        progress: Called once a simulated second.
    """
    warm_up_once(settings)
    follows, leads = drive_follower(robot, settings, 1), drive_leader(operator, settings, "leader", 1)
    watcher = CameraAndTracker(settings, camera, follows) if isinstance(follows, SpaceFollower) else None
    computed: tuple[list[int], list[int]] = [], []  # [ns]
    texts = settings.as_text() | {"operator": operator.name} | dict(description or {})
    kept: list[Message] = []
    if record is not None:
        record(Hello.of("simulation", 1, 0, texts), 0)
    began = time.perf_counter()
    for now_ns in range(0, round(duration / SAMPLE_PERIOD) * _PERIOD_NS, _PERIOD_NS):
        tick = Tick(now_ns, _PERIOD_NS)
        messages = follows.tick(tick)
        for message in messages:
            leads.arriving.push(now_ns, message)
        follows.exchange()
        if watcher is not None:
            messages += watcher.look(messages, now_ns)
        command, *records = leads.tick(tick)
        follows.arriving.push(now_ns, command)
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
    counts |= {} if watcher is None else watcher.counts()
    log = SessionLog.from_messages(kept, texts, counts)
    log.leader["compute_ns"], log.follower["compute_ns"] = np.array(computed, dtype=np.int64)
    return SimulatedSession(log, duration, elapsed)
