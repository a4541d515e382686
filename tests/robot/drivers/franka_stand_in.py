"""What the driver uses of ``franky``, without an arm: the names and parameters of the library, and next to no physics.

A test compares them with the library's own stub where that is installed.
"""

from __future__ import annotations

import math
import time
from types import SimpleNamespace
from typing import Any

DOWN, STIFFNESS, FOLLOWS = 0.01, 1000.0, 50.0  # [m], [N/m], [1/s]
BEGIN = (0.5, 0.0, 0.5)


class RealtimeConfig:
    Enforce = 0
    Ignore = 1


class ControlException(Exception):
    pass


class Affine:
    def __init__(self, translation: Any, quaternion: Any) -> None:
        self.translation, self.quaternion = tuple(translation), tuple(quaternion)


class CartesianReference:
    def __init__(self, target: Affine) -> None:
        self.target = target


class CartesianImpedanceTrackingMotion:
    def __init__(
        self, translational_stiffness: float, rotational_stiffness: float, translational_error_clip: Any
    ) -> None:
        self.used, self.reference = False, None

    def set_reference(self, reference: CartesianReference) -> None:
        assert all(map(math.isfinite, reference.target.translation))
        self.reference = reference


class TorqueStopMotion:
    pass


class Errors:
    cartesian_reflex = False
    joint_reflex = False


class Arm:
    """What a test does to it, as `franka_simulated.Simulated` has it."""

    def __init__(self) -> None:
        self.host, self.floor, self.begun = "stand-in", BEGIN[2] - DOWN, time.monotonic()
        self.force: float | None = None
        self.place: float | None = None
        self.late, self.lost, self.failed, self.stands = 0.0, False, False, 0
        self.errors, self.motion, self.tip, self.last = Errors(), None, list(BEGIN), 0

    def reflex(self) -> None:
        self.errors.cartesian_reflex, self.motion, self.failed = True, None, True

    def recover(self) -> None:
        self.errors.cartesian_reflex = False

    def kill(self) -> None:
        self.lost = True

    def moves(self) -> bool:
        return self.motion is not None


THE_ARM: list[Arm] = []


class Robot:
    def __init__(self, fci_hostname: str, default_force_threshold: float, realtime_config: int) -> None:
        self.fci_hostname = fci_hostname
        self._arm = THE_ARM[-1]

    @property
    def is_in_control(self) -> bool:
        return self._arm.motion is not None

    @property
    def state(self) -> Any:
        """At rest it waits for the next one; in motion it is the newest that came."""
        arm = self._arm
        if arm.lost and arm.motion is None:
            raise RuntimeError("Net Exception")
        time.sleep(arm.late if arm.motion is not None else max(arm.late, 1e-3))
        moment = arm.last if arm.lost else round(1e3 * (time.monotonic() - arm.begun))
        if arm.motion is not None:
            part = 1.0 - math.exp(-FOLLOWS * 1e-3 * (moment - arm.last))
            arm.tip = [
                a + part * (b - a) for a, b in zip(arm.tip, arm.motion.reference.target.translation, strict=True)
            ]
        arm.last = moment
        felt = STIFFNESS * max(arm.floor - arm.tip[2], 0.0) if arm.force is None else arm.force
        mode = "Reflex" if arm.errors.cartesian_reflex else "Move" if arm.motion is not None else "Idle"
        place = (*arm.tip[:2], arm.tip[2] if arm.place is None else arm.place)
        return SimpleNamespace(
            O_T_EE=Affine(place, (1.0, 0.0, 0.0, 0.0)),
            O_F_ext_hat_K=[0.0, 0.0, -felt, 0.0, 0.0, 0.0],
            q=[0.0] * 7,
            robot_mode=SimpleNamespace(name=mode),
            current_errors=arm.errors,
            time=SimpleNamespace(to_msec=lambda: moment),
        )

    def move(self, motion: Any, asynchronous: bool) -> None:
        if self._arm.failed:
            raise ControlException("the last motion was aborted")
        if isinstance(motion, TorqueStopMotion):
            self._arm.motion, self._arm.stands = None, self._arm.stands + 1
            return
        assert not motion.used
        motion.used, self._arm.motion = True, motion

    def join_motion(self, timeout: float) -> bool:
        if self._arm.failed:
            self._arm.failed = False
            raise ControlException("libfranka: Move command aborted: motion aborted by reflex!")
        return True
