"""What is known of a force sensor and what it is mounted on: a calibration, as its TOML file holds it."""

from __future__ import annotations

import math

import msgspec

from foretouch.errors import SettingError
from foretouch.quantities.tool_load import STANDARD_GRAVITY, STILL, ToolLoad

Triple = tuple[float, float, float]
NOTHING = (0.0,) * 6


class SensorCalibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    r"""A force sensor as calibrated. What was not calibrated is None, and is not corrected.

    Vectors are in the sensor's frame. The wrench is the load on the sensor, so that a tool of mass m shows
    :math:`b + m g\, d` with gravity in direction d. Standard errors are named after what they belong to.

    Attributes:
        force_bias: What the sensor shows without any load [N].
        force_bias_error: [N].
        torque_bias: [N m].
        torque_bias_error: [N m].
        force_noise: Standard deviation of what the sensor shows at rest, along any of its axes [N].
        torque_noise: The same of its torques [N m].
        tool_mass: Beyond the sensor [kg].
        tool_mass_error: [kg].
        centre_of_mass: Centre of mass of the tool, from the sensor's origin [m].
        centre_of_mass_error: [m].
        tool_inertia: Of the tool about its centre of mass, as `ToolLoad.inertia` [kg m^2]; no command finds it.
        sensor_turn: Rotation vector from the frame in which gravity was given, the flange's, to the sensor's [rad].
        sensor_turn_error: [rad].
        approach_axis: Unit vector along which the probe approaches.
        approach_gravity: Gravity along the approach [m/s^2], 9.80665 where the probe approaches downwards.
        sensor_lag: Delay of forces behind positions [s].
        sensor_lag_error: [s].
        series_stiffness: Stiffness of arm, sensor and tip in series [N/m].
        series_stiffness_error: [N/m].
        lost_motion: Difference between loading and unloading at equal force, against a rigid block [m].

    Raises:
        SettingError: A number that is not finite, or that cannot be.
    """

    force_bias: Triple | None = None
    force_bias_error: Triple | None = None
    torque_bias: Triple | None = None
    torque_bias_error: Triple | None = None
    force_noise: float | None = None
    torque_noise: float | None = None
    tool_mass: float | None = None
    tool_mass_error: float | None = None
    centre_of_mass: Triple | None = None
    centre_of_mass_error: Triple | None = None
    tool_inertia: tuple[float, float, float, float, float, float] | None = None
    sensor_turn: Triple | None = None
    sensor_turn_error: Triple | None = None
    approach_axis: Triple = (0.0, 0.0, 1.0)
    approach_gravity: float = STANDARD_GRAVITY
    sensor_lag: float | None = None
    sensor_lag_error: float | None = None
    series_stiffness: float | None = None
    series_stiffness_error: float | None = None
    lost_motion: float | None = None

    def __post_init__(self) -> None:
        for name, value in msgspec.structs.asdict(self).items():
            numbers = () if value is None else value if isinstance(value, tuple) else (value,)
            if not all(math.isfinite(number) for number in numbers):
                raise SettingError(name, value, "must be finite")
        if abs(math.hypot(*self.approach_axis) - 1.0) > 1e-6:
            raise SettingError("approach_axis", self.approach_axis, "must have length 1")
        for name in ("tool_mass", "sensor_lag", "force_noise", "torque_noise"):
            value = getattr(self, name)
            if value is not None and value < 0.0:
                raise SettingError(name, value, "must be at least 0")
        if self.series_stiffness is not None and self.series_stiffness <= 0.0:
            raise SettingError("series_stiffness", self.series_stiffness, "must be above 0")
        if self.force_bias is not None and self.tool_mass is None:
            raise SettingError("tool_mass", None, "must be given with force_bias: both were found together")
        turn, inertia = self.sensor_turn or STILL, self.tool_inertia or NOTHING
        ToolLoad(NOTHING, 0.0, STILL, turn, inertia)  # refuses what no sensor and no body has

    @property
    def force_offset(self) -> float | None:
        r"""What a recording along the approach shows in free air [N]; None where bias and mass are not known.

        .. math:: F_0 = -a \cdot b - m g_a

        a being the approach axis and g_a gravity along it: recordings are positive in compression, where the load on
        the sensor is against the approach.
        """
        if self.force_bias is None or self.tool_mass is None:
            return None
        along = sum(axis * bias for axis, bias in zip(self.approach_axis, self.force_bias, strict=True))
        return -along - self.tool_mass * self.approach_gravity

    @property
    def tool_load(self) -> ToolLoad | None:
        """Bias and tool in all six axes; None where the torques were not calibrated. Without a turn there is none."""
        force, torque, mass, centre = self.force_bias, self.torque_bias, self.tool_mass, self.centre_of_mass
        if force is None or torque is None or mass is None or centre is None:
            return None
        return ToolLoad(force + torque, mass, centre, self.sensor_turn or STILL, self.tool_inertia or NOTHING)
