"""Inverse kinematics of an arm, by mink: the joints that bring its tip to a place, with the tool held upright."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError
from foretouch.quantities import BASE, TIP
from foretouch.robot.arms.body import too_far
from foretouch.robot.arms.description import ArmDescription
from foretouch.robot.robot import Vector

Array = NDArray[np.float64]

ELBOW, DAMPING = 1e-3, 1e-6
"""Cost of leaving the posture beside that of a place [1/rad^2], and of moving at all: both small, as neither may keep
the tip away."""

TURN_STEPS, CLOSE = 200, 1e-4
"""Steps in which a pose is looked for from home, and how near the tip has to come [m]."""


def load_mink() -> Any:
    """The module mink.

    Raises:
        MissingExtraError: It is not installed.
    """
    try:
        import mink
    except ImportError as error:
        raise MissingExtraError("mink", "arms") from error
    return mink


class InverseKinematics:
    r"""Joint positions on their way to a place of the tip, a period at a time.

    In each period mink solves

    .. math:: \min_{\dot q} \|J \dot q \, \Delta t - e\|^2 + \epsilon \|q - q_0\|^2

    within the joints' positions and speeds, e being what is left of the tip's pose. The tool stays as it stands at
    home, or turns from there as it is told; an arm of five joints lets it turn about its own axis. Where no motion is
    allowed, the joints stay.

    Args:
        description: Of the arm.
        period: In which the joints go on [s].
    """

    def __init__(self, description: ArmDescription, period: float) -> None:
        mink = load_mink()
        model = description.model(1e-3, backlash=False)
        self._mink, self._period, self._description = mink, period, description
        self._at = mink.Configuration(model, description.home)
        self._origin = self._at.data.site(BASE).xpos + description.scene
        count = description.home.size
        upright = np.array([1.0, 1.0, 1.0 if count > 5 else 0.0])
        self._tip = mink.FrameTask(TIP, "site", position_cost=10.0, orientation_cost=upright, lm_damping=DAMPING)
        self._tip.set_target_from_configuration(self._at)
        self._home = self._turned = self._tip.transform_target_to_world.rotation()
        elbow = mink.PostureTask(model, cost=ELBOW)
        elbow.set_target(description.home)
        self._tasks = [self._tip, elbow]
        speeds = {model.joint(number).name: description.joint_speed[number] for number in range(count)}
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
        self._accelerated = description.joint_acceleration * period
        self.velocities = np.zeros(count)

    @property
    def positions(self) -> Array:
        """The joints [rad], shape (n,)."""
        positions: Array = self._at.q
        return positions

    @property
    def place(self) -> Array:
        """Where the tip is with these joints, in the scene [m], shape (3,)."""
        place: Array = self._at.data.site(TIP).xpos - self._origin
        return place

    @property
    def least_singular(self) -> float:
        """Smallest singular value of the tip's translational Jacobian [m/rad]."""
        jacobian = self._at.get_frame_jacobian(TIP, "site")[:3]
        return float(np.linalg.svd(jacobian, compute_uv=False)[-1])

    def begin(self, positions: Array) -> None:
        """Stand still with these joints [rad]."""
        self._at.update(positions)
        self.velocities = np.zeros_like(self.velocities)

    def turn(self, rotation: Array) -> None:
        """Turn the tool from its orientation at home by a rotation matrix, shape (3, 3), on the way from now on."""
        self._turned = self._mink.SO3.from_matrix(rotation) @ self._home

    def follow(self, place: Array) -> None:
        """Let the joints go on for a period, towards a place of the tip in the scene [m]."""
        mink = self._mink
        target = mink.SE3.from_rotation_and_translation(self._turned, place + self._origin)
        self._tip.set_target(target)
        try:
            wanted = mink.solve_ik(self._at, self._tasks, self._period, "daqp", limits=self._limits)
        except mink.NoSolutionFound:
            wanted = np.zeros_like(self.velocities)
        change = np.clip(wanted - self.velocities, -self._accelerated, self._accelerated)
        self.velocities = self.velocities + change
        self._at.integrate_inplace(self.velocities, self._period)

    def reach(self, place: Vector) -> Array:
        """The joints that bring the tip to a place of the scene [rad], from home; there it stands still.

        Raises:
            InputError: The arm cannot.
        """
        self._at.update(self._description.home)
        target, unlimited = np.asarray(place), self._accelerated
        self._accelerated = np.full_like(unlimited, np.inf)
        for _ in range(TURN_STEPS):
            self.follow(target)
        self.velocities[:], self._accelerated = 0.0, unlimited
        away = float(np.linalg.norm(self.place - target))
        if away > CLOSE:
            raise too_far(self._description, place, away)
        return np.array(self.positions)
