"""What a console says: every message that a person causes, each kind in order, from whichever thread causes it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from foretouch.console.network_panel import NetworkFaults
from foretouch.messages import VERSION, Choice, EmergencyStop, Handle, Message, Settings, Stop

__all__ = ["Speech"]


class Speech:
    """Numbers the messages and publishes them.

    Args:
        publish: Called with every message. It should return at once.
    """

    def __init__(self, publish: Callable[[Message], None]) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._sequences: dict[type[Message], int] = {}

    def handle(self, position: float, *, held: bool, clutched: bool, place: tuple[float, ...] = ()) -> None:
        """Where the handle asks the hand to be [m], and whether somebody holds it or presses the clutch."""
        with self._lock:
            self._publish(Handle(*self._stamp(Handle), position=position, held=held, clutched=clutched, place=place))

    def settings(self, faults: NetworkFaults) -> None:
        """Which delays and faults there are to be."""
        with self._lock:
            self._publish(Settings(*self._stamp(Settings), *faults))

    def choice(self, *, material: str = "", operator: str = "", grip: str = "", record: str = "") -> None:
        """What is to be pressed, by whom, and recorded; see `Choice`."""
        with self._lock:
            self._publish(Choice(*self._stamp(Choice), material, operator, grip, record))

    def stop(self) -> None:
        """The session is to end."""
        with self._lock:
            self._publish(Stop(*self._stamp(Stop), reason="ended in the console"))

    def emergency(self, press: int) -> None:
        """The robot is to stop at once; the number of the press."""
        with self._lock:
            reason = "pressed in the console"
            self._publish(EmergencyStop(*self._stamp(EmergencyStop), reason=reason, press=press))

    def _stamp(self, kind: type[Message]) -> tuple[int, int, int]:
        """What every message begins with."""
        self._sequences[kind] = self._sequences.get(kind, 0) + 1
        return VERSION, self._sequences[kind], time.monotonic_ns()
