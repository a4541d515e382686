"""Sessions in three dimensions, for the commands that run them in simulated time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from foretouch.cli.options import say

if TYPE_CHECKING:
    from foretouch.messages import Message
    from foretouch.session import SessionSettings, SimulatedSession

__all__ = ["scene_session"]


def scene_session(
    settings: SessionSettings, duration: float, progress: Callable[[float], None] | None = None
) -> Callable[[Callable[[Message, int], None] | None], SimulatedSession]:
    """Make what a simulated session in three dimensions needs; bad input is refused here, before anything is written.

    Args:
        settings: With a scene.
        duration: Simulated [s].
        progress: Called now and then with the simulated time [s].

    Returns:
        What runs the session: it takes what records, or None.
    """
    from foretouch.session.spatial import (
        make_camera,
        make_scene,
        make_spatial_operator,
        make_spatial_robot,
        simulate_scene,
    )

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
                record=record,
                progress=progress,
            )
        finally:
            if camera is not None:
                camera.close()

    return run
