"""A session in three dimensions in simulated time: the same steps as in real time, bit-identical on repeat.

All that it needs and is not given is made as its settings say.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from foretouch.devices import SpatialDevice
from foretouch.link import FaultStage
from foretouch.messages import (
    CameraImage,
    Command,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Hello,
    Message,
    ModelUpdate,
    SessionLog,
    Telemetry,
)
from foretouch.robot import SpatialRobot
from foretouch.session.runners.simulated_line import SimulatedSession
from foretouch.session.runners.warm_up import warm_up_once
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import follower, leader, tracker
from foretouch.session.spatial.camera import IMAGE_PERIOD, VIEW, SimulatedCamera
from foretouch.session.spatial.making import make_camera, make_spatial_operator, make_spatial_robot
from foretouch.session.spatial.scenes import KnownSurface, Scene, make_scene
from foretouch.session.steps.counting import OperatorClock, follower_counts, leader_counts

_PERIOD_NS = round(SAMPLE_PERIOD * 1e9)
_IMAGE_TICKS = round(IMAGE_PERIOD / SAMPLE_PERIOD)
_TRACKER_TICKS = 5


def simulate_scene(
    settings: SessionSettings,
    scene: Scene,
    *,
    duration: float,
    operator: SpatialDevice,
    robot: SpatialRobot,
    camera: SimulatedCamera | None,
    description: Mapping[str, str] | None = None,
    record: Callable[[Message, int], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> SimulatedSession:
    """Run a session in three dimensions in simulated time; see `foretouch.session.simulate`.

    Args:
        settings: Of the session.
        scene: What is touched, as both sides know it.
        duration: Simulated [s].
        operator: Moves the leader.
        robot: The follower's.
        camera: Beside it; None for none.
        description: Further settings for the log.
        record: Called with each message to keep and its simulated time [ns].
        progress: Called now and then with the simulated time [s].
    """
    warm_up_once(settings)
    commands: FaultStage[Command] = FaultStage(settings.command_faults)
    returned: FaultStage[Message] = FaultStage(settings.return_faults)
    leading = leader.start(settings, scene.surface, scene.nominal)
    following = follower.start(robot.specification, settings, scene.surface, scene.nominal)
    tracking = tracker.start(KnownSurface(scene.surface), scene.nominal, settings.fusion, view=VIEW)
    ticks = round(duration / SAMPLE_PERIOD)
    compute = np.zeros((2, ticks), dtype=np.int64)
    kept = ("leader", "follower", "models", "leads", "follows", "fields", "seen", "beliefs")
    logs: dict[str, list[Any]] = {name: [] for name in kept}
    texts = settings.as_text() | {"operator": operator.name} | dict(description or {})
    images: deque[tuple[int, CameraImage]] = deque()
    beliefs: list[FixtureBelief] = []
    spaces: list[FollowerSpace] = []
    delay_ns = round(settings.camera_delay * 1e9)

    def keep(message: Message, now_ns: int) -> None:
        if record is not None:
            record(message, now_ns)

    keep(Hello.of("simulation", 1, 0, texts), 0)
    sample, clock = robot.read(), OperatorClock(operator)
    began = time.perf_counter()
    for tick in range(ticks):
        now_ns = tick * _PERIOD_NS
        start = time.perf_counter_ns()
        following, acted = follower.step(
            following, follower.Inputs(commands.pop_due(now_ns), sample, _PERIOD_NS, 0, beliefs), now_ns
        )
        compute[1, tick] = time.perf_counter_ns() - start
        logs["follower"].append(acted.telemetry)
        logs["follows"].append(acted.space)
        spaces.append(acted.space)
        for message in (acted.telemetry, acted.space, acted.model, acted.field):
            if message is not None:
                returned.push(now_ns, message)
                keep(message, now_ns)
        if acted.model is not None:
            logs["models"].append(acted.model)
        if acted.field is not None:
            logs["fields"].append(acted.field)
        sample = robot.exchange(acted.desired)

        if camera is not None and tick % _IMAGE_TICKS == 0:
            image = camera.take(
                sample.fixture, sample.exact_place, acted.space.sequence, now_ns * 1e-9, now_ns, acted.space.run
            )
            images.append((now_ns + delay_ns, image))
            logs["seen"].append(image)
            keep(image, now_ns)
        beliefs = []
        if tick % _TRACKER_TICKS == 0:
            due = []
            while images and images[0][0] <= now_ns:
                due.append(images.popleft()[1])
            belief = tracker.step(tracking, spaces, due, now_ns)
            spaces = []
            beliefs = [] if belief is None else [belief]
            if belief is not None:
                logs["beliefs"].append(belief)
                keep(belief, now_ns)

        arrived = returned.pop_due(now_ns)
        operator.see(leading.line.pose)
        start = time.perf_counter_ns()
        leading, led = leader.step(
            leading,
            leader.Inputs(
                operator.read(clock.read(now_ns, coupled=leading.inner.heard.run > 0)),
                [message for message in arrived if type(message) is ModelUpdate],
                [message for message in arrived if type(message) is Telemetry],
                [message for message in arrived if type(message) is FollowerSpace],
                [message for message in arrived if type(message) is FieldUpdate],
                _PERIOD_NS,
                0,
                operator.clutched,
                False,
                operator.exact_place,
                operator.intention,
            ),
            now_ns,
        )
        compute[0, tick] = time.perf_counter_ns() - start
        operator.render(led.force)
        logs["leader"].append(led.record)
        logs["leads"].append(led.space)
        commands.push(now_ns, led.command)
        keep(led.record, now_ns)
        keep(led.space, now_ns)
        if progress is not None and tick % 1000 == 0:
            progress(now_ns * 1e-9)
    elapsed = time.perf_counter() - began
    counts = leader_counts(leading.inner) | follower_counts(following.inner)
    counts |= tracker.counts(tracking)
    log = SessionLog.from_messages(
        logs["leader"],
        logs["follower"],
        logs["models"],
        texts,
        counts,
        leader_space=logs["leads"],
        follower_space=logs["follows"],
        fields=logs["fields"],
        images=logs["seen"],
        beliefs=logs["beliefs"],
    )
    log.leader["compute_ns"], log.follower["compute_ns"] = compute
    return SimulatedSession(log, duration, elapsed)


def prepare_scene(
    settings: SessionSettings,
    duration: float,
    *,
    description: Mapping[str, str] | None,
    progress: Callable[[float], None] | None,
    say: Callable[[str], None],
) -> Callable[[Callable[[Message, int], None] | None], SimulatedSession]:
    """Make scene, robot, operator and camera; see `foretouch.session.prepare_simulation`.

    Args:
        settings: With a scene.
        duration: Simulated [s].
        description: Further settings for the log.
        progress: Called now and then with the simulated time [s].
        say: Told in one line where there is no camera.

    Returns:
        What runs the session: it takes what records, or None.
    """
    scene = make_scene(settings.scene)
    robot = make_spatial_robot(settings, scene)
    operator = make_spatial_operator(settings, scene, scene.nominal)
    camera = make_camera(settings, scene, say=say) if settings.fusion in ("full", "image") else None

    def run(record: Callable[[Message, int], None] | None) -> SimulatedSession:
        try:
            return simulate_scene(
                settings,
                scene,
                duration=duration,
                operator=operator,
                robot=robot,
                camera=camera,
                description=description,
                record=record,
                progress=progress,
            )
        finally:
            if camera is not None:
                camera.close()

    return run
