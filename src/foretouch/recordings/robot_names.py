"""Columns that common robots' own interfaces name always alike: which number is what, in which frame."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from foretouch.recordings.column_names import FORCE, POSITION

__all__ = ["RobotColumn", "robot_column"]


class RobotColumn(NamedTuple):
    """What a robot's interface says of one of its numbers.

    Attributes:
        quantity: That it is.
        rank: How well it fits, on the scale of `foretouch.recordings.column_names.rank`: below a column that is named
            as the quantity and nothing else, above one that has a word of it.
        unit: As a map writes it.
        said: What it is, and in which frame, for people.
        axes: How the columns along x, y and z are numbered there.
    """

    quantity: str
    rank: float
    unit: str
    said: str
    axes: tuple[int, int, int]


KNOWN: Final = {
    "O_T_EE": RobotColumn(
        POSITION,
        3.8,
        "m",
        "Franka's end effector in the robot's base frame, of a 4 x 4 pose by columns",
        (12, 13, 14),
    ),
    "O_F_ext_hat_K": RobotColumn(
        FORCE, 3.8, "N", "Franka's estimated force on the stiffness frame, along the robot's base frame", (0, 1, 2)
    ),
    "K_F_ext_hat_K": RobotColumn(
        FORCE,
        3.7,
        "N",
        "Franka's estimated force on the stiffness frame, along that frame itself, which turns with the hand",
        (0, 1, 2),
    ),
    "actual_TCP_pose": RobotColumn(POSITION, 3.8, "m", "UR's tool centre point in the robot's base frame", (0, 1, 2)),
    "actual_TCP_force": RobotColumn(
        FORCE, 3.8, "N", "UR's force at the tool centre point, along the robot's base frame", (0, 1, 2)
    ),
}
"""The numbers of libfranka's `RobotState` and of UR's RTDE, by name without their index.

References:
    Franka Robotics, libfranka, franka/robot_state.h: struct RobotState.
    Universal Robots, Real-Time Data Exchange (RTDE) guide, robot controller outputs.
"""

_indexed = re.compile(rf"(?:^|[^A-Za-z])({'|'.join(KNOWN)})[\[_. ]?(\d+)\]?\s*\Z")


def robot_column(name: str) -> RobotColumn | None:
    """What a column is, such as ``O_T_EE[14]`` or ``actual_TCP_force_2``, if it is along z; None for any other.

    Args:
        name: Of the column; what stands before the robot's name, as ``state/``, is passed over.
    """
    found = _indexed.search(name)
    known = KNOWN[found[1]] if found else None
    return known if found and known is not None and int(found[2]) == known.axes[2] else None
