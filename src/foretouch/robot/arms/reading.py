"""How a description is read, of the package or of one's own, and which rule it breaks: see `docs/arms.md`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from foretouch.errors import InputError, one_line
from foretouch.quantities import BASE, FLANGE, SENSOR, TIP
from foretouch.robot.arms.description import WEIGHT, ArmDescription, Array, driven
from foretouch.robot.engine import load_mujoco, write_no_log
from foretouch.settings import ARMS

CONTROLS, FORCES = ("impedance", "servo"), ("wrist", "current")
ABOVE_ZERO, NOT_NEGATIVE = ("joint_speed", "joint_acceleration", "servo_stiffness", "probe"), ("servo_damping",)
PROBE_SITES, PROBE_BODY = (SENSOR, TIP, WEIGHT), "tool"  # What the probe brings; no description has the same names
UPRIGHT = 10.0
"""A flange may lean so far at home [degrees]: a tool that is held so still presses with its tip. The package's are
within 0.1."""


def read_arm(name: str) -> ArmDescription:
    """The description of an arm of the package by its name, or of one's own by the path of its file.

    Raises:
        InputError: No such file, no MJCF, or one that does not say what a controller has to know.
        MissingExtraError: MuJoCo is not installed.
    """
    if name in ARMS:
        path = Path(str(resources.files("foretouch.robot.arms"))) / "descriptions" / f"{name}.xml"
    else:
        path = Path(name)
    mujoco = load_mujoco()
    if fault := _fault_of_file(path):
        raise InputError(f"{path}: {fault}")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        spec.compile()
    except ValueError as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{path}: MuJoCo cannot read it as the description of an arm: {reason}") from error
    return _Reader(path, spec).description(name if name in ARMS else path.stem)


class _Reader:
    """What a description says, by name, or which rule it breaks."""

    def __init__(self, path: Path, spec: Any) -> None:
        self._path, self._spec, self._joints = path, spec, len(spec.actuators)
        self._numerics = {one.name: np.array(one.data) for one in spec.numerics}
        self._texts = {one.name: str(one.data) for one in spec.texts}

    def description(self, name: str) -> ArmDescription:
        """All of it, checked."""
        self._check_tree()
        rate = self.number("rate")
        if not (1.0 <= rate <= 1000.0 and (1000.0 / rate).is_integer()):
            raise self._error(
                f"its rate is {rate:g} Hz, and has to be a whole fraction of 1000 Hz: 1000, 500, 200, ..."
            )
        length, mass = self.numbers("probe", 2).tolist()
        payload = self.number("payload")
        if mass > payload:
            raise self._error(f"its probe weighs {mass:g} kg, and it carries {payload:g} kg: take a lighter one")
        servo = self.text("control", CONTROLS) == "servo"
        zero = np.zeros(self._joints)
        return ArmDescription(
            name,
            self._path,
            self.text("control", CONTROLS),
            self.text("force", FORCES),
            int(rate),
            self.numbers("joint_speed", self._joints),
            self.numbers("joint_acceleration", self._joints),
            self.number("joint_torque_rate") if "joint_torque_rate" in self._numerics else math.inf,
            payload,
            self.number("encoder"),
            self.numbers("servo_stiffness", self._joints) if servo else zero,
            self.numbers("servo_damping", self._joints) if servo and "servo_damping" in self._numerics else zero,
            self.number("servo_integral") if "servo_integral" in self._numerics else 0.0,
            self.numbers("scene", 3),
            self.numbers("reach", 6).reshape(2, 3),
            (length, mass),
        )

    def _error(self, rule: str) -> InputError:
        return InputError(f"{self._path}: {rule}")

    def _check_tree(self) -> None:
        spec, sites = self._spec, [site.name for site in self._spec.sites]
        for site in (BASE, FLANGE):
            if site not in sites:
                raise self._error(f'it has no site "{site}": add one to the body of the {site}')
        if self._joints < 5:
            raise self._error(f"it has {self._joints} motors: a probe is moved and held upright by 5 joints or more")
        for joint in spec.joints:
            if joint.type != load_mujoco().mjtJoint.mjJNT_HINGE:
                raise self._error(f'its joint "{joint.name}" is not a hinge: an arm here has hinges only')
        if "home" not in [key.name for key in spec.keys]:
            raise self._error('it has no keyframe "home": add the pose that points the flange down above the scene')
        if any(body.gravcomp != 0.0 for body in spec.bodies):
            raise self._error("it compensates gravity by itself (gravcomp), and so does the controller: take it out")
        if fault := next(_faults_of_arm(spec), None):
            raise self._error(fault)

    def numbers(self, name: str, count: int) -> Array:
        """So many finite numbers; one for each joint may be one for all."""
        if name not in self._numerics:
            raise self._error(f'it has no <numeric name="{name}"> in <custom>: see the descriptions of the package')
        data = self._numerics[name]
        if data.size == 1 and count == self._joints:
            data = np.full(count, data[0])
        if not np.isfinite(data).all():
            raise self._error(f"its numeric {name} is {_shown(data)}, and has to be finite")
        if data.size != count:
            raise self._error(f"its numeric {name} has {data.size} numbers, and has to have {count}")
        if name in ABOVE_ZERO and data.min() <= 0.0:
            raise self._error(f"its numeric {name} is {_shown(data)}, and each number has to be above 0")
        if name in NOT_NEGATIVE and data.min() < 0.0:
            raise self._error(f"its numeric {name} is {_shown(data)}, and no number may be below 0")
        if name == "reach" and (data[:3] >= data[3:]).any():
            raise self._error(f"its numeric reach is {_shown(data)}: the lowest x, y, z have to be below the highest")
        return data

    def number(self, name: str) -> float:
        """One finite number above 0."""
        (value,) = self.numbers(name, 1).tolist()
        if value <= 0.0:
            raise self._error(f"its numeric {name} is {value:g}, and has to be above 0")
        return float(value)

    def text(self, name: str, choices: tuple[str, ...]) -> str:
        """One of these words."""
        if self._texts.get(name) not in choices:
            found = f'says "{self._texts[name]}"' if name in self._texts else "is not there"
            raise self._error(f"its text {name} {found}, and has to be one of: {', '.join(choices)}")
        return self._texts[name]


def _shown(data: Array) -> str:
    return " ".join([f"{value:g}" for value in data])


def _fault_of_file(path: Path) -> str:
    """What is wrong with a file, before MuJoCo, which would print some of it, reads it; "" for nothing."""
    write_no_log()
    if path.is_dir():
        return "is a folder, and has to be the MJCF file of an arm"
    if not path.exists():
        return "no such file"
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter two are of strange encodings
        return _fault_of_text(path, error)
    if root.tag == "robot":
        how = "let MuJoCo convert it (mujoco.MjSpec.from_file, then to_xml), and add what an arm of your own needs"
        return f"is a URDF (<robot>), and an arm is described in MJCF (<mujoco>): {how}"
    if root.tag != "mujoco":
        return f"its first element is <{root.tag}>, and that of MJCF, in which an arm is described, is <mujoco>"
    for element in root.iter():
        for name, text in element.items():
            if "nan" in text.lower().split():
                where = f'<{element.tag} name="{element.get("name", "")}">'
                return f'its {where} has {name}="{one_line(text)}", which is not finite: give numbers'
    return ""


def _fault_of_text(path: Path, error: Exception) -> str:
    """The same of a text that is no XML, by the place where it ends to be; MuJoCo reads some of these, too."""
    try:
        load_mujoco().MjSpec.from_file(str(path))
    except ValueError:
        return f"is no XML, or not the whole of it: {one_line(error)}"
    return ""


def _faults_of_arm(spec: Any) -> Iterator[str]:
    """Rules that an arm breaks whose sites, hinges and keyframe are there."""
    sites, bodies = ({one.name for one in every} for every in (spec.sites, spec.bodies))
    for kind, there, names in (("site", sites, PROBE_SITES), ("body", bodies, (PROBE_BODY,))):
        for name in sorted(there.intersection(names)):
            yield f'it has a {kind} "{name}", as the probe has that is put on its flange: give it another name'
    if spec.sensors:  # they would stand before the probe's, whose numbers are read by their order
        one = f'<{spec.sensors[0].type.name.removeprefix("mjSENS_").lower()} name="{spec.sensors[0].name}">'
        yield f"it has a sensor, {one}, and the probe that is put on its flange brings all that is read: take it out"
    model = spec.compile()
    yield from _faults_of_motors(model)
    yield from _faults_of_home(model)


def _faults_of_motors(model: Any) -> Iterator[str]:
    mujoco = load_mujoco()
    if strange := [number for number in range(model.nu) if model.actuator_trntype[number] != mujoco.mjtTrn.mjTRN_JOINT]:
        yield f'its actuator "{model.actuator(strange[0]).name}" moves no joint: an arm has one <motor> for each joint'
        return
    joints = [str(model.joint(number).name) for number in driven(model)]
    if twice := [joint for joint in joints if joints.count(joint) > 1]:
        yield f'its joint "{twice[0]}" has two actuators: an arm has one <motor> for each joint'
    kinds = (model.actuator_gaintype, model.actuator_biastype, model.actuator_dyntype)
    plain = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtDyn.mjDYN_NONE)
    for number, joint in enumerate(joints):
        same = all(kind[number] == wanted for kind, wanted in zip(kinds, plain, strict=True))
        gain, gear = model.actuator_gainprm[number, 0], model.actuator_gear[number, 0]
        if not (same and gain == gear == 1.0):
            yield f'its actuator of joint "{joint}" is no plain <motor> with gear 1: write one, for it is given torques'
        low, high = model.actuator_ctrlrange[number]
        if not 0.0 < high == -low:
            given = f"ctrlrange {low:g} {high:g}" if low or high else "no ctrlrange"
            yield f'its motor of joint "{joint}" has {given}: give its largest torque [N m], as in ctrlrange="-87 87"'


def _faults_of_home(model: Any) -> Iterator[str]:
    data = load_mujoco().MjData(model)
    data.qpos[:] = model.key("home").qpos
    for number in driven(model):
        name, (low, high), at = model.joint(number).name, model.jnt_range[number], data.qpos[number]
        if not low < high:
            yield f'its joint "{name}" has no range: give the lowest and the highest angle'
        if not low <= at <= high:
            yield f'its keyframe "home" has joint "{name}" at {at:.4g} rad, outside its range {low:.4g} to {high:.4g}'
    load_mujoco().mj_kinematics(model, data)
    leans = math.degrees(math.acos(min(max(-data.site(FLANGE).xmat[8], -1.0), 1.0)))  # its z against straight down
    if leans > UPRIGHT:
        yield (
            f'in its keyframe "home" the z axis of site "{FLANGE}" points {leans:.0f} degrees away from straight down, '
            f"and may by {UPRIGHT:g}: turn the site so that z points out of the flange, or change the pose"
        )
