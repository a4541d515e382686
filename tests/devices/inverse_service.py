"""A stand-in of Haply's Inverse Service: its protocol over a real WebSocket, and a handle that a simulated hand holds.

The messages are those of the maker's pages, version 3.5; `old` gives those of 3.1.
"""

from __future__ import annotations

import json
import math
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

MASS, DAMPING, GRIP, GRIP_DAMPING = 0.15, 2.0, 300.0, 8.0
"""Of the handle [kg, N s/m], and of the hand that holds it [N/m, N s/m]."""
FOOT = (0.0, -0.12, 0.15)
"""Where the hand holds the handle at first, in the device's frame [m]."""
STEP = 2e-4  # Of the simulation [s]


class Service:
    """The service with one device.

    Args:
        intention: Where the hand wants the handle after a time [s], beside where it began [m].
        old: Whether it speaks as version 3.1 did.

    Attributes:
        address: ``HOST:PORT`` where it listens.
        place: Of the handle [m].
        force: Newest force that it was given [N].
        forces: Every force that it was given [N].
        heard: Every message as it came.
        status: What it says of the device.
        listed: Whether it lists the device.
        lateness: Time by which each answer is late [s].
        says: What it says instead of a state, where that is not empty.
        scale: Of the device's mount.
        buttons: Of a VerseGrip; none where empty.
    """

    def __init__(
        self, intention: Callable[[float], tuple[float, float, float]] = lambda time: (0.0, 0.0, 0.0), old: bool = False
    ) -> None:
        self._intention, self._old = intention, old
        self.place, self._velocity, self.force = list(FOOT), [0.0] * 3, [0.0] * 3
        self.forces: list[tuple[float, float, float]] = []
        self.heard: list[dict[str, Any]] = []
        self.status = {"calibrated": True, "in_use": False, "power_supply": True, "ready": True, "started": True}
        self.listed, self.lateness, self.says, self.scale = True, 0.0, "", 1.0
        self.buttons: dict[str, bool] = {}
        self._begun, self._simulated = math.inf, 0.0  # it begins when somebody comes
        self._clients: list[socket.socket] = []
        self._server = serve(self._client, "127.0.0.1", 0, compression=None, close_timeout=0.2)
        self.address = "{}:{}".format(*self._server.socket.getsockname()[:2])
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def die(self) -> None:
        """End as a process that is killed does: the connections break, and nobody listens any more."""
        self._server.shutdown()
        for client in self._clients:
            client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join(2.0)

    def _client(self, connection: Any) -> None:
        self._clients.append(connection.socket)
        if self._begun == math.inf:
            self._begun = self._simulated = time.monotonic()
        try:
            connection.send(self._message(inventory=True))
            for message in connection:
                self._obey(json.loads(message))
                self._pass_time()
                if self.lateness:
                    time.sleep(self.lateness)
                connection.send(self.says or self._message())
        except ConnectionClosed:
            pass
        self.force = [0.0] * 3  # a device that nobody commands is idle

    def _obey(self, message: dict[str, Any]) -> None:
        self.heard.append(message)
        self.force = [0.0] * 3  # a command acts once
        for device in message.get("inverse3", []):
            assert device["device_id"] == "049D"
            force = device["commands"]["set_cursor_force"]["values" if self._old else "vector"]
            self.force = [float(force[axis]) for axis in "xyz"]
            self.forces.append(tuple(self.force))

    def _pass_time(self) -> None:
        """A mass with the device's damping, and a hand that pulls it to where it wants it."""
        now = time.monotonic()
        while self._simulated < now:
            wanted = self._intention(self._simulated - self._begun)
            for axis in range(3):
                apart = FOOT[axis] + wanted[axis] - self.place[axis]
                push = self.force[axis] + GRIP * apart - (DAMPING + GRIP_DAMPING) * self._velocity[axis]
                self._velocity[axis] += push / MASS * STEP
                self.place[axis] += self._velocity[axis] * STEP
            self._simulated += STEP

    def _message(self, *, inventory: bool = False) -> str:
        def vector(numbers: list[float]) -> dict[str, float]:
            return dict(zip("xyz", numbers, strict=True))

        none, zero = vector([0.0] * 3), {"a0": 0.0, "a1": 0.0, "a2": 0.0}
        state: dict[str, Any] = {
            "cursor_position": vector(self.place),
            "cursor_velocity": vector(self._velocity),
            "angular_position": zero,
            "angular_velocity": zero,
            "body_orientation": {"w": 1.0} | none,
        }
        if self._old:
            state["mode"] = "force"
        else:
            state |= {"current_cursor_force": vector(self.force), "control_domain": "cartesian", "transform": {}}
        device: dict[str, Any] = {"device_id": "049D", "state": state, "status": self.status}
        if inventory:
            turn, scale = {"w": 1.0} | none, vector([self.scale] * 3)
            device["config"] = {
                "type": "inverse3",
                "port": "COM12",
                "device_info": {"major_version": 7, "minor_version": 4, "id": "049D", "device_type": 4, "uuid": "0"},
                "gravity_compensation": {"enabled": True, "scaling_factor": 1.0},
                "handedness": "right",
                "torque_scaling": {"enabled": True},
            }
            if not self._old:
                device["config"] |= {
                    "preset": "defaults",
                    "basis": {"permutation": "XYZ"},
                    "mount": {"position": none, "rotation": turn, "scale": scale},
                    "filters": {"force_gate": {"gain": 0.3}, "damping": {"scalar": 0.0}},
                }
        answer: dict[str, Any] = {} if self._old else {"session_id": 7}
        answer["inverse3"] = [device] if self.listed else []
        answer["wireless_verse_grip"] = (
            [{"device_id": "61548", "state": {"buttons": self.buttons}}] if self.buttons else []
        )
        return json.dumps(answer)


def presses(depth: float, period: float, rest: float = 0.0) -> Callable[[float], tuple[float, float, float]]:
    """A hand that goes down to a depth [m] and up again, once a period [s], after a rest [s]."""

    def intention(time: float) -> tuple[float, float, float]:
        passed = max(time - rest, 0.0)
        return 0.0, 0.0, -depth * math.sin(math.pi * passed / period) ** 2

    return intention
