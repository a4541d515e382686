"""A simulated arm of many joints that moves a probe in three dimensions, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.quantities.pose import add, norm, rotation_of, scaled, subtract
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.description import ArmDescription
from foretouch.robot.arms.kinematics import CLOSE, InverseKinematics
from foretouch.robot.arms.obstacle import Obstacle
from foretouch.robot.engine import bounded_force
from foretouch.robot.gantry_arm import LEAST_STEPS, TouchedWorld
from foretouch.robot.robot import RobotSpecification, SpatialRobot, SpatialSample, Vector

if TYPE_CHECKING:
    from foretouch.robot.arms.control import Control

Array = NDArray[np.float64]

SETTLING = 500  # Milliseconds in which gears come to rest on a side of their play, and low-passes settle

START: Vector = (0.0, 0.0, 0.05)
SPEED = 0.5  # Largest of the tip on its way [m/s]

LOSSES = 0.5
"""Share of a joint's torque that its own damping may take on the way: with more of it a servo falls behind, and swings
over where it stops."""

TURNING_SPEED, LARGEST_TURN = 0.5, 0.6
"""How fast the tool turns to a commanded orientation [rad/s], a tenth of what these wrists can; and how far from
home it may be [rad], for beyond that a wrist's range may end within the box."""

HELD = 0.9
"""Share of the force limit that its own control holds: by a tenth a measured force is too low while it rises against
something stiff, which its low-pass and the controller's period make late."""

POSE = 6  # Numbers of a pose, and so the least joints that can turn a tool whose tip stays

SINGULAR = "it goes slower here, near a pose from which its arm cannot go in every direction"

STIFFEST, SLIDES = 1e5, 0.5
"""An arm that feels late slides over what it touches so fast that the same speed into a floor of this stiffness [N/m],
which is bone under a probe, gives this share of its force limit: the play in its gears turns the one into the other
when it closes, and the other half is for what it presses with."""

DOWN = np.array((0.0, 0.0, -1.0))


class ArticulatedArm(SpatialRobot):
    """An arm of a description, with its own control and its own knowledge of the contact force.

    The contact force comes from what is touched, asked at every physics step with the tip's exact place and velocity,
    and acts on the tool from outside; native contact is off. The tip's place is computed from the joints' encoders.

    The arm has a controller's period of its own: it takes a command and shows new samples only once in it. A session
    exchanges each millisecond, and is shown the same sample until then.

    Same seed, same commands: same samples, bit for bit.

    Args:
        description: Of the arm.
        world: Gives the contact force.
        fixture: Gives the true pose of what is touched, for scores and drawings; None where there is none.
        seed: Seed of sensor and encoder noise, not negative.
        start: Position of the tip at first, in the scene [m].
        force_limit: The contact force that it holds in the end, at most [N].
        substeps: Physics steps in a millisecond.
        obstacle: What its links can meet; None for nothing.

    Attributes:
        body: Of the arm in MuJoCo.
        control: Of its kind.
        obstacle: As given.

    Raises:
        InputError: The arm cannot reach the scene.
        SettingError: A setting out of range.
        MissingExtraError: MuJoCo or mink is not installed.
    """

    def __init__(
        self,
        description: ArmDescription,
        world: TouchedWorld,
        fixture: Callable[[], tuple[float, ...]] | None = None,
        *,
        seed: int,
        start: Vector = START,
        force_limit: float = 15.0,
        substeps: int = LEAST_STEPS,
        obstacle: Obstacle | None = None,
    ) -> None:
        from foretouch.robot.arms.sensing import SENSINGS  # Numba is slow to import: only when used

        require("seed", seed, at_least=0)
        require("force_limit", force_limit, above=0.0)
        require("substeps", substeps, at_least=LEAST_STEPS)
        self._fresh = True
        self._world, self._fixture, self.obstacle = world, fixture, None
        self._period, self._steps, self._h = 1000 // description.rate, range(substeps), 1e-3 / substeps
        self.body = Body(description, self._h)
        low, high = description.reach
        self.reach = tuple(low), tuple(high)
        inverse = InverseKinematics(description, 0.02)
        for corner in (low, high, (low[0], high[1], high[2]), (high[0], low[1], low[2])):
            inverse.reach(tuple(corner), CLOSE)
        self.body.stand(inverse.reach(start))
        self._sensing = SENSINGS[description.force](self.body, seed)
        self.specification = self._specified(force_limit)
        self._build(start, force_limit)
        if obstacle is not None:
            obstacle.join(self.body)
            self.obstacle = obstacle

    def _specified(self, force_limit: float) -> RobotSpecification:
        body, sensing = self.body, self._sensing
        tip = float(np.linalg.norm(body.jacobian[:3] * body.description.encoder))
        return RobotSpecification(
            sample_period=1e-3,
            force_limit=force_limit,
            encoder_resolution=tip,
            encoder_noise=0.0,
            tool_mass=0.0,
            gravity=0.0,
            sensor_noise=sensing.noise,
            accelerometer_noise=0.0,
            sensor_bandwidth=sensing.bandwidth,
            workspace=(-1.0, 1.0),
            simulated=True,
            sensor_range=sensing.range,
            moved_mass=body.mass_along(DOWN),
            largest_offset=sensing.largest_offset,
            contact_floor=sensing.contact_floor,
        )

    def _build(self, start: Vector, force_limit: float) -> None:
        from foretouch.robot.arms.control.impedance import ImpedanceControl
        from foretouch.robot.arms.control.reference import YIELDING_RATE, make_reference
        from foretouch.robot.arms.control.servo import ServoControl

        body, description = self.body, self.body.description
        least = np.linalg.svd(body.jacobian[:3], compute_uv=False)[-1]  # what a joint gives the tip at least
        control: Any = {"impedance": ImpedanceControl, "servo": ServoControl}[description.control]
        late, impedance = description.force == "current", math.sqrt(STIFFEST * body.mass_along(DOWN))
        sliding = SLIDES * force_limit / impedance if late else math.inf
        reference = make_reference(
            start,
            self.reach,
            speed=_tip_speed(body),
            acceleration=float(description.joint_acceleration.min() * least),
            force_limit=HELD * force_limit,
            yielding=YIELDING_RATE / control.stiffness_along(body, DOWN),
            sliding=sliding,
            period=1.0 / description.rate,
        )
        self.control: Control = control(body, reference)
        self._reference = reference
        self._clipped, self._held = reference["clipped"], reference["held"]
        self._desired, self._waited = start, 0
        self._orientation = self._turned = (0.0, 0.0, 0.0)
        self._contact: Vector = (0.0, 0.0, 0.0)
        for _ in range(SETTLING):
            self._go_on(touches=False)
        self._sample = self._measure()

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return self._fresh

    @property
    def speed_share(self) -> float:
        """Share of its speed that the tip is allowed where the arm is: less than 1 near a singular pose."""
        return float(self._reference["share"][0])

    @property
    def says(self) -> str:
        """That it goes slower, where it does: see `AnyRobot.says`."""
        return SINGULAR if self.speed_share < 1.0 else ""

    @property
    def largest_speed(self) -> float:
        """Largest speed of the tip on its way [m/s]."""
        return float(self._reference["speed"][0])

    @property
    def commanded(self) -> Vector:
        """Where the tip is told to be in the end, after all limits, in the scene [m]."""
        x, y, z = self._reference["place"][0].tolist()
        return x, y, z

    def read(self) -> SpatialSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired: Vector) -> SpatialSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `SpatialRobot`."""
        if len(desired) == 3 and all(map(math.isfinite, desired)):
            self._desired = desired
        self._fresh = False
        self._go_on(touches=True)
        if self._waited == 0:
            self._sample = self._measure()
        else:
            self._sample = self._sample._replace(exact_force=self._contact, exact_place=self._place)
        return self._sample

    def turn(self, orientation: Vector) -> None:
        """Turn the tool about its tip to an orientation, in the scene's axes.

        It goes there at 0.5 rad/s while the robot is exchanged with. An arm of five joints cannot, and holds its tool.

        Args:
            orientation: Rotation vector from that at home [rad], shortened to 0.6 rad; left out where not finite.
        """
        if self.body.joints.size >= POSE and len(orientation) == 3 and all(map(math.isfinite, orientation)):
            angle = max(norm(orientation), LARGEST_TURN)
            self._orientation = scaled(orientation, LARGEST_TURN / angle)

    def _turn_on(self) -> None:
        """Let the commanded orientation go on for a period of the controller."""
        left = subtract(self._orientation, self._turned)
        angle = norm(left)
        if angle > 0.0:
            most = TURNING_SPEED * 1e-3 * self._period
            self._turned = self._orientation if angle <= most else add(self._turned, scaled(left, most / angle))
            self.control.turn(np.array(rotation_of(*self._turned)))

    def _go_on(self, *, touches: bool) -> None:
        """Let a millisecond pass, in which the world is touched or is not there yet."""
        body, sensing, begins = self.body, self._sensing, self._waited == 0
        for _ in self._steps:
            body.begin_step()
            if begins:
                self._turn_on()
                self.control.begin(self._desired, sensing.force, sensing.beside_tip)
                begins = False
            self._place: Any = tuple(body.place.tolist())
            if touches:
                velocity: Any = tuple(body.velocity.tolist())
                self._contact = bounded_force(self._world(self._place, velocity, self._h))
            if self.obstacle is not None:
                self.obstacle.push(self._h)
            body.end_step(self.control.torques(), self._contact)
            sensing.step()
        self._waited = (self._waited + 1) % self._period

    def _measure(self) -> SpatialSample:
        body, counted = self.body, self.body.counted
        off = self._sensing.positions(counted) - body.positions  # small enough for the Jacobian
        seen: Any = tuple((body.place + body.jacobian[:3].dot(off)).tolist())
        felt: Any = tuple(self._sensing.read().tolist())
        fixture = () if self._fixture is None else self._fixture()
        joints = tuple(counted.tolist())  # those of now, also where places are shown as late as the force
        flags = bool(self._clipped[0]), bool(self._held[0])
        return SpatialSample(seen, felt, self._contact, self._place, fixture, *flags, joints)


def left_in_free_air(arm: ArticulatedArm) -> tuple[float, float, float]:
    """What is left at a sensor at the wrist while nothing is touched: force [N], torque about the tip, its most [N m].

    See `foretouch.robot.arms.sensing.wrist.left_in_free_air`.
    """
    from foretouch.robot.arms.sensing.wrist import left_in_free_air

    return left_in_free_air(arm._sensing)


def _tip_speed(body: Body) -> float:
    """Largest speed of the tip [m/s] that no joint is too slow for, along any axis of the scene, with the tool held."""
    limits, along = body.limits(), np.linalg.pinv(body.jacobian)[:, :3]
    lossy = LOSSES * limits["torque"] / np.maximum(limits["damping"], 1e-9)
    fastest = np.minimum(body.description.joint_speed, lossy)
    return min(SPEED, float((fastest[:, None] / np.maximum(np.abs(along), 1e-9)).min()))
