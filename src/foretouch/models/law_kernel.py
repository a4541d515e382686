"""Every law that a message may name, as one record, compiled: force, local slopes, and work to leave contact.

The equations are those of `foretouch.models.MemorylessLaw`, `foretouch.models.LinearisedContinuousSwitching` and
`foretouch.models.ContactMapModel`, and the numbers the same to the last bit.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled, kernel
from foretouch.core.compiling import inlined
from foretouch.models.classic import ContinuousSwitching, HuntCrossley, KelvinVoigt, ThresholdSwitching
from foretouch.models.contact_map import kernel as contact_map
from foretouch.models.contact_map.kernel import Memory
from foretouch.models.contact_map.layout import Map
from foretouch.models.contact_map.model import ContactMapModel
from foretouch.models.contact_model import (
    LARGEST_DEPTH,
    LARGEST_SPEED,
    SLICE_BEYOND,
    SLICES,
    SLICES_BEYOND,
    SPEED_STEP,
    ContactModel,
)
from foretouch.models.laws import LARGEST_PARAMETER
from foretouch.models.memoryless_law import LARGEST_LOG_FORCE, SMALLEST_DEPTH, LinearisedContinuousSwitching

NOTHING, POWERS, LINEARISED, MAP = range(4)
"""Kinds of laws: none, those of equation (4), the one of (18), a contact map."""

KINDS: dict[type[ContactModel], int] = {
    KelvinVoigt: POWERS,
    HuntCrossley: POWERS,
    ThresholdSwitching: POWERS,
    ContinuousSwitching: POWERS,
    LinearisedContinuousSwitching: LINEARISED,
    ContactMapModel: MAP,
}
"""Classes that are compiled; one derived from them may have another force, and is not."""


class Law(Record):
    """A law and its numbers, and how strong the material is at the place that is touched."""

    kind: int
    scale: float = 1.0  # its force is multiplied by this
    doubt: float  # standard deviation of that, relative to it
    numbers: Annotated[NDArray[Any], float, 4]  # of equation (4) or (18)
    map: Map


NO_NUMBERS, NO_MAP = (0.0, 0.0, 0.0, 0.0), Map.new()

Form = tuple[int, tuple[float, float, float, float], NDArray[np.void]]
"""Kind and numbers of a law, and an array of one `Map`."""


def form_of(model: ContactModel | None) -> Form:
    """Kind and numbers of a model's law, and its map; those of no law where it is not compiled."""
    kind = KINDS.get(type(model), NOTHING)  # type: ignore[arg-type]
    if isinstance(model, ContactMapModel) and kind == MAP:
        return kind, NO_NUMBERS, model.record
    if model is None or kind == NOTHING:
        return NOTHING, NO_NUMBERS, NO_MAP
    a, b, *more = getattr(model, "general_form", model.parameters)
    c, d = (*more, 0.0)[:2]
    return kind, (a, b, c, d), NO_MAP


PARAMETERS = 6  # Most parameters of a law
LAW_NAMES = tuple(law.law for law in KINDS)
COUNTS = np.array([len(law.parameter_names) for law in KINDS])
POSITIVE = np.zeros((len(KINDS), PARAMETERS), np.bool_)
for _place_of_law, _law in enumerate(KINDS):
    for _index, _name in enumerate(_law.parameter_names):
        POSITIVE[_place_of_law, _index] = _name in getattr(_law, "positive", ())

Six = tuple[float, float, float, float, float, float]

_kelvin_voigt, _hunt_crossley = compiled(KelvinVoigt.in_general), compiled(HuntCrossley.in_general)
_threshold, _continuous = compiled(ThresholdSwitching.in_general), compiled(ContinuousSwitching.in_general)


_ORDER = list(KINDS)
AT_KELVIN_VOIGT, AT_HUNT_CROSSLEY = _ORDER.index(KelvinVoigt), _ORDER.index(HuntCrossley)
AT_THRESHOLD, AT_CONTINUOUS = _ORDER.index(ThresholdSwitching), _ORDER.index(ContinuousSwitching)
AT_LINEARISED, AT_MAP = _ORDER.index(LinearisedContinuousSwitching), _ORDER.index(ContactMapModel)


@compiled
def _in_range(law: int, parameters: Six) -> bool:
    """Whether a law's class takes these parameters."""
    good = True
    for index in range(COUNTS[law]):
        value = parameters[index]
        signed = value > 0.0 if POSITIVE[law, index] else value >= 0.0
        good = good and abs(value) <= LARGEST_PARAMETER and (signed or law == AT_LINEARISED)
    return bool(good and not (law == AT_CONTINUOUS and parameters[2] + parameters[3] == 0.0))


@kernel("Tuple((b1, i8, UniTuple(f8, 4)))(i8, UniTuple(f8, 6), i8)")
def form_of_wire(law: int, parameters: Six, count: int) -> tuple[bool, int, tuple[float, float, float, float]]:
    """What `foretouch.models.make_model` makes of a law on the wire, beside a map.

    Args:
        law: Place of its name in `LAW_NAMES`.
        parameters: Its parameters, and any numbers after them.
        count: How many there are.

    Returns:
        Whether there is such a law with such parameters; its kind; and its numbers.
    """
    a, b, c, d, _, _ = parameters
    numbers = a, b, c, d
    if not (0 <= law < len(COUNTS) and count == COUNTS[law] and _in_range(law, parameters)):
        return False, NOTHING, NO_NUMBERS
    if law == AT_MAP:
        return True, MAP, NO_NUMBERS
    if law == AT_LINEARISED:
        return True, LINEARISED, numbers
    if law == AT_KELVIN_VOIGT:
        numbers = _kelvin_voigt(parameters)
    elif law == AT_HUNT_CROSSLEY:
        numbers = _hunt_crossley(parameters)
    elif law == AT_THRESHOLD:
        numbers = _threshold(parameters)
    else:
        numbers = _continuous(parameters)
    return True, POWERS, numbers


@inlined
def _pressed(law: Law, depth: float, velocity: float) -> float:
    """Force of a law without memory [N]."""
    if depth <= 0.0:
        return 0.0
    a, b, c, d = law.numbers[0], law.numbers[1], law.numbers[2], law.numbers[3]
    if law.kind == POWERS:
        force = depth**c * (a * depth**d + b * velocity)
    elif law.kind == LINEARISED:
        x = max(depth, SMALLEST_DEPTH)
        log_force = a + b * math.log(x) + c * velocity + d * velocity / x
        force = math.exp(min(log_force, LARGEST_LOG_FORCE)) * (depth / x)
    else:
        force = 0.0
    return law.scale * force if force > 0.0 else 0.0


@compiled(error_model="numpy")
def advance(law: Law, memory: Memory, depth: float, velocity: float, period: float) -> tuple[Memory, float, float]:
    """`foretouch.models.advance`: memory after a sample, force and its standard deviation [N]."""
    if not (-LARGEST_DEPTH <= depth <= LARGEST_DEPTH and -LARGEST_SPEED <= velocity <= LARGEST_SPEED):
        depth = -LARGEST_DEPTH if math.isnan(depth) else min(max(depth, -LARGEST_DEPTH), LARGEST_DEPTH)
        velocity = 0.0 if math.isnan(velocity) else min(max(velocity, -LARGEST_SPEED), LARGEST_SPEED)
    if law.kind == MAP:
        memory, force, deviation = contact_map.advanced(law.map, memory, depth, velocity, period)
        return memory, law.scale * force, law.scale * math.hypot(deviation, law.doubt * force)
    return contact_map.UNTOUCHED, _pressed(law, depth, velocity), math.nan


@compiled(error_model="numpy")
def slopes(law: Law, memory: Memory, depth: float, velocity: float, reach: float) -> tuple[float, float]:
    """`ContactModel.local_slopes`: stiffness [N/m] and damping [N s/m]."""
    if law.kind == MAP:
        stiffness, damping = contact_map.slopes_at(law.map, memory, depth, velocity, reach)
        return law.scale * stiffness, law.scale * damping
    here = _pressed(law, depth, velocity)
    deeper, shallower = _pressed(law, depth + reach, velocity), _pressed(law, depth - reach, velocity)
    faster, slower = _pressed(law, depth, velocity + SPEED_STEP), _pressed(law, depth, velocity - SPEED_STEP)
    return max(abs(deeper - here), abs(here - shallower)) / reach, (faster - slower) / (2.0 * SPEED_STEP)


@compiled(error_model="numpy")
def leaving_work(law: Law, memory: Memory, depth: float, offset: float, largest: float) -> tuple[float, float]:
    """`ContactModel.leaving_work`: the work until contact is left [J], and the way [m]."""
    if law.kind == MAP:
        work, way = contact_map.work_at(law.map, memory, depth, offset / law.scale, largest / law.scale)
        return law.scale * work, way
    before = max(min(_pressed(law, depth, 0.0), largest) + offset, 0.0)
    energy = way = 0.0
    for beyond in (False, True):
        length = SLICE_BEYOND if beyond else depth / SLICES
        for _ in range(SLICES_BEYOND if beyond else SLICES):
            if not length > 0.0 or (beyond and not before > 0.0):
                break
            depth -= length
            after = max(min(_pressed(law, depth, 0.0), largest) + offset, 0.0)
            energy += 0.5 * (before + after) * length
            way += length
            before = after
    return energy, way
