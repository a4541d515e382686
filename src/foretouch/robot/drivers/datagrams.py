"""The datagrams by which a robot of any language is driven over UDP, byte by byte.

Little-endian, without gaps; ``foretouch_robot.hpp`` beside this file is the other end in C++17. Each begins with

====== ======= ============================================================
offset type    what
====== ======= ============================================================
0      4 bytes kind: ``FTHI``, ``FTIS``, ``FTGO`` or ``FTAT``
4      u32     session: drawn by the session; every answer repeats it
8      u32     sequence of this kind from this sender, from 1 on
12     u64     time of sending, by the sender's own monotonic clock [ns]
====== ======= ============================================================

and goes on from offset 20 with 8-byte floats:

- ``FTHI`` (20 bytes): the session asks who is there, ten times a second until it is answered.
- ``FTIS`` (124 bytes), the answer: sample period [s], force limit [N], step of the encoders at the tip [m], noise of
  the force sensor [N], its bandwidth [Hz], its range [N], moved mass [kg]; lowest place (x, y, z) and highest [m].
- ``FTGO`` (68 bytes), each sample period while the robot is commanded: desired place (x, y, z) [m] and rotation vector
  [rad] of the tip.
- ``FTAT`` (152 bytes), each sample period from the first ``FTHI`` on: place (x, y, z) [m] and rotation vector [rad] of
  the tip; force (x, y, z) [N] on the probe and torque [N m] about the tip; eight 4-byte joint positions [rad], NaN
  beyond the last; and a u32: 0 where the robot follows, else why not, one of `REFUSALS`.

Places, rotations and forces are in the robot's base frame, z up. A datagram of another length, kind or session is
dropped, and one whose sequence is not newer than the newest, too. A robot that gets no ``FTGO`` for 20 ms holds its
place; for 100 ms, it leaves what it touches, by itself.
"""

from __future__ import annotations

import math
import struct
from typing import NamedTuple

from foretouch.robot.robot import Vector

HELLO, WHO, GO, AT = b"FTHI", b"FTIS", b"FTGO", b"FTAT"
HEAD = struct.Struct("<4sIIQ")
_BODIES = {
    HELLO: struct.Struct("<"),
    WHO: struct.Struct("<13d"),
    GO: struct.Struct("<6d"),
    AT: struct.Struct("<12d8fI"),
}
LENGTHS = {kind: HEAD.size + body.size for kind, body in _BODIES.items()}

REFUSALS = {1: "protective stop", 2: "emergency stop", 3: "reflex", 4: "not ready", 5: "its own watchdog unloads it"}
"""Why a robot does not follow."""


class Head(NamedTuple):
    """What every datagram begins with."""

    kind: bytes
    session: int
    sequence: int
    sent_ns: int


def pack(head: Head, *values: float) -> bytes:
    """A datagram of a head and the values of its kind."""
    return HEAD.pack(*head) + _BODIES[head.kind].pack(*values)


def unpack(datagram: bytes) -> tuple[Head, tuple[float, ...]] | None:
    """Head and values of a datagram; None for what is none."""
    if len(datagram) < HEAD.size:
        return None
    head = Head(*HEAD.unpack_from(datagram))
    if LENGTHS.get(head.kind) != len(datagram):
        return None
    return head, _BODIES[head.kind].unpack_from(datagram, HEAD.size)


class At(NamedTuple):
    """What ``FTAT`` says."""

    place: Vector
    rotation: Vector
    force: Vector
    torque: Vector
    joints: tuple[float, ...]
    refuses: str


def read_at(values: tuple[float, ...]) -> At:
    """The fields of ``FTAT``, of its values."""
    place, rotation, force, torque = (values[start : start + 3] for start in range(0, 12, 3))
    joints = tuple(value for value in values[12:20] if math.isfinite(value))
    number = int(values[20])
    refuses = "" if number == 0 else REFUSALS.get(number, f"refusal {number}")
    return At(place, rotation, force, torque, joints, refuses)  # type: ignore[arg-type]
