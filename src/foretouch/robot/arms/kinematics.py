"""Inverse kinematics of an arm, by mink: the joints that bring its tip to a place, with the tool held upright."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import MissingExtraError
from foretouch.quantities import BASE, TIP
from foretouch.robot.arms.body import too_far
from foretouch.robot.arms.description import ArmDescription
from foretouch.robot.engine import load_mujoco
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


NEARING = 0.95  # Share of what is left to the end of a joint's range that a period may take, as in mink's own limit


class JointLimits:
    """Ranges and speeds of the joints as one limit of mink's: the smaller of both, in half the rows of its own two.

    Args:
        model: Of MuJoCo, of hinges.
        speeds: Largest speeds [rad/s], shape (n,).
        constraint: Of mink.
    """

    def __init__(self, model: Any, speeds: Array, constraint: Any) -> None:
        ends = np.where(model.jnt_limited, model.jnt_range.T, ((-np.inf,), (np.inf,)))
        (self._low, self._high), self._speeds, one = ends, speeds, np.eye(speeds.size)
        self._bounds = np.empty((2, speeds.size))
        self._constraint = constraint(np.concatenate((one, -one)), self._bounds.reshape(-1))

    def compute_qp_inequalities(self, configuration: Any, dt: float) -> Any:
        """See `mink.Limit`."""
        positions, bounds = configuration.data.qpos, self._bounds
        np.subtract(self._high, positions, out=bounds[0])
        np.subtract(positions, self._low, out=bounds[1])
        bounds *= NEARING
        np.minimum(bounds, dt * self._speeds, out=bounds)
        return self._constraint


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
        self._model, self._data, self._site = model, self._at.data, model.site(TIP).id
        self._place, self._origin = self._data.site_xpos[self._site], self._data.site(BASE).xpos + description.scene
        count = description.home.size
        upright = np.array([1.0, 1.0, 1.0 if count > 5 else 0.0])
        self._tip = mink.FrameTask(TIP, "site", position_cost=10.0, orientation_cost=upright, lm_damping=DAMPING)
        self._tip.set_target_from_configuration(self._at)
        self._target = self._tip.transform_target_to_world.wxyz_xyz  # turned as at home, until it is told otherwise
        self._home = mink.SO3(self._target[:4].copy())
        elbow = mink.PostureTask(model, cost=ELBOW)
        elbow.set_target(description.home)
        self._tasks = [self._tip, elbow]
        self._limits = [JointLimits(model, description.joint_speed, mink.Constraint)]
        self._accelerated = description.joint_acceleration * period
        self.velocities, self._jacobian = np.zeros(count), np.zeros((3, count))
        self._look = load_mujoco().mj_jacSite

    @property
    def positions(self) -> Array:
        """The joints [rad], shape (n,)."""
        positions: Array = self._at.q
        return positions

    @property
    def place(self) -> Array:
        """Where the tip is with these joints, in the scene [m], shape (3,)."""
        place: Array = self._place - self._origin
        return place

    def jacobian(self) -> Array:
        """Jacobian of the tip's place with these joints, shape (3, n), of the next call as well."""
        self._look(self._model, self._data, self._jacobian, None, self._site)
        return self._jacobian

    def begin(self, positions: Array) -> None:
        """Stand still with these joints [rad]."""
        self._at.update(positions)
        self.velocities = np.zeros_like(self.velocities)

    def turn(self, rotation: Array) -> None:
        """Turn the tool from its orientation at home by a rotation matrix, shape (3, 3), on the way from now on."""
        self._target[:4] = (self._mink.SO3.from_matrix(rotation) @ self._home).wxyz

    def follow(self, place: Array) -> None:
        """Let the joints go on for a period, towards a place of the tip in the scene [m]."""
        mink = self._mink
        self._target[4:] = place + self._origin
        try:
            wanted = mink.solve_ik(self._at, self._tasks, self._period, "daqp", limits=self._limits)
        except mink.NoSolutionFound:
            wanted = np.zeros_like(self.velocities)
        change = np.minimum(np.maximum(wanted - self.velocities, -self._accelerated), self._accelerated)
        self.velocities = self.velocities + change
        self._at.integrate_inplace(self.velocities, self._period)

    def reach(self, place: Vector, enough: float = 0.0) -> Array:
        """The joints that bring the tip to a place of the scene [rad], from home; there it stands still.

        Args:
            place: Of the tip [m].
            enough: Distance from it that ends the way there [m], of `CLOSE` at most.

        Raises:
            InputError: The arm cannot.
        """
        self._at.update(self._description.home)
        target, unlimited = np.asarray(place), self._accelerated
        self._accelerated = np.full_like(unlimited, np.inf)
        for _ in range(TURN_STEPS):
            self.follow(target)
            away = float(np.linalg.norm(self.place - target))
            if away <= enough:
                break
        self.velocities[:], self._accelerated = 0.0, unlimited
        if away > CLOSE:
            raise too_far(self._description, place, away)
        return np.array(self.positions)
