"""The frames in which vectors and poses are given, by name: one table for recordings, ROS topics, files and errors."""

from __future__ import annotations

from typing import Final

WORLD: Final = "world"
"""Name of a frame of `FRAMES`."""

BASE: Final = "base"
"""Name of a frame of `FRAMES`."""

FLANGE: Final = "flange"
"""Name of a frame of `FRAMES`."""

SENSOR: Final = "sensor"
"""Name of a frame of `FRAMES`."""

TIP: Final = "tip"
"""Name of a frame of `FRAMES`."""

FIXTURE: Final = "fixture"
"""Name of a frame of `FRAMES`."""

CAMERA: Final = "camera"
"""Name of a frame of `FRAMES`."""

FRAMES: Final = {
    WORLD: "of the session: commands and places of a scene; an arm's base turned and moved by --follower-frame",
    BASE: "at the arm's foot, z up",
    FLANGE: "where the tool is mounted, z out of the arm",
    SENSOR: "in which force and torque are measured; its origin is what torques are about",
    TIP: "at the probe's tip, z out of the surface that is touched, as the contact force acts on the probe",
    FIXTURE: "of what is touched: the surface, and what is learnt of it place by place",
    CAMERA: "of the image, z along the view",
}
"""What each frame is, by its name."""


def wrong_frame(given: str, needed: str) -> str:
    """The rule that a file breaks whose vectors are in another frame than they have to be.

    Args:
        given: Name of its frame, known or not.
        needed: One of `FRAMES`.
    """
    known = FRAMES.get(given, f"unknown here; there are {', '.join(FRAMES)}")
    return f"is in the frame {given} ({known}), and has to be in {needed} ({FRAMES[needed]})"
