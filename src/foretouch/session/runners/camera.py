"""The camera's process in real time: images of a simulated scene, and the tracker's belief of the fixture."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping

from foretouch.link import ZenohLink
from foretouch.messages import VERSION, CameraImage, SmallImage, Telemetry, fixture_of
from foretouch.session.network.lease import own_epoch
from foretouch.session.runners.housekeeping import ORPHANED, Greeter, StopFlag, orphaned
from foretouch.session.settings import SessionSettings
from foretouch.session.spatial import tracker
from foretouch.session.spatial.camera import IMAGE_PERIOD, SMALL_PERIOD, VIEW, SimulatedCamera, small_image
from foretouch.session.spatial.scenes import KnownSurface, make_scene

CAMERA_CHANNELS = ("telemetry", "stop")
"""Channels that the camera's link receives: a simulated camera sees the world of the follower's simulation."""

POLL_PERIOD = 0.005
GRACE = 1.0  # Time for which it goes on after the end of the session was announced [s]


def run_camera(
    link: ZenohLink,
    camera: SimulatedCamera | None,
    settings: SessionSettings,
    *,
    stop: StopFlag,
    parent: int | None = None,
    description: Callable[[], Mapping[str, str]] = dict,
) -> dict[str, str | int]:
    """Take images, track the fixture, and publish both, until a `Stop` has arrived or `stop` is set.

    Args:
        link: Link with `CAMERA_CHANNELS`.
        camera: None for none: then touches alone are tracked.
        settings: Session settings.
        stop: Checked in every round.
        parent: Process whose end ends this one.
        description: Gives the texts of the `Hello` messages.

    Returns:
        Reason for the end, as ``ended``, and the counts of the tracker, by name.
    """
    state: tracker.State | None = None
    epoch = own_epoch()
    images: deque[tuple[float, CameraImage]] = deque()
    newest: Telemetry | None = None
    begun = exposed = shown = time.monotonic()
    small_images = 0
    end, greeter = float("inf"), Greeter(link, "camera")
    while not stop.reason and (now := time.monotonic()) <= end:
        ticks = [telemetry for _, telemetry in link.take("telemetry") if telemetry.space is not None]
        if ticks:
            if newest is None or ticks[-1].run > newest.run:  # another process, and a world that begins anew
                epoch += 1
                state = _begin(settings, ticks[-1], epoch)
                images.clear()
                begun = now
            newest = ticks[-1]
        if camera is not None and newest is not None and now - exposed >= IMAGE_PERIOD:
            exposed = max(exposed + IMAGE_PERIOD, now - IMAGE_PERIOD)
            images.append((now + settings.camera_delay, _take(camera, newest, now - begun)))
        due = []
        while images and images[0][0] <= now:
            due.append(images.popleft()[1])
            link.publish(due[-1])
            if settings.budget and now - shown >= SMALL_PERIOD:
                shown, small_images = now, small_images + 1
                link.publish(SmallImage(VERSION, small_images, 0, small_image(due[-1], settings.budget)))
        if newest is not None and state is not None:
            belief = tracker.step(state, ticks, due, newest.time_ns)
            if belief is not None:
                link.publish(belief)
        if link.take("stop"):
            end = min(end, now + GRACE)
        if greeter.due():
            greeter.greet(description())
            if orphaned(parent):
                stop.set(ORPHANED)
        time.sleep(POLL_PERIOD)
    used = {} if state is None else tracker.counts(state)
    return {"ended": stop.reason or "the session was ended"} | used


def _begin(settings: SessionSettings, tick: Telemetry, epoch: int) -> tracker.State:
    """A tracker from where the follower believes the fixture, at its clock."""
    assert tick.space is not None
    scene = make_scene(settings.scene, settings.probe_radius)
    known, believed, time = KnownSurface(scene.surface), fixture_of(tick.space), tick.time_ns * 1e-9
    return tracker.start(known, believed, scene.told_by(settings.fusion), view=VIEW, time=time, epoch=epoch)


def _take(camera: SimulatedCamera, tick: Telemetry, seconds: float) -> CameraImage:
    """An image of the follower's newest tick."""
    space = tick.space
    assert space is not None
    fixture = (space.exact_x, space.exact_y, space.exact_z, space.exact_rx, space.exact_ry, space.exact_rz)
    probe = (space.place_x, space.place_y, space.place_z)
    return camera.take(fixture, probe, tick.sequence, seconds, time.monotonic_ns(), tick.run)
