"""A robot at the other end of UDP, whatever it is written in, and the datagrams byte by byte.

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
import secrets
import socket
import struct
import time
from typing import Any, NamedTuple

from foretouch.errors import InputError, SettingError
from foretouch.plugins import named_at
from foretouch.robot.drivers.arm_link import ArmLink, ArmState
from foretouch.robot.drivers.driven_arm import FIRST, arm_robot
from foretouch.robot.robot import AnyRobot, RobotSpecification, Vector

PORT = 47100  # Where a robot listens if nothing else is said
ASKED_EVERY = 0.1  # Time between two questions who is there [s]
MOST_AT_ONCE = 64  # Datagrams that are taken in one call: those of a stall of 64 ms; older ones wait for the next

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


class UdpArm(ArmLink):
    """The session's end. It binds no port that is known: answers come to where the question came from.

    Args:
        host: Name or address of the robot.
        port: Of the robot.

    Raises:
        InputError: There is no such host, or no robot answers within 3 s.
    """

    def __init__(self, host: str, port: int = PORT) -> None:
        self.name = f"robot at {host}:{port}"
        self._session, self._sequences = secrets.randbits(32), {HELLO: 0, GO: 0}
        self._newest, self._rotation = 0, (0.0, 0.0, 0.0)
        self._state: ArmState | None = None
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            self._socket: socket.socket | None = socket.socket(family, kind, protocol)
            self._socket.connect(address)  # from now on only what comes from there is taken
        except OSError as error:
            raise InputError(f"{self.name}: {error.strerror or error}: give it as udp@HOST:PORT") from None
        self._socket.setblocking(False)
        self.specification, self.reach = self._asked()

    def state(self) -> ArmState | None:
        """The newest state."""
        for head, values in self._taken():
            if head.kind == AT and head.sequence > self._newest:
                at, first = read_at(values), self._newest == 0
                self._newest = head.sequence
                if first:
                    self._rotation = at.rotation
                self._state = ArmState(time.monotonic_ns(), at.place, at.force, at.joints, at.refuses)
        return self._state

    def command(self, place: Vector) -> None:
        """Send where the tip should be, with its orientation as it began."""
        self._send(GO, *place, *self._rotation)

    def close(self) -> None:
        """Send nothing any more: the robot's own watchdog holds and unloads it."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _asked(self) -> tuple[RobotSpecification, tuple[Vector, Vector]]:
        end = time.monotonic() + FIRST
        while time.monotonic() < end:
            self._send(HELLO)
            time.sleep(ASKED_EVERY)
            for head, values in self._taken():
                if head.kind == WHO:
                    return specified(values)
        self.close()
        raise InputError(f"{self.name}: no answer within {FIRST:g} s: start it, and see that no firewall is between")

    def _send(self, kind: bytes, *values: float) -> None:
        if self._socket is not None:
            self._sequences[kind] += 1
            head = Head(kind, self._session, self._sequences[kind], time.monotonic_ns())
            self._socket.send(pack(head, *values))

    def _taken(self) -> list[tuple[Head, tuple[float, ...]]]:
        """Datagrams of this session that are there."""
        taken: list[tuple[Head, tuple[float, ...]]] = []
        for _ in range(MOST_AT_ONCE):
            try:
                datagram = self._socket.recv(2048) if self._socket is not None else b""
            except BlockingIOError:
                break
            except ConnectionRefusedError:  # nobody listens there, or not yet
                continue
            found = unpack(datagram)
            if found is not None and found[0].session == self._session:
                taken.append(found)
        return taken


def specified(values: tuple[float, ...]) -> tuple[RobotSpecification, tuple[Vector, Vector]]:
    """What there is to know about a robot, and its reach, of the values of ``FTIS``."""
    period, limit, resolution, noise, bandwidth, most, mass = values[:7]
    low, high = values[7:10], values[10:13]
    specification = RobotSpecification(
        sample_period=period,
        force_limit=limit,
        encoder_resolution=resolution,
        encoder_noise=0.0,
        tool_mass=0.0,
        gravity=0.0,
        sensor_noise=noise,
        accelerometer_noise=0.0,
        sensor_bandwidth=bandwidth,
        workspace=(low[2], high[2]),
        sensor_range=most,
        moved_mass=mass,
    )
    return specification, (low, high)  # type: ignore[return-value]


def make_udp(settings: Any) -> AnyRobot[Any, Any]:
    """The robot ``udp@HOST:PORT`` of the settings.

    Raises:
        SettingError: Without a host, or with a port that is none.
    """
    _, address = named_at(settings.robot)
    host, _, port = address.rpartition(":") if ":" in address else (address, "", str(PORT))
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise SettingError(
            "robot", settings.robot, f"must be udp@HOST:PORT, with a port of 1 to 65535 (without one {PORT})"
        )
    return arm_robot(UdpArm(host.strip("[]"), int(port)), in_space=bool(settings.scene))
