"""The contact force by a six-axis sensor at an arm's wrist, and where on the tool it acts."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, kernel
from foretouch.quantities import SENSOR, TIP, ToolLoad
from foretouch.quantities.pose import rotation_of
from foretouch.robot.arms.body import Body
from foretouch.robot.arms.description import PROBE_RADIUS
from foretouch.robot.arms.sensing.tip_contact import SURE, TipContact, TipSensing, Touching
from foretouch.robot.arms.sensing.wrist_sensor import WristSensor
from foretouch.robot.engine import OFFSET_UNCERTAINTY

Array = NDArray[np.float64]

ZEROED_BY = 100  # Samples of which the sensor's bias is the mean, before anything is touched

BESIDE_FOR = 5  # Samples in a row that show a contact beside the tip: a blow shakes the tool for less

FORCE_LEFT, TORQUE_LEFT = 0.06, 2e-3
"""Standard deviations of a force [N] and a torque [N m] with what no zero takes off: noise, drift, and the cross-talk
where 5 N push."""


Numbers3 = Annotated[Array, float, 3]
Numbers9 = Annotated[Array, float, 9]


class Tool(Record):
    """The tool behind a sensor that is held upright, as far as it is known, and what its accelerometer shows."""

    mass: float  # [kg]
    centre: Numbers3  # of mass, from the sensor's origin in its frame [m]
    turn: Numbers9  # from the flange's frame to the sensor's, row by row
    gain: float  # share by which the accelerometer's low-pass moves
    x: float  # acceleration of the centre of mass less gravity in the flange's frame, behind the low-pass [m/s^2]
    y: float
    z: float


@kernel("void(Tool[::1], f8[::1])")
def move(tools: NDArray[np.void], sensed: Array) -> None:
    """Move the low-pass of the accelerometer behind a physics step; it is that of the sensor.

    Args:
        tools: Written.
        sensed: What the flange does to the tool (force [N] and torque [N m]), and what an accelerometer in its centre
            of mass shows [m/s^2].
    """
    tool = tools[0]
    tool.x += tool.gain * (sensed[6] - tool.x)
    tool.y += tool.gain * (sensed[7] - tool.y)
    tool.z += tool.gain * (sensed[8] - tool.z)


@kernel("void(Tool[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])", Tool)
def take_off(tools: NDArray[np.void], shown: Array, zero: Array, rotation: Array, wrench: Array, force: Array) -> None:
    r"""Take the tool's weight and inertia off, by Newton and Euler.

    .. math:: f = y_F - b_F + m a, \qquad t = y_T - b_T + c \times m a

    a being the acceleration of the centre of mass less gravity, turned into the sensor's frame. The tool is held
    upright: what turns it is left out.

    Args:
        tools: One.
        shown: y, the load on the sensor as it shows it (force [N] and torque [N m]).
        zero: b, what it shows of no load.
        rotation: Of the flange's frame in the scene's, row by row.
        wrench: Written: of the contact, about the sensor's origin in its frame.
        force: Written: the same force in the scene's frame [N].
    """
    tool = tools[0]
    turn = tool.turn
    a = tool.mass * (turn[0] * tool.x + turn[1] * tool.y + turn[2] * tool.z)
    b = tool.mass * (turn[3] * tool.x + turn[4] * tool.y + turn[5] * tool.z)
    c = tool.mass * (turn[6] * tool.x + turn[7] * tool.y + turn[8] * tool.z)
    x, y, z = tool.centre[0], tool.centre[1], tool.centre[2]
    wrench[0], wrench[1], wrench[2] = shown[0] - zero[0] + a, shown[1] - zero[1] + b, shown[2] - zero[2] + c
    wrench[3] = shown[3] - zero[3] + (y * c - z * b)
    wrench[4] = shown[4] - zero[4] + (z * a - x * c)
    wrench[5] = shown[5] - zero[5] + (x * b - y * a)
    for row in range(3):
        at = 3 * row
        force[row] = 0.0
        for axis in range(3):
            along = turn[axis] * wrench[0] + turn[3 + axis] * wrench[1] + turn[6 + axis] * wrench[2]
            force[row] += rotation[at + axis] * along


class WristForce:
    """A six-axis sensor between flange and tool, with weight and inertia taken off by an accelerometer in the tool.

    Its bias is taken for the mean of what it shows before anything is touched, and the tool for the description's,
    unless a calibration gave both (`ArmDescription.tool`); then it warms up.

    Args:
        body: Whose wrist it is.
        seed: Of its noise, not negative.

    Attributes:
        contact: Where on the tool the contact force of the newest sample acts.
        beside_tip: Whether no contact at the tip has explained the newest `BESIDE_FOR` samples.
    """

    contact_floor = 0.0

    def __init__(self, body: Body, seed: int) -> None:
        step = float(body.model.opt.timestep)
        self._sensor = sensor = WristSensor(step, 1.0 / body.description.rate, seed=seed)
        kind = sensor.kind
        self.noise, self.bandwidth, self.range = kind.noise[0], kind.bandwidth, min(kind.largest[:3])
        self.largest_offset = math.hypot(*sensor.drift[:3]) + OFFSET_UNCERTAINTY
        self._body, (_, mass) = body, body.description.probe
        model = body.model
        root, tip = model.site(SENSOR).pos[2], model.site(TIP).pos[2]
        height = float(model.body("tool").ipos[2] - root)
        load = body.description.tool or ToolLoad((0.0,) * 6, mass, (0.0, 0.0, height))
        turn = np.array(rotation_of(*load.sensor_turn))
        gain = -math.expm1(-2.0 * math.pi * self.bandwidth * step)
        self._tool = Tool.new(mass=load.mass, centre=np.array(load.centre_of_mass), turn=turn.ravel(), gain=gain)
        self._sensed, self._interaction = body.data.sensordata, body.data.sensordata[:6]
        self._wrench, self.force = np.zeros(6), np.zeros(3)
        self._zero, self._is_zeroed = np.array(load.bias), body.description.tool is not None
        self._beside, self.beside_tip = 0, False
        self._tip = TipSensing(PROBE_RADIUS, tuple((turn[:, 2] * (tip - root)).tolist()), FORCE_LEFT, TORQUE_LEFT)
        self.contact: TipContact | None = self._tip.locate(self._wrench)
        self._move, self._take_off = move.entry, take_off.entry

    def step(self) -> None:
        """See `Sensing.step`."""
        self._sensor.feel(self._interaction)
        self._move(self._tool, self._sensed)

    def positions(self, counted: Array) -> Array:
        """See `Sensing.positions`."""
        return counted

    def read(self) -> Array:
        """See `Sensing.read`; the first call finds the bias, where no calibration gave it."""
        if not self._is_zeroed:
            self._is_zeroed = True
            self._zero = np.mean([self._contact_of(self._sensor.read()).copy() for _ in range(ZEROED_BY)], axis=0)
        self._contact_of(self._sensor.read())
        self.contact = contact = self._tip.locate(self._wrench)
        self._beside = self._beside + 1 if contact.touching is Touching.ELSEWHERE else 0
        self.beside_tip = self._beside >= BESIDE_FOR
        return self.force

    def _contact_of(self, shown: Array) -> Array:
        rotation = self._body.sensor_rotation
        self._take_off(self._tool, shown, self._zero, rotation, self._wrench, self.force)
        return self._wrench


def left_in_free_air(sensing: WristForce) -> tuple[float, float, float]:
    r"""What bias and tool leave while nothing is touched: force [N], torque about the tip, and its most [N m].

    It is the mean of as many samples as an uncalibrated bias is; the sensor is read, and no time passes. With a torque
    beyond

    .. math:: 5 \sqrt{\sigma_t^2 + |c|^2 \sigma_f^2} - \sqrt{n_t^2 + |c|^2 n_f^2}

    a light contact at the tip, c from the sensor, would be taken for one beside it (`TipSensing`): sigma is what no
    zero takes off, and n the noise of a sample, of which one standard deviation is left room for.
    """
    shown = [sensing._contact_of(sensing._sensor.read()).copy() for _ in range(ZEROED_BY)]
    force, torque = np.split(np.mean(shown, axis=0), 2)
    model, along = sensing._body.model, np.reshape(sensing._tool["turn"], (3, 3))[:, 2]
    lever = float(model.site(TIP).pos[2] - model.site(SENSOR).pos[2])
    noise, torque_noise = sensing._sensor.kind.noise
    most = SURE * math.hypot(TORQUE_LEFT, lever * FORCE_LEFT) - math.hypot(torque_noise, lever * noise)
    left = np.linalg.norm(torque - np.cross(lever * along, force))
    return float(np.linalg.norm(force)), float(left), most
