"""The simulated arm along a line as one compiled record, without a physics engine: for pages and programs of C.

It is `foretouch.robot.RcmArm` with the two hinges left out, which hold still: drive, sensors and material are the same.
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.robot.engine import GRAVITY, LARGEST_CONTACT_FORCE, MOVED_MASS, RAIL_DAMPING, TOOL_MASS, ArmSettings
from foretouch.robot.materials import Material, make_material
from foretouch.robot.materials.pressed import Pressed, make_pressed, press
from foretouch.robot.servo_kernel import Arm, begin, effort, make_servo, sense, show

_begin, _effort, _sense, _show = begin.function, effort.function, sense.function, show.function

SUBSTEPS, STEP = ArmSettings().substeps, ArmSettings().step  # Physics steps in an exchange, and their length [s]

OFFSET = 0.3  # What the force sensor shows with nothing on it [N]
Sampled = tuple[float, float, float, float, float, float, bool, float]
"""The first eight fields of a `foretouch.robot.RobotSample`."""


class Slide(Record):
    """A mass on a rail with its servo, its sensors, and what its tip presses."""

    arms: Arm
    material: Pressed
    surface: float  # position of the undeformed surface [m]
    position: float  # of the tip [m]
    velocity: float  # [m/s]
    contact: float  # force of the material on the tip [N]
    drive: float  # force of the drive, net of gravity [N]


def make_slide(material: str | Material, *, surface: float | None = None) -> NDArray[Any]:
    r"""A slide at rest at position 0, with the settings of `RcmArm`, as an array of one record.

    Args:
        material: What it presses, or its name: see `foretouch.robot.materials.pressed.make_pressed`.
        surface: Position of the undeformed surface [m]; None takes the material's own.

    Raises:
        UnknownNameError: No such material.
        SettingError: The material has a law that is not compiled.
    """
    made = make_material(material) if isinstance(material, str) else material
    settings = ArmSettings()
    arm = Arm.new(
        servo=make_servo(settings.force_limit, settings.sample_period, 0.0),
        h=settings.step,
        low_pass=1.0 - math.exp(-2.0 * math.pi * settings.sensor_bandwidth * settings.step),
        workspace=(-0.02, 0.06),
        encoder_noise=settings.encoder_noise,
        resolution=settings.encoder_resolution,
        offset=OFFSET,
        sensor_noise=settings.sensor_noise,
        largest=200.0,
        accelerometer_noise=0.05,
        tool=-TOOL_MASS * GRAVITY,
        sensor=-TOOL_MASS * GRAVITY,
        shown=OFFSET - TOOL_MASS * GRAVITY,
    )
    return Slide.new(
        arms=arm,
        material=make_pressed(made, settings.step),
        surface=made.surface if surface is None else surface,
    )


@compiled
def _move(slide: Slide, push: float) -> float:
    """One physics step under a drive force [N]: semi-implicit, with the rail's damping taken at its end.

    Returns:
        The force between carriage and tool at its beginning [N], as the sensor between them feels it.
    """
    total = push - slide.contact - RAIL_DAMPING * slide.velocity
    interaction = slide.contact + TOOL_MASS * (total / MOVED_MASS - GRAVITY)
    slide.velocity += STEP * total / (MOVED_MASS + STEP * RAIL_DAMPING)
    slide.position += STEP * slide.velocity
    return float(interaction)


@kernel("Tuple((f8, f8, f8, f8, f8, f8, b1, f8))(Slide[::1], f8, f8, f8, f8)")
def exchange(slides: NDArray[Any], desired: float, encoder: float, sensor: float, accelerometer: float) -> Sampled:
    """Give a command [m], let 1 ms pass, and return what the sensors show then.

    Args:
        slides: One `Slide`, written.
        desired: Where the tip should be [m]; one that is not finite is left out.
        encoder: A normal draw, for its noise.
        sensor: The same for the force sensor.
        accelerometer: The same for the accelerometer.
    """
    slide = slides[0]
    arms = slides["arms"]
    _begin(arms, desired, slide.velocity)
    for _ in range(SUBSTEPS):
        slide.drive = _effort(arms, slide.position, slide.velocity)
        interaction = _move(slide, slide.drive)
        _sense(arms, slide.velocity, interaction)
        force = press(slide.material, slide.position - slide.surface, slide.velocity, STEP)
        slide.contact = min(force, LARGEST_CONTACT_FORCE) if force >= 0.0 else 0.0
    position, felt, acceleration, reference, clipped = _show(arms, slide.position, encoder, sensor, accelerometer)
    return position, felt, acceleration, slide.contact, slide.position, reference, clipped, slide.drive
