"""What a driver on a ROS 2 graph needs: where the graph is, names of its topics, and the newest message of each."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, Self

from foretouch.errors import InputError
from foretouch.link import is_exposed
from foretouch.plugins import Address
from foretouch.recordings.formats.topics import StandardTopic, unpack_stamped
from foretouch.ros2.graph import Graph
from foretouch.ros2.keys import Node

ROUTER: Final = "tcp/127.0.0.1:7447"  # Where rmw_zenohd listens if nothing else is said
FIRST = 3.0  # Longest time until the first message of each topic [s]
SILENT = 0.02  # A topic that has said nothing for so long is silent [s]
PATIENCE = 1e-4  # Longest time that a message of a control loop waits for room [s]; then it is dropped

COMMON: Final = {"namespace": "/", "domain": "", "insecure": "no"}
"""Options of every address: where topics without a leading / are, ``ROS_DOMAIN_ID`` if not that of the environment, and
whether a router off this machine is allowed, where anybody may command."""

_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class GraphAddress(Address):
    """A setting such as ``ros2@tcp/127.0.0.1:7447,wrench=/ft/wrench``: a router, and what differs from the usual.

    Its place is the endpoint of the graph's router, and its options are those of `COMMON`, too.
    """

    @classmethod
    def read(cls, setting: str, text: str, usual: Mapping[str, str], place: str = "ROUTER") -> Self:
        """The address in a setting: see `foretouch.plugins.Address`."""
        return super().read(setting, text, {**usual, **COMMON}, place)

    @property
    def router(self) -> str:
        """Endpoint of the graph's router."""
        return self.place or ROUTER

    def topic(self, key: str, like: StandardTopic) -> StandardTopic:
        """The topic that an option names, of the type of another.

        Raises:
            SettingError: It is no name of a topic.
        """
        name = self.options[key]
        if not _TOPIC.fullmatch(name):
            raise self.refuse(f"{key} must be the name of a topic, such as {like.name}, and is {name!r}")
        return replace(like, name=name if name.startswith("/") else f"{self.options['namespace'].rstrip('/')}/{name}")

    def open(self, node: str) -> Graph:
        """A node of this name on the graph.

        Raises:
            SettingError: A domain or namespace that is none, or a router that is off this machine.
            LinkError: The router's endpoint is malformed.
            InputError: There is no router.
        """
        domain = self.options["domain"] or os.environ.get("ROS_DOMAIN_ID", "") or "0"
        if not domain.isdecimal():
            raise self.refuse(f"the domain (ROS_DOMAIN_ID) must be a number, and is {domain!r}")
        if self.options["insecure"] not in ("yes", "no"):
            raise self.refuse(f"insecure must be yes or no, and is {self.options['insecure']!r}")
        if is_exposed(self.router) and self.options["insecure"] == "no":
            why = f"{self.router} is off this machine, and who reaches it may command as well"
            raise self.refuse(f"{why}: add insecure=yes on a network that you trust")
        there = Node(int(domain), self.options["namespace"], node)
        graph = Graph(self.router, replace(there, namespace="/"), insecure=True, patience=PATIENCE)
        if not graph.connect():
            graph.close()
            raise InputError(
                f"{self.setting} {self.text!r}: no ROS 2 router at {self.router}: start one, such as "
                "`ros2 run rmw_zenoh_cpp rmw_zenohd`"
            )
        return graph


class Heard(NamedTuple):
    """A message of a topic, with when it came in.

    Attributes:
        arrival_ns: By `time.monotonic_ns`.
        time_ns: Its own stamp [ns since 1970], 0 where it has none.
        frame: Its ``frame_id``.
        values: As of `foretouch.recordings.formats.topics.Stamped`.
    """

    arrival_ns: int
    time_ns: int
    frame: str
    values: tuple[Any, ...]


class Newest:
    """The newest message of a topic. Zenoh's thread puts it down, and the loop looks at it without waiting.

    A message with the stamp of the one before is the same measurement, said again, and is left out.

    Args:
        topic: Its type is WrenchStamped, PoseStamped or JointState.
        frames: Values of ``frame_id`` that are accepted; without one, that of the first message.

    Attributes:
        topic: As given.
        heard: The newest message; None before the first.
        count: How many messages were put down.
        problem: Why the newest one was refused, for people; "" where it was not.
    """

    def __init__(self, topic: StandardTopic, frames: Sequence[str] = ()) -> None:
        self.topic, self._frames = topic, tuple(frames)
        self.heard: Heard | None = None
        self.count = 0
        self.problem = ""

    def take(self, data: bytes) -> None:
        """Put down the message in these CDR bytes."""
        arrival_ns, before = time.monotonic_ns(), self.heard
        try:
            time_ns, frame, values = unpack_stamped(self.topic.type_name, data)
        except ValueError as error:
            self.problem = f"what {self.topic.name} says is no {self.topic.type_name}: {error}"
            return
        self._frames = self._frames or (frame,)
        if frame not in self._frames:
            accepted = " or ".join(map(repr, self._frames))
            self.problem = f"{self.topic.name} is in the frame {frame!r}, and not in {accepted}"
        elif before is None or time_ns == 0 or time_ns != before.time_ns:
            self.heard, self.problem = Heard(arrival_ns, time_ns, frame, values), ""
            self.count += 1


def await_first(topics: Sequence[Newest]) -> str:
    """Wait for the first message of each topic, for at most 3 s; what is missing, for people, "" for nothing."""
    end = time.monotonic() + FIRST
    while any(topic.heard is None for topic in topics) and time.monotonic() < end:
        time.sleep(1e-3)
    missing = [topic for topic in topics if topic.heard is None]
    silent = " and ".join(f"{one.topic.name} ({one.topic.type_name})" for one in missing if not one.problem)
    nothing = [f"nothing on {silent} within {FIRST:g} s"] if silent else []
    return "; ".join([*(one.problem for one in missing if one.problem), *nothing])
