"""What is sent: one row a channel."""

from __future__ import annotations

from dataclasses import dataclass

from foretouch.messages.schema import (
    Choice,
    Command,
    EmergencyStop,
    Handle,
    Hello,
    LeaderState,
    Message,
    ModelUpdate,
    Settings,
    Stop,
    Telemetry,
)
from foretouch.messages.spatial import CameraImage, FieldUpdate, FixtureBelief, FollowerSpace, LeaderSpace

__all__ = ["CHANNELS", "Channel"]


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a session.

    Attributes:
        name: Last part of the network key.
        kind: The message class it carries.
        sender: ``"leader"``, ``"follower"``, ``"camera"``, ``"console"`` or ``"any"``.
        rate: Messages a second, 0 where they come on an event.
    """

    name: str
    kind: type[Message]
    sender: str
    rate: float


CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("command", Command, "leader", 1000.0),
        Channel("model", ModelUpdate, "follower", 50.0),
        Channel("telemetry", Telemetry, "follower", 1000.0),
        Channel("leader", LeaderState, "leader", 1000.0),
        Channel("follower-space", FollowerSpace, "follower", 1000.0),
        Channel("leader-space", LeaderSpace, "leader", 1000.0),
        Channel("field", FieldUpdate, "follower", 5.0),
        Channel("fixture", FixtureBelief, "camera", 30.0),
        Channel("image", CameraImage, "camera", 30.0),
        Channel("handle", Handle, "console", 0.0),
        Channel("settings", Settings, "console", 0.0),
        Channel("choice", Choice, "console", 0.0),
        Channel("stop", Stop, "any", 0.0),
        Channel("emergency", EmergencyStop, "any", 0.0),
        Channel("hello", Hello, "any", 2.0),
    )
}
"""Every channel of a session by name."""
