"""What a driver of a real arm is: it says how the arm is, takes where its tip is to be, and knows nothing else."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

from foretouch.robot.robot import RobotSpecification, Vector


class ArmState(NamedTuple):
    """How an arm is.

    Attributes:
        measured_ns: When that was measured, by `time.monotonic_ns` of this machine [ns], or when it came in. The same
            number twice is the same measurement.
        place: Of the tip in the arm's base frame [m].
        force: On the probe, in the axes of the base frame [N], the tool weighed out: one that stands on a table is
            pushed up, along +z. NaN where the sensor says nothing.
        joints: Positions from the base on [rad]; empty where they are not known.
        refuses: Why the arm does not take commands now, for people, such as "protective stop"; "" where it does.
    """

    measured_ns: int
    place: Vector
    force: Vector
    joints: tuple[float, ...] = ()
    refuses: str = ""


class ArmLink(ABC):
    """The connection to a real arm. Its calls come from one thread, at most 1,000 times a second each.

    None of them may wait longer than 0.2 ms: what a client library waits for is waited for in a thread of its own.
    Any of them may raise where the connection is lost; the arm then counts as silent.

    Attributes:
        name: For people.
        specification: What there is to know about the arm; its sample period is 1, 2, 4 or 5 ms, in which it takes one
            command. Its workspace follows from `reach`.
        reach: Lowest and highest place of the tip in the base frame that are commanded [m].
    """

    name: str
    specification: RobotSpecification
    reach: tuple[Vector, Vector]

    @abstractmethod
    def state(self) -> ArmState | None:
        """The newest state; None before the first."""

    @abstractmethod
    def command(self, place: Vector) -> None:
        """Take where the tip should be now, in the base frame [m], with its orientation as it began.

        The commands are smooth, within `reach`, and stop where the session does: an arm that gets none for 20 ms is to
        hold its place by itself.
        """

    def close(self) -> None:
        """Leave the arm at rest and give back the connection; a second call does nothing."""
        return None
