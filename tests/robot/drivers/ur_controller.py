"""A controller of Universal Robots, as far as ``ur-rtde`` asks for one: its ports, no arm.

RTDE (port 30004, protocol version 2, big-endian) with whatever recipes it is asked for, the port that takes the control
program (30003), and the dashboard (29999). What that program does with the registers is played here: of all its
commands, those that the driver gives. The tip goes to where it is sent; below `FLOOR` a spring pushes it up.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from functools import partial

FLOOR, STIFFNESS = 0.19, 1000.0  # [m], [N/m]
START = (0.4, 0.1, 0.2, 0.0, 3.1, 0.0)
PERIOD, FOLLOWS = 0.002, 50.0  # [s], [1/s]

SERVO_L, SERVO_STOP, SET_WATCHDOG, STOP = 24, 16, 35, 255
"""Commands of the control program, as the library numbers them."""
AT_ONCE = {24, 11, 9, 10, 6, 25, 26, 27, 38, 58, 66, 67, 68, 69, 70, 71}
"""Those that the program does not wait with."""

READY, DONE = 1, 2
NORMAL, PROTECTIVE, EMERGENCY = 1, 1 << 2, 1 << 7
KINDS = {"DOUBLE": "d", "INT32": "i", "UINT32": "I", "UINT64": "Q", "VECTOR6D": "6d", "VECTOR3D": "3d"}
KIND_OF = {"timestamp": "DOUBLE", "robot_mode": "INT32", "actual_digital_output_bits": "UINT64"}
ANSWERS = {
    "PolyscopeVersion": "URSoftware 5.13.0.1 (Jan 01 2023)",
    "get serial number": "20215501234",
    "is in remote control": "true",
}


def kind_of(name: str) -> str:
    """Type of a variable."""
    for part, kind in (("int_register", "INT32"), ("double_register", "DOUBLE"), ("actual_", "VECTOR6D")):
        if part in name and name not in KIND_OF:
            return kind
    return KIND_OF.get(name, "VECTOR6D" if name == "external_force_torque" else "UINT32")


class Controller:
    """At an address of its own of this machine, from `with` on.

    Attributes:
        host: Its address.
        pose: Of the tip: place [m] and rotation vector [rad].
        bits: Safety status.
        mode: Robot mode.
        runs: Whether the control program runs.
        deaf: Whether it takes no commands.
        silent: Whether it sends no data.
        late: How much later it sends data [s].
        force: Shown instead of the spring's [N].
        commands: Numbers of all that it was commanded, but for 0.
        programs: Number of control programs that it was sent.
    """

    def __init__(self) -> None:
        self.host = f"127.1.{os.getpid() >> 8 & 255}.{os.getpid() % 254 + 1}"  # that of no other process
        self.pose, self.target = list(START), list(START)
        self.bits, self.mode, self.runs, self.deaf, self.silent, self.late = NORMAL, 7, False, False, False, 0.0
        self.remote, self.force = True, None
        self.commands: list[int] = []
        self.programs, self.watchdog, self.register, self.written = 0, 0.0, READY, time.monotonic()
        self._open: list[socket.socket] = []
        self._begun, self._ended = time.monotonic(), False

    def __enter__(self) -> Controller:
        for port, serve in ((30004, self._rtde), (30003, self._program), (29999, self._dashboard)):
            self._listen(port, serve)
        threading.Thread(target=self._live, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended = True
        self.drop()

    def drop(self) -> None:
        """Drop every connection, as where a cable is pulled, and take no new ones."""
        for one in self._open:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def stop(self, bits: int = PROTECTIVE) -> None:
        """Stop for safety: the program ends and the arm stands."""
        self.bits, self.runs, self.target = bits, False, list(self.pose)

    def unlock(self) -> None:
        """What a person does at the pendant after a stop."""
        self.bits = NORMAL

    def shown(self) -> list[float]:
        """The wrench that the sensor shows."""
        spring = STIFFNESS * max(FLOOR - self.pose[2], 0.0)
        return [0.0, 0.0, spring if self.force is None else self.force, 0.0, 0.0, 0.0]

    def _live(self) -> None:
        while not self._ended:
            time.sleep(PERIOD)
            late = self.watchdog and time.monotonic() - self.written > 1.0 / self.watchdog
            if self.runs and late:
                self.runs, self.target = False, list(self.pose)
            for axis, target in enumerate(self.target):
                self.pose[axis] += FOLLOWS * PERIOD * (target - self.pose[axis])

    def _listen(self, port: int, serve: Callable[[socket.socket], None]) -> None:
        listening = socket.create_server((self.host, port))
        self._open.append(listening)

        def loop() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connected, _ = listening.accept()
                    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._open.append(connected)
                    threading.Thread(target=guarded, args=(connected,), daemon=True).start()

        def guarded(connected: socket.socket) -> None:
            with contextlib.suppress(OSError, EOFError), connected:
                serve(connected)

        threading.Thread(target=loop, daemon=True).start()

    def _program(self, connected: socket.socket) -> None:
        taken = b""
        while part := connected.recv(1 << 16):
            taken += part
            if taken.rstrip().endswith(b"\nend") and self.bits == NORMAL and self.remote:
                assert b"rtde_control" in taken
                self.programs, self.runs, self.register, self.watchdog, taken = self.programs + 1, True, READY, 0.0, b""

    def _dashboard(self, connected: socket.socket) -> None:
        connected.sendall(b"Connected: Universal Robots Dashboard Server\n")
        for line in connected.makefile():
            answer = ANSWERS.get(line.strip(), "ok")
            if line.strip() == "stop":
                self.runs, answer = False, "Stopped"
            connected.sendall(b"false\n" if answer == "true" and not self.remote else f"{answer}\n".encode())

    def _rtde(self, connected: socket.socket) -> None:
        recipes: list[list[str]] = []
        sends = threading.Lock()

        def send(kind: bytes, payload: bytes) -> None:
            with sends:
                connected.sendall(struct.pack(">Hc", 3 + len(payload), kind) + payload)

        shown: list[str] = []
        while True:
            size, kind = struct.unpack(">Hc", whole(connected, 3))
            payload = whole(connected, size - 3)
            if kind in b"VSP":  # version, start, pause
                send(kind, b"\1")
                if kind == b"S":
                    threading.Thread(target=self._stream, args=(shown, partial(send, b"U")), daemon=True).start()
            elif kind == b"v":
                send(kind, struct.pack(">4I", 5, 13, 0, 1))
            elif kind == b"O":
                shown = payload[8:].decode().strip(",").split(",")
                send(kind, b"\1" + ",".join(map(kind_of, shown)).encode())
            elif kind == b"I":
                recipes.append(payload.decode().strip(",").split(","))
                send(kind, bytes([len(recipes)]) + ",".join(map(kind_of, recipes[-1])).encode())
            elif kind == b"U":
                names = recipes[payload[0] - 1]
                layout = ">" + "".join(KINDS[kind_of(name)] for name in names)
                self._take(list(struct.unpack(layout, payload[1:])))

    def _take(self, values: list[float]) -> None:
        """What the control program does with its input registers: the first is the command."""
        command, self.written = int(values[0]), time.monotonic()
        if self.deaf or not self.runs:
            self.register = 0
            return
        self.register = READY if command == 0 or command in AT_ONCE else DONE
        if command:
            self.commands.append(command)
        if command == SERVO_L:
            self.target = values[1:7]
        elif command == SERVO_STOP:
            self.target = list(self.pose)
        elif command == SET_WATCHDOG:
            self.watchdog = values[1]
        elif command == STOP:
            self.runs = False

    def _stream(self, names: list[str], send: Callable[[bytes], None]) -> None:
        layout = ">B" + "".join(KINDS[kind_of(name)] for name in names)
        with contextlib.suppress(OSError):
            while not self._ended:
                time.sleep(PERIOD + self.late)
                if not self.silent:
                    values = itertools.chain.from_iterable(self._value(name) for name in names)
                    send(struct.pack(layout, 1, *values))

    def _value(self, name: str) -> list[float]:
        values: dict[str, list[float]] = {
            "timestamp": [time.monotonic() - self._begun],
            "actual_TCP_pose": self.pose,
            "actual_TCP_force": self.shown(),
            "actual_q": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            "robot_mode": [self.mode],
            "safety_status_bits": [self.bits],
            "robot_status_bits": [3 if self.runs else 1],
            "runtime_state": [2 if self.runs else 1],
            "output_int_register_0": [self.register],
        }
        many = int(KINDS[kind_of(name)][:-1] or 1)
        return values.get(name, [0] * many)


def whole(connected: socket.socket, size: int) -> bytes:
    """So many bytes."""
    data = b""
    while len(data) < size:
        part = connected.recv(size - len(data))
        if not part:
            raise EOFError
        data += part
    return data
