"""What the link of a side receives, with and without a thin link, and how a link and its end belong together."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from foretouch.link import ZenohLink, network_trace
from foretouch.messages import CameraImage, Hello, Message
from foretouch.session.runners.driven import SpaceFollower, SpaceLeader
from foretouch.session.settings import SessionSettings
from foretouch.session.thin import FollowerEnd, LeaderEnd

FOLLOWER_CHANNELS = ("command", "settings", "stop", "emergency", "hello", *SpaceFollower.channels)
"""Channels that the follower's link receives; the last is silent along a line."""

LEADER_CHANNELS = ("model", "telemetry", "handle", "settings", "stop", "hello", *SpaceLeader.channels)
"""Channels that the leader's link receives; the last two are silent along a line."""

THIN_CHANNELS = {
    "follower": ("forth", "back", "settings", "stop", "emergency"),
    "leader": ("back", "handle", "settings", "stop", "emergency"),
}
"""Channels that a side's link receives over a thin link: all else of the other side comes in its packets. What is to
go back to the leader the follower hears from the camera beside it, which is silent along a line."""


def side_channels(side: str, settings: SessionSettings) -> tuple[str, ...]:
    """Channels that the link of a side receives, "leader" or "follower"."""
    if settings.budget:
        return THIN_CHANNELS[side]
    return LEADER_CHANNELS if side == "leader" else FOLLOWER_CHANNELS


def join_thin(link: ZenohLink, end: LeaderEnd | FollowerEnd | None) -> None:
    """Let an end take what a side says beside its step, and give what it hears beside that.

    Who watches at the leader's site is told there what the leader hears of the robot's side.
    """
    if end is None:
        return

    def deliver(message: Message) -> None:
        if isinstance(message, CameraImage):
            link.publish(message)
            return
        link.deliver(message)
        if isinstance(message, Hello) and isinstance(end, WatchedEnd):
            link.repeat(message)

    link.aside, end.deliver = end.offer, deliver
    if isinstance(end, WatchedEnd):
        end.tell = link.publish


class WatchedEnd(LeaderEnd):
    """The end at a leader whose site has consoles and recorders.

    Attributes:
        tell: Tells them a message.
    """

    tell: Callable[[Message], None] | None = None

    def heard(self, packets: Iterable[Message], now_ns: int) -> list[Message]:
        """See `End.heard`."""
        due = super().heard(packets, now_ns)
        if self.tell is not None:
            for message in due:
                self.tell(message)
        return due


def leader_end(settings: SessionSettings) -> WatchedEnd | None:
    """The end of the leader in real time, as `end_of` makes one; None without a budget."""
    if not settings.budget:
        return None
    spacing = network_trace(settings.network).spacing if settings.network else 0.0
    return WatchedEnd(settings.budget, spacing, settings.protection)


def pass_stops_on(link: ZenohLink, end: LeaderEnd | FollowerEnd | None) -> None:
    """Pass the emergency stops of who watches at the leader's site on to the robot's."""
    if end is not None:
        for _, asked in link.take("emergency"):
            end.offer(asked)


def take_images(link: ZenohLink, end: LeaderEnd | FollowerEnd | None) -> None:
    """Take the images of the camera beside a follower, for the leader's site."""
    if end is not None:
        for _, packet in link.take("back"):
            end.show(packet.content)


def hear_packets(link: ZenohLink, end: LeaderEnd | FollowerEnd) -> None:
    """Hear what an end's other side says before this side has begun."""
    end.heard([packet for _, packet in link.take(end.from_other)], time.monotonic_ns())
