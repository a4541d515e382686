"""A bus with a servo of the XL330 series on a pseudo terminal: the maker's protocol 2.0, in the time that a bus takes.

Written from the maker's manuals, checksum included, without the library that is tested against it. The servo moves a
finger onto something soft, or holds a trigger that a hand moves.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import struct
import threading
import time
import tty

PING, READ, WRITE, STATUS, SYNC_WRITE = 1, 2, 3, 0x55, 0x83
HEAD = b"\xff\xff\xfd\x00"
NO_ACCESS, LIMIT_ERROR, ALERT = 7, 6, 128

MODE, CURRENT_LIMIT, MAX_POSITION, MIN_POSITION = 11, 38, 48, 52
TORQUE, ERRORS, WATCHDOG, GOAL_CURRENT, PROFILE_VELOCITY, GOAL_POSITION = 64, 70, 98, 102, 112, 116
CURRENT, VELOCITY, POSITION = 126, 128, 132
SIZES = {MODE: 1, CURRENT_LIMIT: 2, MAX_POSITION: 4, MIN_POSITION: 4, TORQUE: 1, ERRORS: 1, WATCHDOG: 1}
SIZES |= {GOAL_CURRENT: 2, PROFILE_VELOCITY: 4, GOAL_POSITION: 4, CURRENT: 2, VELOCITY: 4, POSITION: 4}

LEVER = 0.06  # [m]
COUNT = 2.0 * math.pi / 4096 * LEVER  # [m]
SPEED = 0.229 * 2.0 * math.pi / 60.0  # One count of a velocity [rad/s]
TORQUE_PER_AMPERE = {1060: 1.0, 1190: 0.215 / 1.47, 1200: 0.52 / 1.47}  # [N m/A]

MASS, VISCOUS, FRICTION = 0.55, 1.6, 0.3
"""What an XL330-M288 has at 60 mm by Rhoban's measurements (bam, ``params/xl330/m1.json``) [kg], [N s/m], [N]."""
GAIN, DAMPING = 2000.0, 60.0  # Of its position control [N/m], [N s/m]
HAND, HOLD = 300.0, 20.0  # Of the hand [N/m], [N s/m]
STEP = 2e-4  # Of the simulation [s]


def checksum(data: bytes) -> int:
    """CRC-16 with the polynomial 0x8005, from 0 on, not reflected."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class ServoBus:
    """Answers from `with` on.

    Args:
        model: 1190 or 1200.
        low: Position limits [counts]: closed,
        high: and open.
        lag: What the adapter takes for an answer [s], beside the bits on the bus.

    Attributes:
        port: Path of the terminal.
        start: Where it is at first: half open [m].
        thing: Opening from which on something soft pushes the finger [m],
        stiffness: and how stiff that is [N/m].
        hand: Opening to which a hand of 300 N/m draws the trigger [m]; None where nobody holds it.
        silent: Whether it answers nothing.
        deaf: Whether it takes no writing.
        errors: Bits of the hardware's errors.
        flawed: Whether its watchdog only says that it has seen the silence.
        written: Every register that was written, with its value.
    """

    def __init__(self, model: int = 1200, low: int = 1000, high: int = 2000, lag: float = 0.0003) -> None:
        self.model, self.lag, self.baud = model, lag, 1e6
        self.registers = bytearray(256)
        for register, value in ((CURRENT_LIMIT, 1750), (MIN_POSITION, low), (MAX_POSITION, high), (MODE, 3)):
            self.put(register, value)
        self.low, self.opening = low, 0.5 * (high - low) * COUNT
        self.start = self.aim = self.opening
        self.current = self.speed = 0.0
        self.thing, self.stiffness, self.hand = 0.02, 500.0, None
        self.silent = self.deaf = self.flawed = False
        self.errors = 0
        self.written: list[tuple[int, int]] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._moved, self._heard = time.perf_counter(), time.perf_counter()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> ServoBus:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def get(self, register: int) -> int:
        """Value of a register."""
        return int.from_bytes(self.registers[register : register + SIZES[register]], "little", signed=True)

    def put(self, register: int, value: int) -> None:
        """Set a register."""
        size = SIZES[register]
        self.registers[register : register + size] = (value & (1 << 8 * size) - 1).to_bytes(size, "little")

    def force(self) -> float:
        """What the motor pushes with [N], positive where it opens."""
        return self.current / 1000.0 * TORQUE_PER_AMPERE[self.model] / LEVER

    def met(self) -> float:
        """What the finger meets [N], positive where it opens."""
        return self.stiffness * max(self.thing - self.opening, 0.0) if self.hand is None else 0.0

    def _serve(self) -> None:
        waiting = b""
        while not self._ended.is_set():
            if select.select([self._master], [], [], 0.005)[0]:
                with contextlib.suppress(OSError):
                    waiting += os.read(self._master, 4096)
            self._move()
            while (begin := waiting.find(HEAD)) >= 0 and len(waiting) >= begin + 7:
                (length,) = struct.unpack_from("<H", waiting, begin + 5)
                packet, rest = waiting[begin : begin + 7 + length], waiting[begin + 7 + length :]
                if len(packet) < 7 + length:
                    break
                waiting = rest
                self._take(packet)

    def _take(self, packet: bytes) -> None:
        assert checksum(packet[:-2]) == struct.unpack("<H", packet[-2:])[0]
        began, self._heard = time.perf_counter(), time.perf_counter()
        kind, given = packet[7], packet[8:-2]
        if kind == PING:
            answer = self._status(0, struct.pack("<HB", self.model, 51))
        elif kind == READ:
            address, size = struct.unpack("<HH", given)
            answer = self._status(0, bytes(self.registers[address : address + size]))
        elif kind == WRITE:
            answer = self._status(self._write(struct.unpack_from("<H", given)[0], given[2:]), b"")
        else:  # to several, of which this one is the only: nothing answers
            address, size = struct.unpack_from("<HH", given)
            self._write(address, given[5 : 5 + size])
            return
        if self.silent:
            return
        until = began + 10.0 * (len(packet) + len(answer)) / self.baud + self.lag
        time.sleep(max(until - time.perf_counter() - 2e-4, 0.0))
        while time.perf_counter() < until:
            pass
        with contextlib.suppress(OSError):
            os.write(self._master, answer)

    def _status(self, error: int, data: bytes) -> bytes:
        alert = ALERT if self.errors else 0
        data = data.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet = HEAD + struct.pack("<BHBB", 1, len(data) + 4, STATUS, error | alert) + data
        return packet + struct.pack("<H", checksum(packet))

    def _write(self, address: int, data: bytes) -> int:
        value = int.from_bytes(data, "little", signed=True)
        if self.deaf:
            return LIMIT_ERROR
        if address < TORQUE and self.get(TORQUE):
            return NO_ACCESS
        if address in (GOAL_CURRENT, GOAL_POSITION) and self.get(WATCHDOG) == -1:
            return LIMIT_ERROR
        if address == GOAL_CURRENT and abs(value) > self.get(CURRENT_LIMIT):
            return LIMIT_ERROR
        if address == GOAL_POSITION and not self.get(MIN_POSITION) <= value <= self.get(MAX_POSITION):
            return LIMIT_ERROR
        self.written = [*self.written[-99:], (address, value)]
        self.put(address, value)
        return 0

    def _move(self) -> None:
        """Let the finger go on until now."""
        now = time.perf_counter()
        watchdog = self.get(WATCHDOG)
        if self.get(TORQUE) and watchdog > 0 and now - self._heard > 0.02 * watchdog:
            self.put(WATCHDOG, -1)
            if not self.flawed:
                self.put(GOAL_CURRENT, 0)
        self.put(ERRORS, self.errors)
        if self.errors:
            self.put(TORQUE, 0)
        while self._moved < now - STEP:
            self._moved += STEP
            self.current = self._drive()
            self._step(self.force() + self.met() + self._held())
        self.put(CURRENT, round(self.current))
        self.put(POSITION, self.low + round(self.opening / COUNT))

    def _held(self) -> float:
        """What the hand draws with [N]."""
        return 0.0 if self.hand is None else HAND * (self.hand - self.opening) - HOLD * self.speed

    def _step(self, force: float) -> None:
        """One step with a force [N] that opens, against dry and viscous friction."""
        speed = self.speed + STEP / MASS * (force - VISCOUS * self.speed)
        slowed = STEP / MASS * FRICTION
        self.speed = 0.0 if abs(speed) <= slowed else speed - math.copysign(slowed, speed)
        self.opening += STEP * self.speed

    def _drive(self) -> float:
        """The motor's current now [mA]."""
        if not self.get(TORQUE):
            self.aim = self.opening
            return 0.0
        goal = self.get(GOAL_CURRENT)
        if self.get(MODE) == 0:
            return float(goal)
        goal_opening = (self.get(GOAL_POSITION) - self.low) * COUNT
        step = STEP * LEVER * SPEED * (self.get(PROFILE_VELOCITY) or math.inf)
        self.aim += min(max(goal_opening - self.aim, -step), step)
        way = self.aim - self.opening
        wanted = 1000.0 * (GAIN * way - DAMPING * self.speed) * LEVER / TORQUE_PER_AMPERE[self.model]
        return max(min(wanted, goal), -goal)
