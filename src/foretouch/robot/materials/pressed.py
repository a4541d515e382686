"""Materials as one compiled record, for a robot without Python: the force of a probe that presses them, step by step.

Their equations are those of `foretouch.models.MemorylessLaw` and `foretouch.robot.materials.contacts`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.errors import SettingError
from foretouch.models import ContactModel, HuntCrossley, KelvinVoigt
from foretouch.models.contact_model import LARGEST_DEPTH
from foretouch.robot.materials.catalogue import ExponentialResponse, LinearResponse
from foretouch.robot.materials.contacts import HystereticContact, LayeredContact, RelaxingContact
from foretouch.robot.materials.kernels import layered_step, press_hysteretic
from foretouch.robot.materials.material import Material

POWERS, HYSTERETIC, LAYERED, LINEAR, EXPONENTIAL = range(5)
"""Kinds: a law of two powers; springs and branches; layers; and what relaxes, on a linear or an exponential spring."""

ROWS, VALUES = 16, 12  # Most rows of a table, and most numbers that a material remembers


class Pressed(Record):
    """A material and what it remembers."""

    kind: int
    numbers: Annotated[NDArray[Any], float, 4]  # of the law, or of the spring
    table: Annotated[NDArray[Any], float, (ROWS, 5)]
    rows: int  # of the table that are in use
    springs: int  # of them that are springs
    values: Annotated[NDArray[Any], float, VALUES]  # what it remembers


def make_pressed(material: Material, step: float) -> NDArray[Any]:
    """A material that nobody has touched, as an array of one record.

    Args:
        material: One whose law is `HuntCrossley`, `KelvinVoigt`, `HystereticContact`, `LayeredContact`, or
            `RelaxingContact` on a linear or exponential spring without flow.
        step: Time of each `press` [s].

    Raises:
        SettingError: Its law is another.
    """
    kind, numbers, table, springs = _form(material.model, step, material.name)
    made = Pressed.new(kind=kind, rows=len(table), springs=springs)
    made["numbers"][0, : len(numbers)] = numbers
    for row, values in enumerate(table):
        made["table"][0, row, : len(values)] = values
    return made


def _form(model: ContactModel, step: float, name: str) -> tuple[int, Any, Any, int]:
    """Kind, numbers, table, and how many of its rows are springs."""
    if isinstance(model, HuntCrossley | KelvinVoigt):
        return POWERS, model.general_form, (), 0
    if isinstance(model, HystereticContact):
        springs = [(*spring, math.inf, math.inf) for spring in model.springs]
        return HYSTERETIC, (), [*springs, *model.branches], len(springs)
    if isinstance(model, LayeredContact):
        return LAYERED, (1.0 / model.base_stiffness,), model.layers, 0
    if isinstance(model, RelaxingContact) and model.flow_force == math.inf:
        rates = [(math.exp(-step / time), -part * math.expm1(-step / time)) for part, time in model.relaxation]
        elastic = model.elastic
        if isinstance(elastic, LinearResponse):
            return LINEAR, (elastic.stiffness,), rates, 0
        if isinstance(elastic, ExponentialResponse):
            return EXPONENTIAL, (elastic.scale, elastic.growth, elastic.end), rates, 0
    raise SettingError("material", name, "has a law that is not compiled: foam-measured has one that is")


@compiled
def _response(p: Pressed, deflection: float) -> float:
    """Force of the spring [N]."""
    a, b, end = p.numbers[0], p.numbers[1], p.numbers[2]
    if p.kind == LINEAR:
        return float(a * deflection)
    if deflection <= end:
        return float(a * math.expm1(b * deflection))
    slope = a * math.exp(b * end)
    return float(slope - a + b * slope * (deflection - end))


@compiled
def _relax(p: Pressed, depth: float) -> float:
    """See `RelaxingContact.advance`."""
    stress, memory = p.values[0], 0.0
    for i in range(p.rows):
        p.values[i + 1] = p.table[i, 0] * p.values[i + 1] + p.table[i, 1] * stress
        memory += p.values[i + 1]
    after = max(memory, _response(p, depth)) if depth > 0.0 else memory
    p.values[0] = after
    return after - memory


@compiled
def press(p: Pressed, depth: float, velocity: float, h: float) -> float:
    """Force on a probe [N] at a depth [m] and a velocity [m/s], h seconds after the step before."""
    depth = min(depth, LARGEST_DEPTH)
    if p.kind == HYSTERETIC:
        return float(press_hysteretic(p.values[: 1 + p.rows - p.springs], depth, h, p.table[: p.rows], p.springs))
    if p.kind == LAYERED:
        v = p.values
        v[0], v[1], v[2], v[3] = layered_step((v[0], v[1], v[2], v[3]), depth, h, p.numbers[0], p.table)
        return float(v[0])
    if p.kind != POWERS:
        return _relax(p, depth)
    if depth <= 0.0:
        return 0.0
    a, b, c, d = p.numbers[0], p.numbers[1], p.numbers[2], p.numbers[3]
    force = depth**c * (a * depth**d + b * velocity)
    return float(force) if force > 0.0 else 0.0
