"""Asking for an emergency stop, until it is known that the robot has stopped.

It stands here because it needs no more than a link: who types it does not wait until laws and robots are imported.
"""

from __future__ import annotations

import secrets
import time

from foretouch.link.zenoh_link import ZenohLink
from foretouch.messages import VERSION, EmergencyStop, Status

__all__ = ["ASKING_PERIOD_NS", "STOPPING_CHANNELS", "ask_to_stop", "new_press"]

STOPPING_CHANNELS = ("telemetry", "hello")
"""What the link of who asks receives."""

ASKING_PERIOD_NS = 50_000_000
"""An emergency stop is asked for this often [ns], until the follower says that it has stopped."""


def new_press() -> int:
    """A number for one press of an emergency stop."""
    return 1 + secrets.randbits(62)


def ask_to_stop(link: ZenohLink, reason: str, *, patience: float = 5.0) -> int | None:
    """Ask every follower on the link for an emergency stop, again and again until one says that it has stopped.

    Args:
        link: With `STOPPING_CHANNELS`.
        reason: One sentence, for the people at the robot.
        patience: For so long [s] it is asked at most.

    Returns:
        `Status.STOPPED`; or where nobody has said so, the status that was heard last, None for none.

    Raises:
        PeerVersionError: Nobody has said so, and the follower speaks another version: it does not understand.
    """
    heard: int | None = None
    asked, end, press = 0, time.monotonic() + patience, new_press()
    while heard != Status.STOPPED and time.monotonic() < end:
        asked += 1
        link.publish(EmergencyStop(VERSION, asked, time.monotonic_ns(), reason, press))
        time.sleep(ASKING_PERIOD_NS * 1e-9)
        for _, telemetry in link.take("telemetry"):
            heard = telemetry.status
    if heard is None and (error := link.other_version({"follower"})) is not None:
        raise error
    return heard
