"""The baseline of a delayed force along a line, compiled: for pages and programs without Python, that show why not.

The step is that of `foretouch.session.steps.baseline.DelayedForce`, without its controller of passivity. As there, this
is for comparison, and nothing else renders a force that is late.
"""

from __future__ import annotations

import math

from foretouch.core import Record, kernel
from foretouch.models.predictor_kernel import Motion, move
from foretouch.rendering import energy
from foretouch.rendering.limits import limit
from foretouch.rendering.tick import FARTHEST
from foretouch.rendering.tick import move as take_hand
from foretouch.session.settings import SAMPLE_PERIOD
from foretouch.session.steps.leading import Leader, begin_tick, couple, decide

LOCAL_DAMPING = 5.0  # Damping of the local damper that is added to a delayed force, at the hand [N s/m]


class Delaying(Record):
    """Velocities of the hand and of what follows it."""

    hand: Motion
    proxy: Motion


@kernel("f8(Leader, Delaying, i8, f8, i8, b1, b1)")
def tick_delayed(
    leader: Leader, delaying: Delaying, now_ns: int, hand: float, period_ns: int, clutched: bool, stopping: bool
) -> float:
    """A tick along a line that renders the newest force that has arrived: see `foretouch.session.steps.leading.tick`.

    Args:
        leader: Written; see `Leader.shown`. Its model is adopted as ever, and no force comes of it.
        delaying: Written.
        now_ns: Time of this tick by a monotonic clock [ns].
        hand: Position of the operator's hand [m]; NaN where it is missing.
        period_ns: Time since the last tick really began [ns].
        clutched: Whether the clutch is pressed.
        stopping: Whether an emergency stop was requested here.

    Returns:
        The force for the hand [N].
    """
    time, period, _ = begin_tick(leader, now_ns, period_ns)
    free, couples = decide(leader, stopping, clutched)
    if couples:
        couple(leader, hand, clutched)
    leader.guarded = False  # it never reports a known surface, and a guard would last for ever
    shown = leader.shown
    if not time > leader.time:
        return float(shown.rendered_force)
    leader.time = time
    r, account, view = leader.renderings[0], leader.accounts[0], leader.views[0]
    r.share, r.free = 1.0, 0.0  # the proxy takes part in all of the motion, whatever a model before had it do
    at = hand if abs(hand) <= FARTHEST else math.nan
    position, booked = take_hand(r, account, hand, (at, 0.0, 0.0), period, free)
    shown.energy, shown.energy_bound, shown.late_energy = booked
    shown.velocity = move(delaying.proxy, time, position)
    velocity = move(delaying.hand, time, hand)
    touching = view.touching and view.force > 0.0 and r.proxy.engaged
    wanted = max(r.setup.force_scale * view.force + LOCAL_DAMPING * velocity, 0.0) if touching else 0.0
    rendered = limit(r.limiter, wanted, min(period, SAMPLE_PERIOD), math.inf, -math.inf)
    if not touching and rendered == 0.0:
        energy.close(account)
    energy.hold(account, -rendered, 0.0, 0.0)
    shown.rendered_force, shown.position, shown.engaged = rendered, r.proxy.position, r.proxy.engaged
    shown.clipped, shown.mediated_force, shown.predicted_force = r.limiter.clipped, wanted, wanted / r.setup.force_scale
    return float(rendered)
