"""All that a session in three dimensions in simulated time needs, made as its settings say."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from foretouch.messages import Message
from foretouch.session.settings import SessionSettings
from foretouch.session.simulated import SimulatedSession
from foretouch.session.spatial.making import make_camera, make_spatial_operator, make_spatial_robot
from foretouch.session.spatial.scenes import make_scene
from foretouch.session.spatial.simulated import simulate_scene

__all__ = ["prepare_scene"]


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
