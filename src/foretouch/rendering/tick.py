"""The stages of a tick of `foretouch.rendering.renderer.Renderer`, compiled.

The law is asked three times: for the force at the proxy, for the work until contact is left, and for its local slopes.
So a tick has the stages `move`, `want`, `render` and `carry`. `foretouch.rendering.whole` calls them with a law that is
compiled; a law in Python comes between them.
"""

from __future__ import annotations

import math

from foretouch.core import Kernel, Record, compiled, squared
from foretouch.quantities.pose import Vector
from foretouch.rendering import energy, mediation, proxy
from foretouch.rendering.energy import Account
from foretouch.rendering.friction import Friction, rub
from foretouch.rendering.limits import Limiter, carried, limit
from foretouch.rendering.mediation import LARGEST_STEP, MediationState, mediate
from foretouch.rendering.proxy import RETURN_SPEED, ProxyState
from foretouch.rendering.surfaces.geometry import add, norm, scaled, vector
from foretouch.rendering.surfaces.line import Line, just_touching

FARTHEST = 10.0  # Largest distance of a hand from its zero [m]

PHANTOM = 0.05
"""Force [N] below which, both wanted and rendered, contact is lost: maps give some millinewtons in the air, and people
feel no less."""

SHARE_RATE = 0.05
"""Fraction of the remaining way by which the rendered share of the motion rises in a tick; it falls at once. A share
that went up and down with every encoder count would be felt as chatter."""

SHARE_ROUNDING = 0.01  # Difference from the target below which the rendered share is set to it [-]

FORCE_IN_AIR = 0.3
"""Largest force [N] of a map in front of its surface that is limited by one encoder count alone, not by the damping of
the device: to yield all the way through the air costs more than so small a force can do."""

SHORTEST_REACH = 3e-5
"""Least distance over which local slopes are taken [m]; it is longer where the next tick may get further."""

SHOWN_REACH = 1e-4  # Interval over which the local stiffness is shown [m]
YIELDING_RATE = 0.05  # Weight of the newest tick in the average of the hand's motion per step of the proxy [-]
LARGEST_RETURN = 0.02  # Largest change of force in a tick by giving back in contact [N]
MISSING = 3  # Number of missing positions in a row from which on the position of the hand counts as unknown
FADING = 5  # Number of ticks in which the force then fades to zero: within 5 ms

MEDIATED_SHARE = 0.5
"""Fraction of the account's bound that mediation uses up; the rest is for what it cannot foresee, and for the first
tick of a new contact of a hand whose account is in debt."""


class Setup(Record):
    """What does not change in a session."""

    closed_loop: bool
    guarded: bool
    period: float  # T [s]
    position_scale: float
    force_scale: float
    stiffest: float = math.inf  # largest stiffness at the hand [N/m]
    device_damping: float  # b [N s/m]
    delay: float  # d [s]
    by_encoder: float = math.inf  # stiffness that one count of the encoder allows [N/m]
    gain: float  # c of the velocity's low-pass
    left: float  # kappa, the fraction of damping behind it that has to be carried


class Rendering(Record):
    """State of a `Renderer`."""

    setup: Setup
    friction: Friction
    surface: float = math.nan  # of the newest model [m]
    hand: float = math.nan  # newest valid position of the hand [m]
    there: bool  # whether there is one in this tick
    leaves: bool  # whether the hand moved outwards in this tick
    missing: int  # positions in a row
    was_felt: bool
    fades_from: float  # [N]
    wanted: float  # force of the model in this tick [N]
    jump: float  # its change by a new model [N]
    surplus: float  # its growth that a hand that leaves is not to feel [N]
    wanted_before: float  # [N]
    velocity: float  # of the proxy in the tick before [m/s]
    share: float = 1.0  # rho, share of the hand's motion that the proxy takes part in until the next tick
    free: float  # distance of the proxy to the surface [m]
    yielding: float = 1.0  # motion of the hand per step of the proxy, averaged
    proxy: ProxyState
    mediation: MediationState
    limiter: Limiter


Shown = tuple[float, bool, bool, float, float, float]
"""Of a tick: the proxy's position [m], whether it is engaged, whether a limit changed the force, mediated force and its
step by models [N], and the share of the motion until the next tick."""


@compiled
def show(r: Rendering) -> Shown:
    """What a `Renderer` shows of its newest tick."""
    let_in = r.mediation.force + r.mediation.pull
    return r.proxy.position, r.proxy.engaged, r.limiter.clipped, let_in, r.mediation.step, r.share


@compiled(error_model="numpy")
def move(
    r: Rendering, account: Account, hand: float, place: Vector, period: float, free: bool
) -> tuple[float, tuple[float, float, float]]:
    """Take the hand's position [m] after a time [s]: book its work at its place, and carry the proxy along.

    A hand that is `free` is uncoupled.

    Returns:
        Where the proxy is [m]; energy, its bound and late energy [J], before the force of this tick acts.
    """
    r.there = abs(hand) <= FARTHEST
    r.missing = 0 if r.there else r.missing + 1
    energy.observe(account, place[0], place[1], place[2], period)
    booked = account.energy, energy.bound_of(account), account.late_energy
    if free:
        proxy.leave(r.proxy)
    elif not r.setup.closed_loop and r.there and math.isnan(r.proxy.position):
        proxy.engage(r.proxy, hand, r.proxy.scale * hand)
    r.leaves = r.there and hand < r.hand
    if r.there:
        r.hand = hand
        proxy.follow(r.proxy, hand, r.share, r.free)
    return r.proxy.position, booked


@compiled(error_model="numpy")
def want(r: Rendering, predicted: float, jump: float, velocity: float) -> tuple[float, float]:
    """Take the force of the law at the proxy, its change by a new model [N], and the proxy's velocity [m/s].

    Returns:
        Force wanted for the hand, and the offset beside it with which it is let in [N].
    """
    felt, was_felt = r.proxy.engaged and r.missing < MISSING, r.was_felt
    r.was_felt = felt
    # Force beyond the limit is never rendered: mediated, it would take minutes to come down.
    largest = r.limiter.largest_force
    force = min(r.setup.force_scale * predicted if felt else 0.0, largest)
    # What pulls is paid as it is given: it needs no offset, and comes as fast as models may change a force.
    r.mediation.pull = min(max(force, r.limiter.least_force, r.mediation.pull - LARGEST_STEP), 0.0)
    wanted = max(force, 0.0)
    r.jump = 0.0
    if jump != 0.0 or felt != was_felt:  # a new model, the clutch, or a hand that is lost or seen again
        before = min(r.setup.force_scale * (predicted - jump), largest) if was_felt else 0.0
        r.jump = wanted - max(before, 0.0)
    r.wanted = wanted
    r.surplus = _surplus(r, wanted - r.jump, velocity) if r.leaves and r.setup.closed_loop else 0.0
    return wanted, r.mediation.offset - r.jump - r.surplus


@compiled
def _surplus(r: Rendering, force: float, velocity: float) -> float:
    """Growth of a force [N] while the hand leaves, beyond b times the change of its velocity [N].

    A spring's force never grows there, and a damper's only by its former decrease; with negative
    damping it does, the faster the hand leaves; without yielding the share of the motion cannot bound it.
    """
    grown = force - r.wanted_before
    if not grown > 0.0:
        return 0.0
    return float(max(grown - r.setup.device_damping * (abs(velocity - r.velocity) / r.setup.position_scale), 0.0))


@compiled
def _leaving_work(r: Rendering, work: float, way: float, offset: float, force: float) -> tuple[float, float]:
    """Work of the model with an offset [N] on the hand until it leaves contact [J], and the distance to there [m].

    Work and way are those of the model, whose force is given. Where the proxy yielded the hand has the longer way,
    under the same force, which underestimates the work: yielding happens at the top of the way. But no force falls more
    steeply than at the stiffest K that is rendered, and gives back F^2 / 2 K at least.
    """
    if not way > 0.0:
        return 0.0, 0.0
    scale, yielded = r.setup.force_scale, r.proxy.yielded
    force = max(min(force, r.limiter.largest_force / scale) + offset / scale, 0.0)
    mean, top = 1.0 + yielded / way, r.yielding
    if top > mean and work > 0.0:
        steepness = max(force * way / work - 1.0, 0.0)
        mean += (top - mean) * steepness / (steepness + 2.0)
    work *= scale * mean / r.setup.position_scale
    if r.setup.stiffest > 0.0:
        least = 0.5 * squared(scale * force) / r.setup.stiffest
        work = least if least > work else work
    return work, (way + yielded) / r.setup.position_scale


@compiled
def _fade(r: Rendering) -> float:
    """Largest force while the position of the hand is missing [N]."""
    if r.missing < MISSING:
        r.fades_from = abs(r.limiter.force)
        return math.inf
    return float(r.fades_from * max(1.0 - (r.missing - MISSING + 1) / FADING, 0.0))


NOTHING_BACK, BACK_IN_AIR, BACK_IN_CONTACT = range(3)
"""How the proxy is brought back to the hand after a tick."""


@compiled
def _way_back(r: Rendering, depth: float) -> int:
    if not r.proxy.engaged or (r.proxy.indexed == 0.0 and r.proxy.yielded == 0.0):
        return NOTHING_BACK
    if r.wanted <= PHANTOM and r.mediation.pull == 0.0 and depth < 0.0:
        return BACK_IN_AIR
    paid = r.proxy.indexed > 0.0 and not r.mediation.offset < 0.0 and r.wanted > 0.0
    return BACK_IN_CONTACT if paid else NOTHING_BACK


@compiled(error_model="numpy")
def render(
    r: Rendering, account: Account, work: float, way: float, force: float, velocity: float, depth: float, period: float
) -> tuple[float, float, int]:
    """Let the law in, with its work until it leaves contact [J] over a way [m], its force, velocity and depth.

    Returns:
        The force for the hand [N]; the reach over which the law's slopes are needed [m], 0 where they are not; and how
        the proxy is brought back.
    """
    wanted = r.wanted
    if wanted > 0.0:
        work, way = _leaving_work(r, work, way, r.mediation.offset - r.jump - r.surplus, force)
    bound = MEDIATED_SHARE * energy.bound_with(account, wanted)
    leaves = r.leaves and r.setup.closed_loop
    mediated = mediate(r.mediation, wanted, r.jump, period, leaves, r.surplus, account.energy, bound, work, way)
    # A late tick is no reason for a larger step of force; nor may the limit of its rate push a hand that leaves
    # with more force than the model has.
    ceiling, pull = min(energy.ceiling_of(account), _fade(r)), r.mediation.pull
    if not r.leaves:  # a hand that is drawn in has paid for it before: no debt is made for a pull
        pull = max(pull, -max(account.energy, 0.0) / account.largest_step)
    held, given = period if period < r.setup.period else r.setup.period, mediated + pull
    rendered = limit(r.limiter, given, held, min(max(given, 0.0), ceiling), max(min(given, 0.0), -ceiling))
    mediation.wind_down(r.mediation, rendered - pull)
    r.mediation.pull = pull = min(max(pull, rendered - mediated), 0.0)  # what was cut comes back as it came
    if r.there and abs(rendered) <= PHANTOM and wanted - pull <= PHANTOM:  # unknown while the hand is missing
        energy.close(account)
        r.mediation.lowest = account.energy
    r.wanted_before, r.velocity = wanted, velocity
    reach = max(1.5 * abs(velocity) * r.setup.period, SHORTEST_REACH)
    if not (r.setup.closed_loop and r.proxy.engaged) or (
        depth < -2.0 * reach and not abs(r.setup.force_scale * force) > 0.0
    ):
        reach = 0.0
    return rendered, reach, _way_back(r, depth)


@compiled(error_model="numpy")
def return_in_contact(r: Rendering, account: Account, work: float, way: float, force: float, stiffness: float) -> float:
    """Bring the proxy back as far as dissipation pays for it; how far it moved [m].

    The surface moves out against the force: its work is that force over the proxy's way.
    """
    step = RETURN_SPEED * r.setup.period
    stored = _leaving_work(r, work, way, 0.0, force)[0]
    paid = max(account.energy - stored, 0.0) * r.setup.position_scale / r.wanted
    stiffness = r.setup.force_scale * stiffness
    gentle = LARGEST_RETURN / stiffness if stiffness > 0.0 else step
    return proxy.give_back(r.proxy, min(step, paid, gentle), False)


@compiled
def _carried(r: Rendering, stiffness: float, damping: float, reach: float, force: float, depth: float) -> float:
    """Share of the hand's motion at which the device can carry the model until the next tick."""
    if not reach > 0.0:
        return 1.0
    s = r.setup
    outside, force = depth < -2.0 * reach, s.force_scale * abs(force)
    scale = s.force_scale * s.position_scale
    stiffness, damping = scale * stiffness, scale * damping
    light = outside and force <= FORCE_IN_AIR
    device_damping = math.inf if light else s.device_damping
    fraction = carried(stiffness, damping, (device_damping, s.period, s.delay, s.by_encoder, s.gain, s.left))
    return fraction if light or not stiffness > 0.0 else min(s.stiffest / stiffness, fraction)


@compiled(error_model="numpy")
def carry(r: Rendering, stiffness: float, damping: float, reach: float, force: float, depth: float) -> Shown:
    """Set the share of the hand's motion that the proxy takes part in until the next tick, by the law's slopes."""
    if not r.setup.closed_loop:
        return show(r)
    target, fraction = _carried(r, stiffness, damping, reach, force, depth), r.share
    if fraction == target == r.yielding == 1.0:  # in free air, and on soft material
        r.free = 0.0
        return show(r)
    risen = fraction + SHARE_RATE * (target - fraction)
    r.share = fraction = risen if risen < target - SHARE_ROUNDING else target
    r.free = 0.0 if abs(force) > 0.0 else max(-depth, 0.0)
    r.yielding += YIELDING_RATE * (1.0 / max(fraction, 1e-3) - r.yielding)
    return show(r)


@compiled(error_model="numpy")
def give(r: Rendering, account: Account, rendered: float, line: Line, period: float) -> Vector:
    """Force for the hand in all directions [N]: along the normal, and friction, within the limits of device and energy.

    Args:
        r: The state.
        account: The energy account, which holds the force from now on.
        rendered: Along the normal [N].
        line: Has followed the hand.
        period: Time since the previous tick [s].
    """
    scale, held = r.setup.force_scale, min(period, r.setup.period)
    normal, point = vector(line.closest.normal), just_touching(line)
    beside = scaled(rub(r.friction, point, normal, rendered / scale, held), scale)
    # Friction takes what the normal force leaves: cut together, the latter would come back faster than its rate allows.
    largest = min(r.limiter.largest_force, energy.ceiling_of(account))
    left = math.sqrt(max(squared(largest) - squared(rendered), 0.0))
    size = norm(beside)
    if size > left:
        beside = scaled(beside, left / size)
    return energy.hold_within(account, add(scaled(normal, rendered), beside))


@compiled
def meet_surface(r: Rendering, surface: float) -> float:
    """Take a new surface [m], which a guarded proxy meets; how far it moved outwards [m]."""
    before, r.surface = r.surface, surface
    return proxy.meet(r.proxy, before, surface) if r.setup.guarded and r.proxy.engaged else 0.0


MOVE = Kernel(move, "(Rendering, Account, f8, UniTuple(f8, 3), f8, b1)")
WANT = Kernel(want, "(Rendering, f8, f8, f8)")
RENDER = Kernel(render, "(Rendering, Account, f8, f8, f8, f8, f8, f8)")
CARRY = Kernel(carry, "(Rendering, f8, f8, f8, f8, f8)")
GIVE = Kernel(give, "(Rendering, Account, f8, Line, f8)")
MEET_SURFACE = Kernel(meet_surface, "(Rendering, f8)")
RETURN_IN_CONTACT = Kernel(return_in_contact, "(Rendering, Account, f8, f8, f8, f8)")
"""For a law in Python."""
