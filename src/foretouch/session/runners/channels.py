"""What the link of a side receives, with and without a thin link, and how a link and its end belong together."""

from __future__ import annotations

import time

from foretouch.link import ZenohLink
from foretouch.messages import CameraImage, Hello, Message
from foretouch.session.runners.driven import SpaceFollower, SpaceLeader
from foretouch.session.settings import SessionSettings
from foretouch.session.thin import FollowerEnd, LeaderEnd

FOLLOWER_CHANNELS = ("command", "settings", "stop", "emergency", "hello", *SpaceFollower.channels)
"""Channels that the follower's link receives; the last is silent along a line."""

LEADER_CHANNELS = ("model", "telemetry", "handle", "settings", "stop", "hello", *SpaceLeader.channels)
"""Channels that the leader's link receives; the last two are silent along a line."""

THIN_CHANNELS = {
    "follower": ("forth", "small", "settings", "stop", "emergency"),
    "leader": ("back", "handle", "settings", "stop", "emergency"),
}
"""Channels that a side's link receives over a thin link. All else of the other side comes in its packets; the others
are spoken on at the side's own site, small images by the camera beside the follower."""


def side_channels(side: str, settings: SessionSettings) -> tuple[str, ...]:
    """Channels that the link of a side receives, "leader" or "follower"."""
    if settings.budget:
        return THIN_CHANNELS[side]
    return LEADER_CHANNELS if side == "leader" else FOLLOWER_CHANNELS


def join_thin(link: ZenohLink, end: LeaderEnd | FollowerEnd | None) -> None:
    """Let an end take what a side says beside its step, and give what it hears beside that."""
    if end is None:
        return

    def deliver(message: Message) -> None:
        if not isinstance(message, CameraImage):
            link.deliver(message)
        elif end.tell is not None:
            end.tell(message)
        if isinstance(message, Hello) and end.tell is not None:
            link.repeat(message)

    link.aside, end.deliver = end.offer, deliver


def take_images(link: ZenohLink, end: LeaderEnd | FollowerEnd | None) -> None:
    """Take the small images of the camera beside a follower, for the leader's site."""
    if end is not None:
        for _, small in link.take("small"):
            end.show(small.content)


def hear_packets(link: ZenohLink, end: LeaderEnd | FollowerEnd) -> None:
    """Hear what an end's other side says before this side has begun."""
    end.heard([packet for _, packet in link.take(end.from_other)], time.monotonic_ns())
