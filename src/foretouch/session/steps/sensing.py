"""Self-checks of a follower: whether its calibration fits the robot, and exceptions in a step."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

from foretouch.errors import SettingError, one_line
from foretouch.identification.conditioning.conditioner import LONGEST_LAG
from foretouch.identification.conditioning.kernel import CONTACT_FLOOR
from foretouch.quantities import SensorCalibration
from foretouch.recordings import read_calibration
from foretouch.robot import ArmDescription, RobotSpecification, read_arm
from foretouch.session.safety.safety import SafetyLimits
from foretouch.session.settings import SessionSettings
from foretouch.session.workspace import LINE, SPACE
from foretouch.settings import SAFETY_LIMITS, is_arm

LARGEST_GIVE = 5e-3
"""Largest deflection of an arm under the force ceiling [m]; more means a stiffness measured on something soft, which
would be subtracted from every material."""

SAME_GRAVITY = 1.0
"""Largest difference of gravity along the approach for the same direction [m/s^2]: 6 degrees for a level robot."""

SURE = 3.0  # Number of standard errors within which a bias is assumed

NOISE_FACTOR = 6.0
"""Number of standard deviations of the sensor's noise above which a force is contact in a calibrated session."""


class Calibrated(NamedTuple):
    """Calibrated values that a follower uses; those not calibrated keep their defaults.

    Attributes:
        specification: Specification of the robot, with the known properties of tool and sensor offset.
        zero: Along a line, sensor reading in free air beside its tool [N]; None where it is estimated.
        compliance: Compliance of arm, sensor and tip in series [m/N].
        sensor_lag: Delay of forces against positions [s].
        contact_floor: Least force that counts as contact [N].
    """

    specification: RobotSpecification
    zero: float | None = None
    compliance: float = 0.0
    sensor_lag: float = 0.0
    contact_floor: float = CONTACT_FLOOR


def session_calibration(settings: SessionSettings) -> SensorCalibration | None:
    """The calibration that the settings name, None where they name none.

    Raises:
        RecordingError: The file cannot be read, or is no calibration.
        SettingError: It contains nothing that a session uses, or does not fit the settings' arm.
    """
    if not settings.calibration:
        return None
    result = read_calibration(settings.calibration)
    if all(
        value is None for value in (result.force_bias, result.tool_mass, result.sensor_lag, result.series_stiffness)
    ):
        _refuse(settings, "holds neither bias, tool, lag nor series stiffness: there is nothing to correct")
    if is_arm(settings.robot) and (result.force_bias is not None or result.tool_mass is not None):
        _check_arm(result, read_arm(settings.robot), settings)
    return result


def _check_arm(result: SensorCalibration, arm: ArmDescription, settings: SessionSettings) -> None:
    if arm.force != "wrist":
        _refuse(settings, f"has a sensor's bias and its tool, and {arm.name} has no sensor at its wrist: leave it out")
    if result.tool_load is None:
        _refuse(settings, f"holds no torques, and the sensor at the wrist of {arm.name} has six axes: calibrate anew")
    if (result.tool_mass or 0.0) > arm.payload:
        _refuse(settings, f"has a tool of {result.tool_mass:.3g} kg, and {arm.name} carries {arm.payload:g} kg")


def calibrated_arm(settings: SessionSettings) -> ArmDescription:
    """The description of the settings' arm, with tool and sensor as their calibration found them.

    Raises:
        InputError: The description breaks a rule.
        RecordingError: As `session_calibration`.
        SettingError: The same.
        MissingExtraError: MuJoCo is not installed.
    """
    known, arm = session_calibration(settings), read_arm(settings.robot)
    return arm if known is None else replace(arm, tool=known.tool_load)


def calibrated(specification: RobotSpecification, settings: SessionSettings) -> Calibrated:
    r"""Values that a follower of this robot uses from the settings' calibration.

    Along a line the sensor shows :math:`F_0 - m (\ddot p - g)` less in contact, :math:`F_0 = -a \cdot b` being its bias
    along the approach. In space the sensor may turn, and the tool is weighed out by the robot: of the bias only its
    size is used, as the largest offset that the sensor can have. A simulated arm takes off both by itself
    (`calibrated_arm`).

    Args:
        specification: The robot's own specification.
        settings: Session settings.

    Raises:
        RecordingError: The file cannot be read, or is no calibration.
        SettingError: The calibration does not fit this robot.
    """
    result = session_calibration(settings)
    least = max(CONTACT_FLOOR, specification.contact_floor)
    if result is None:
        return Calibrated(specification, contact_floor=least)
    lag, stiffness = result.sensor_lag or 0.0, result.series_stiffness
    if lag > LONGEST_LAG:
        _refuse(settings, f"has a sensor lag of {lag:g} s: a session mends at most {LONGEST_LAG:g} s")
    give = 0.0 if stiffness is None else settings.force_ceiling / stiffness
    if give > LARGEST_GIVE:
        what = f"gives way by {1e3 * give:.3g} mm under {settings.force_ceiling:g} N"
        _refuse(settings, f"{what}: at most {1e3 * LARGEST_GIVE:g} mm are an arm's; calibrate it on a rigid block")
    own, zero = specification, None
    if not is_arm(settings.robot):
        own, zero = OWN[settings.workspace](result, specification, settings)
    if result.force_bias is not None and math.hypot(*result.force_bias) >= specification.sensor_range:
        shown = f"{math.hypot(*result.force_bias):.4g} N, and the robot's sensor shows at most"
        _refuse(settings, f"has a force bias of {shown} {specification.sensor_range:g} N: it is another sensor's")
    floor = max(least, NOISE_FACTOR * (result.force_noise or 0.0))
    return Calibrated(own, zero, 0.0 if stiffness is None else 1.0 / stiffness, lag, floor)


Own: TypeAlias = tuple[RobotSpecification, float | None]  # with tool and sensor, and the sensor's zero [N]


def _along_a_line(result: SensorCalibration, own: RobotSpecification, settings: SessionSettings) -> Own:
    if result.tool_mass is None:
        return own, None
    if own.tool_mass > 0.0 and abs(result.approach_gravity - own.gravity) > SAME_GRAVITY:
        what = f"has {result.approach_gravity:.4g} m/s^2 of gravity along the approach"
        _refuse(settings, f"{what}, and the robot {own.gravity:.4g}: give --approach-gravity to calibrate")
    offset, mass, gravity = result.force_offset, result.tool_mass, result.approach_gravity
    return replace(own, tool_mass=mass, gravity=gravity), None if offset is None else offset + mass * gravity


def _in_space(result: SensorCalibration, own: RobotSpecification, settings: SessionSettings) -> Own:
    if result.force_bias is None:
        return own, None
    largest = math.hypot(*result.force_bias) + SURE * math.hypot(*(result.force_bias_error or ()))
    return replace(own, largest_offset=max(largest, own.largest_offset)), None  # however the sensor turns


OWN = {LINE: _along_a_line, SPACE: _in_space}


def _refuse(settings: SessionSettings, rule: str) -> None:
    raise SettingError("calibration", settings.calibration, rule)


def safety_limits(settings: SessionSettings, specification: RobotSpecification) -> SafetyLimits:
    """The limits that the settings set, within those of this robot."""
    return SafetyLimits(
        **{name: getattr(settings, setting) for name, setting in SAFETY_LIMITS.items()},
        workspace=specification.workspace,
        mass=specification.moved_mass,
        retreats=settings.on_silence == "retreat",
    )


LONGEST_TEXT = 200  # Largest number of characters kept of an exception's text


class Failures:
    """Exceptions in the stages of a follower's step.

    A stage that learns ends with its first exception: its state is then useless. Other stages are tried
    again in the next tick. Safety comes after all of them and needs none.

    Attributes:
        count: Number of exceptions so far.
        sentence: First exception with place and reason, on one line; "" while there is none.
        learns: Whether learning goes on.
    """

    __slots__ = ("count", "learns", "sentence")

    def __init__(self) -> None:
        self.count = 0
        self.sentence = ""
        self.learns = True

    def note(self, stage: str, error: Exception) -> None:
        """Take one exception of a stage, which is named as the end of "raised in"; only its sentence is kept."""
        self.count += 1
        if not self.sentence:
            text = one_line(error, LONGEST_TEXT)
            self.sentence = f"{type(error).__name__} raised in {stage}{f' ({text})' if text else ''}"

    def stop_learning(self, stage: str, error: Exception) -> None:
        """Take one exception of a learning stage, which then learns no more."""
        if self.learns:
            self.sentence = ""  # the end of learning takes precedence as news
        self.learns = False
        self.note(stage, error)
