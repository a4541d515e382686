"""How certain the surface is where the probe comes, which the layer along the normal cannot know, compiled.

How much nearer or otherwise inclined it may be than believed follows from the covariance of the fixture's pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, compiled
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import Surface
from foretouch.rendering.surfaces.geometry import Array, Numbers3, norm, subtract, vector, write
from foretouch.rendering.surfaces.line import Line, just_touching_within, rotate_back
from foretouch.session.safety.kernel import Memory
from foretouch.session.spatial.proven_places import ProvenPlaces, be_at, forget_places


@compiled
def _height_variance(covariance: Array, normal: Vector, point: Vector) -> float:
    """J P J^T for J = (-n, n x q)."""
    (a, b, c), (x, y, z) = normal, point
    derivative = (-a, -b, -c, b * z - c * y, c * x - a * z, a * y - b * x)
    total = 0.0
    for row in range(6):
        for column in range(6):
            total += derivative[row] * covariance[row, column] * derivative[column]
    return total


@compiled
def _variances(covariance: Array, normal: Vector, point: Vector) -> tuple[float, float, float]:
    """Variances at a point q of a fixture, with a surface of normal n there.

    Returns:
        Variance of its height, of its position in all directions [m^2], and of the normal's inclination [rad^2].
    """
    position = _height_variance(covariance, (1.0, 0.0, 0.0), point)
    position += _height_variance(covariance, (0.0, 1.0, 0.0), point)
    position += _height_variance(covariance, (0.0, 0.0, 1.0), point)
    inclined = 0.0
    for row in range(3):
        inclined += covariance[3 + row, 3 + row]
        for column in range(3):
            inclined -= normal[row] * covariance[3 + row, 3 + column] * normal[column]
    return _height_variance(covariance, normal, point), position, inclined


FACTOR = 3.0  # Number of standard deviations taken as the largest error

SHARED = 5e-4
"""Error common to all touches, which their number does not reduce [m]: the onset of a contact is computed with one
exponent for all materials, which for a spring or Hertz's ball errs by up to 0.3 mm."""

LARGEST_UNCERTAINTY = 0.1  # Largest uncertainty of the surface that is assumed [m]

LARGEST_TURN, LEAST_TURN = 0.2, 0.1
"""Largest and least inclination assumed of a surface against its belief, and of a robot's motion against its command,
for the drives differ in delay [rad]."""

NUMBERS = 6
ROUNDING = 1e-12  # Rounding error of a sum of variances that may be zero [rad^2]


class PoseUncertainty(Record):
    r"""The uncertainty of a fixture's pose at a point of its surface.

    The pose's error on the right, of covariance P, changes the height of a point q over a surface of normal n by
    J = (-n, n x q) of it. So the surface may be nearer by

    .. math:: 3 \sqrt{J P J^T} + \min(3 \sigma \sin\alpha, h) + 0.5\ \mathrm{mm}

    which is small where it was touched, however little is known of the rest of the pose. The second term is for the
    normal, which changes where the surface is displaced along itself, with a standard deviation of sigma: alpha is the
    largest angle against the mean normal, and h the surface's relief. J is computed for n and for the mean normal, for
    beside the surface's edge they differ; the larger counts. The surface may be inclined otherwise by

    .. math:: 3 \sqrt{\mathrm{tr} P_\phi - n^T P_\phi n} + 2 \sin\alpha\, \min(3 \sigma \sin\alpha / h, 1)

    for a turn about the normal inclines nothing, and a displacement through the whole relief may exchange any two of
    its normals.
    """

    slope: float  # sine of alpha
    relief: float  # h [m]
    facing: Numbers3  # mean outward normal of the surface
    covariance: Annotated[Array, float, (NUMBERS, NUMBERS)]  # P [m, rad]
    known: bool  # whether there is one


def uncertainty_of(surface: Surface) -> NDArray[np.void]:
    """One `PoseUncertainty` of a surface in the fixture's frame; of its pose nothing is known yet."""
    slope, relief = surface.relief()
    return PoseUncertainty.new(slope=slope, relief=relief, facing=surface.facing())


def believe_covariance(poses: NDArray[np.void], covariance: Sequence[float]) -> None:
    """Take the covariance of the pose's error on the right [m, rad], 36 numbers; other lengths mean unknown."""
    known = len(covariance) == NUMBERS**2 and all(map(math.isfinite, covariance))
    poses["known"] = known
    if known:
        poses["covariance"] = np.reshape(covariance, (NUMBERS, NUMBERS))


@compiled(error_model="numpy")
def uncertainty_at(pose: PoseUncertainty, point: Vector, normal: Vector) -> tuple[float, float]:
    """Uncertainty at a point of the surface [m] with an outward normal, both in the fixture's frame.

    Returns:
        How much nearer [m] and otherwise inclined [rad] it may be; the largest where the pose is unknown.
    """
    height, position, turn = _variances(pose.covariance, normal, point)
    if pose.relief > 0.0:
        height = max(height, _height_variance(pose.covariance, vector(pose.facing), point))
    if not (pose.known and 0.0 <= height < math.inf and 0.0 <= position < math.inf and -ROUNDING <= turn < math.inf):
        return LARGEST_UNCERTAINTY, LARGEST_TURN  # not a covariance
    uneven = min(FACTOR * math.sqrt(max(position - height, 0.0)) * pose.slope, pose.relief)
    inclined = FACTOR * math.sqrt(max(turn, 0.0))
    if uneven > 0.0:
        inclined += 2.0 * pose.slope * uneven / pose.relief
    uncertainty = FACTOR * math.sqrt(height) + uneven + SHARED
    return min(uncertainty, LARGEST_UNCERTAINTY), min(max(inclined, LEAST_TURN), LARGEST_TURN)


SIDEWAYS_SHARE = 1.0 / 3.0
"""Least sliding speed along a surface of uncertain inclination, as a fraction of the robot's speed of approach."""

SLID = 2e-5
"""Displacement across the surface in a tick above which the probe has moved [m]: less is the encoders' noise."""

MISSED, MISSED_TICKS = 1e-3, 50
"""Depth below a surface [m] and number of ticks without force after which the surface is taken to be deeper."""


class WayIn(Record):
    """Informs the follower along the normal, which cannot know it, that the probe has come to another point.

    What the robot has proven of its approach holds about its present point once the surface was felt there, against its
    normal: air that was crossed beside an edge says nothing of what is beside it. It holds nearer to the surface by the
    uncertainty of the inclination, for every millimetre aside, by what the believed surface has come nearer since, and,
    where the probe comes back (`ProvenPlaces`), by the uncertainty of its height until it is felt again.

    Elsewhere the air counts as free up to the believed surface, less its uncertainty at this point (`PoseUncertainty`),
    once the surface was felt or seen; beyond that, and before, nothing is known. Where it was only felt, that grows by
    the uncertainty of the inclination with the distance from where it was felt last, for the pose fits touches
    that err. A surface that an image shows further away counts from the next image on, for one in a thousand errs by
    more than three standard deviations. In air that is not free, and in contact, motion along the surface counts as
    coming nearer, by the uncertainty of the inclination; its speed is limited to what the motion inwards and the force
    leave, and to no less than a third.

    A contact in air that counts as free, and a surface that is missed below where it may be, contradict the belief:
    then none of it counts until it includes a newer touch or image, and what was proven elsewhere is forgotten.
    """

    uncertainty: float = LARGEST_UNCERTAINTY  # of the surface at the newest point [m], until a tracker says otherwise
    turn: float = LARGEST_TURN  # uncertainty of its inclination there [rad]
    free: float = -math.inf  # position along the normal up to which the air counts as free [m]
    pose: PoseUncertainty
    believed: int  # number of touches and images in the belief
    images: int  # number of images
    before: float  # offset of the line before the newest image [m]
    then: int  # that number when something contradicted the belief
    contradicted: bool
    felt: bool  # whether there was contact in the tick before
    missed: int  # ticks without a force below the surface
    places: ProvenPlaces
    felt_at: Numbers3 = math.nan  # type: ignore[assignment]  # where it was felt last [m]
    point: Numbers3 = math.nan  # type: ignore[assignment]  # the newest [m]


class Known(NamedTuple):
    """What the follower along the normal knows when a tick begins."""

    surface: float  # where the surface was felt [m]; NaN before it was
    in_contact: bool  # whether the force along the normal that was learnt from is contact
    fastest: float  # largest speed along a surface that is felt, or far [m/s]
    good: bool  # whether the sensors are valid
    seen: bool  # whether a camera has shown the fixture
    follows: bool  # whether the robot follows the commands


@compiled
def _compare(way: WayIn, known: Known, depth: float) -> None:
    """Whether the force in the tick before, at a depth in the believed surface [m], contradicts the belief."""
    early = known.in_contact and not way.felt and depth < -way.uncertainty
    below = not known.in_contact and depth > way.uncertainty + MISSED and known.good
    way.felt = known.in_contact
    way.missed = way.missed + 1 if below else 0
    if early or way.missed >= MISSED_TICKS:
        way.contradicted, way.then = True, way.believed


@compiled
def come_to(way: WayIn, line: Line, memory: Memory, known: Known, explained: bool) -> float:
    """Take a new point of the surface, and whether its normal explains the force; the motion across it [m]."""
    closest, offset = line.closest, line.offset
    point = just_touching_within(line)  # as far over the surface as the probe moves
    way.uncertainty, way.turn = uncertainty_at(way.pose, point, rotate_back(line, vector(closest.normal)))
    _compare(way, known, closest.depth)
    if way.contradicted:
        way.uncertainty, way.turn = LARGEST_UNCERTAINTY, LARGEST_TURN
    if known.in_contact and explained:
        write(way.felt_at, point)
    if not known.seen:
        way.uncertainty += way.turn * norm(subtract(point, vector(way.felt_at)))
    # After it leaves a soft material, the probe meets it deeper again, though the surface is where it was believed.
    felt = math.isfinite(known.surface)
    nearest = min(offset, way.before) if known.seen else offset
    nearest = min(known.surface, nearest) if felt else nearest
    way.free = nearest - way.uncertainty if known.seen or felt else -math.inf
    slid = max(norm(subtract(point, vector(way.point))) - SLID, 0.0)  # NaN in the first tick
    write(way.point, point)
    places = way.places
    if way.contradicted:
        forget_places(places)
    aside = be_at(places, memory.way, point, offset)
    if known.in_contact and explained:
        places.touched, places.returned = True, False
    nearer = max(places.offset - offset, 0.0)
    if places.returned:
        nearer += way.uncertainty - SHARED
    memory.holds, memory.higher = places.touched, nearer + way.turn * (places.widest + aside)
    return float(slid)
