"""A tick of `foretouch.rendering.renderer.Renderer` in one compiled call; `foretouch.rendering.tick` has its stages."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel, compiled, kernel
from foretouch.models import predictor_kernel as prediction
from foretouch.models.law_kernel import NOTHING
from foretouch.models.predictor_kernel import Prediction
from foretouch.models.scale_field_kernel import Scales, scale_at
from foretouch.quantities.pose import Vector
from foretouch.rendering import proxy, tick
from foretouch.rendering.energy import Account
from foretouch.rendering.surfaces.geometry import Triangle
from foretouch.rendering.surfaces.god_object import MESH, Mesh
from foretouch.rendering.surfaces.line import Coordinates, Line, Places, arrive, is_known, place_at
from foretouch.rendering.tick import FARTHEST, Rendering, Shown

Predicted = tuple[float, float, float, float]
"""Of a tick: velocity of the proxy [m/s], force of the model there, its change by a new model, and its standard
deviation [N]."""

Touched = tuple[Vector, float]
"""In space: place of the proxy on the normal [m], and local stiffness there [N/m], NaN without a model."""

Ticked: TypeAlias = tuple[float, Vector, Shown, tuple[float, float, float], Predicted, Touched]
"""The force for the hand along the normal and in all directions [N]; what is shown, booked, predicted and touched."""

Records: TypeAlias = tuple[NDArray[np.void], NDArray[np.void], NDArray[np.void]]
"""Arrays of one `Rendering`, one `Account` and one `Prediction`."""

Now = tuple[float, float, float, bool, bool]
"""Time of the tick [s]; that since the previous one as it began, and on the even grid of a simulated hand [s]; whether
the hand is uncoupled and given no force; whether something has to be done in Python before the tick."""

OverSurface: TypeAlias = tuple[
    NDArray[np.void], Mesh, Vector, Places, float, tuple[bool, bool], NDArray[np.void], float
]
"""What a hand in space is followed on: an array of one `Line`, shape, the device's position [m], places of the hand,
scale of its motion, whether it is known and somewhere; an array of one `Scales` of the material, and the offset that
the line had in the tick before [m]."""


@compiled
def engage(r: Rendering, p: Prediction, hand: float, position: float) -> None:
    """See `Renderer.engage`."""
    if abs(hand) <= FARTHEST:
        proxy.engage(r.proxy, hand, position)
        prediction.shift(p, position - p.position)


@compiled(error_model="numpy")
def render(
    r: Rendering,
    account: Account,
    p: Prediction,
    time: float,
    hand: float,
    period: float,
    free: bool,
    place: Vector,
    line: Line,
) -> Ticked:
    """One tick at a place [m], with a line that has followed it; see `whole`."""
    position, booked = tick.move(r, account, hand, place, period, free)
    if p.surface != r.surface and p.law.kind != NOTHING:
        prediction.shift(p, -tick.meet_surface(r, p.surface))
        position = r.proxy.position
    force = prediction.predict(p, time, position, math.nan)
    wanted, offset = tick.want(r, force, p.jump, p.velocity)
    scale, largest = r.setup.force_scale, r.limiter.largest_force
    work = way = 0.0
    if wanted > 0.0:
        work, way = prediction.leaving_work(p, offset / scale, largest / scale)
    velocity, depth = p.velocity, p.depth
    rendered, reach, back = tick.render(r, account, work, way, force, velocity, depth, period)
    if p.law.kind == NOTHING:
        back = tick.NOTHING_BACK
    if back == tick.BACK_IN_AIR:
        prediction.shift(p, proxy.return_freely(r.proxy, depth, r.setup.period))
    elif back == tick.BACK_IN_CONTACT:
        work, way = prediction.leaving_work(p, 0.0, largest / scale)
        stiffness = prediction.local_slopes(p, tick.SHORTEST_REACH)[0]
        prediction.shift(p, tick.return_in_contact(r, account, work, way, force, stiffness))
    stiffness = damping = 0.0
    if reach > 0.0:
        stiffness, damping = prediction.local_slopes(p, reach)
    shown = tick.carry(r, stiffness, damping, reach, force, depth)
    given, stiffness = tick.give(r, account, rendered, line, period), math.nan
    if is_known(line) and p.law.kind != NOTHING:
        stiffness = prediction.local_slopes(p, tick.SHOWN_REACH)[0]
    predicted = p.velocity, p.force, p.jump, p.standard_deviation
    return rendered, given, shown, booked, predicted, (place_at(line, r.proxy.position), stiffness)


RECORDS = "Tuple((Rendering[::1], Account[::1], Prediction[::1]))"


@kernel(f"({RECORDS}, f8, f8, f8, b1, Tuple((UniTuple(f8, 3), Line[::1])))")
def whole(
    records: Records, time: float, hand: float, period: float, free: bool, frame: tuple[Vector, NDArray[np.void]]
) -> Ticked:
    """One tick with a law that is compiled; see `Renderer.update`, which has the same stages for others."""
    (renderings, accounts, predictions), (place, lines) = records, frame
    return render(renderings[0], accounts[0], predictions[0], time, hand, period, free, place, lines[0])


@kernel(
    f"({RECORDS}, Tuple((Line[::1], {MESH}, UniTuple(f8, 3), UniTuple(UniTuple(f8, 3), 4), f8, UniTuple(b1, 2), "
    "Scales[::1], f8)), Tuple((f8, f8, f8, b1, b1)))",
    Triangle,
    Scales,
)
def whole_over_surface(records: Records, hand: OverSurface, now: Now) -> tuple[Coordinates, bool, Ticked]:
    """Follow a hand over a surface, and do the tick there, unless something waits for Python to do it first.

    That may be known before; or be that the line has another offset, for the surface let go over an edge. The material
    is as strong as at the hand's closest point.

    Returns:
        The hand's coordinates; whether the tick was done; what it is.
    """
    lines, mesh, position, places, scale, (known, somewhere), scales, offset = hand
    (renderings, accounts, predictions), (time, measured, even, free, waits) = records, now
    r, account, p, line = renderings[0], accounts[0], predictions[0], lines[0]
    coordinates, here = arrive(line, mesh, places, scale, known, somewhere), line.closest.inner_point
    if math.isfinite(here[0] + here[1]):
        value, variance = scale_at(scales[0], here[0], here[1])
        p.law.scale, p.law.doubt = math.exp(value), math.sqrt(variance)
    if waits or line.offset != offset:
        nothing = 0.0, 0.0, 0.0
        return coordinates, False, (0.0, nothing, tick.show(r), nothing, (0.0, 0.0, 0.0, 0.0), (nothing, 0.0))
    period = even if math.isfinite(coordinates[1]) else measured  # as the leader's step says
    return coordinates, True, render(r, account, p, time, coordinates[0], period, free, position, line)


engage_entry = Kernel(engage, "(Rendering, Prediction, f8, f8)")
