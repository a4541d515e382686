"""A device that keeps every rule, and ones that each break one."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import ClassVar

from foretouch.devices import Device, DeviceSpecification

_COUNT = itertools.count()


class Held(Device):
    """A simulated hand that the force moves: it swings, and yields by a millimetre a newton."""

    name: ClassVar[str] = "held"
    closed_loop: ClassVar[bool] = True

    def __init__(self) -> None:
        self._newest = 0
        self.force = 0.0
        self.closed = False

    @property
    def specification(self) -> DeviceSpecification | None:
        return DeviceSpecification(damping=2.0, delay=5e-4, force_limit=8.0)

    def read(self, now_ns: int) -> float:
        self._newest = max(self._newest, now_ns)
        return 0.02 * math.sin(math.pi * 0.5 * self._newest * 1e-9) ** 2 - 1e-4 * self.force

    def render(self, force: float) -> float:
        self.force = 0.0 if self.closed or math.isnan(force) else min(max(force, 0.0), 8.0)
        return self.force

    def close(self) -> None:
        self.closed = True


class WrongName(Held):
    name: ClassVar[str] = ""


class NoSpecification(Held):
    @property
    def specification(self) -> None:
        return None


class Millimetres(Held):
    def read(self, now_ns: int) -> float:
        return 1000.0 * super().read(now_ns)


class Unready(Held):
    def read(self, now_ns: int) -> float:
        return math.nan


class Raising(Held):
    def read(self, now_ns: int) -> float:
        raise OSError("unplugged")


class Seldom(Held):
    def read(self, now_ns: int) -> float:
        return super().read(now_ns // 100_000_000 * 100_000_000)


class Outwards(Held):
    def read(self, now_ns: int) -> float:
        return -super().read(now_ns)


class Backwards(Held):
    def read(self, now_ns: int) -> float:
        self._newest = now_ns
        return super().read(now_ns)


class SlowRead(Held):
    def read(self, now_ns: int) -> float:
        if self._newest > 3600e9:  # the longer checks are not to take long
            time.sleep(3e-4)
        return super().read(now_ns)


class SlowRender(Held):
    def render(self, force: float) -> float:
        if self._newest > 3600e9:
            time.sleep(3e-4)
        return super().render(force)


class NoLimit(Held):
    def render(self, force: float) -> float:
        return super().render(force) and force


class Pulling(Held):
    def render(self, force: float) -> float:
        given = super().render(force)
        return -1.0 if force < 0.0 else given


class NoNumber(Held):
    def render(self, force: float) -> float:
        return math.nan if math.isnan(force) else super().render(force)


class Chance(Held):
    def __init__(self) -> None:
        super().__init__()
        self._offset = 1e-6 * next(_COUNT)

    def read(self, now_ns: int) -> float:
        return super().read(now_ns) + self._offset


class Sucking(Held):
    def read(self, now_ns: int) -> float:
        return super().read(now_ns) + 2e-4 * self.force


class NotClosed(Held):
    def close(self) -> None:
        pass


class Still(Held):
    """Nobody moves it: what cannot be seen is not called broken."""

    def read(self, now_ns: int) -> float:
        return -1e-6 * self.force


WRONG: dict[str, tuple[Callable[[], Device], str]] = {
    "name": (WrongName, ""),
    "specification": (NoSpecification, "specification = none"),
    "units": (Millimetres, "20 m from 0"),
    "units / no number": (Unready, "positions are no numbers"),
    "units / raising": (Raising, "raises OSError: unplugged"),
    "rate": (Seldom, "m/s"),
    "sign of position": (Outwards, "0 mm in, 20 mm out"),
    "times that go back": (Backwards, "moved by 20 mm"),
    "read time": (SlowRead, "ms"),
    "render time": (SlowRender, "ms"),
    "force limit": (NoLimit, "inf N of"),
    "no force asked, none given": (Pulling, "[0.0, -1.0, -1.0]"),
    "no number, no force": (NoNumber, "nan N of NaN"),
    "same times, same motion": (Chance, "mm apart"),
    "sign of force": (Sucking, "moves the hand by 0.1 mm"),
    "closed, no force": (NotClosed, "1 N of 1 N after close"),
}
"""By the check that each is caught by; and what that says."""
