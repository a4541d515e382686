r"""The baselines' step: the one place where a delayed force is rendered, for comparison.

Nothing imports it but a session that asks for a baseline (`foretouch.session.runners.driven.leading_side`).

- ``delayed``: the newest force that has arrived, times the force scale, and in contact a local damper,

  .. math:: f = \max(0,\; s_f F_{delayed} + B v), \quad B = 5\ \mathrm{N\,s/m}

  with v the velocity of the hand. Damping is what helped most at unchanged transparency: see `docs/baselines.md` for
  all that was tried.
- ``delayed-tdpa``: the same, and a time-domain passivity observer and controller at the leader's port
  (`foretouch.rendering.passivity_control`). It observes one port. The two-port form for delayed channels (Ryu, Artigas
  and Preusche 2010) sends the follower's observed energy along and keeps the channel passive by itself; the hand feels
  this port alone, and a controller here acts only where this port gives more than it got, so it is the milder of the
  two, and needs nothing of the other side.

No model, no mediation, no index, and no ceiling: the limits of force, of its rate of rise, and of the device are as
for models; where no controller removes the force it falls no faster than it rises. The last force is held where none
arrives.

References:
    Ryu, Kwon and Hannaford (2004), Stable teleoperation with time-domain passivity control, IEEE Transactions on
    Robotics and Automation 20(2). Ryu, Artigas and Preusche (2010), A passive bilateral control scheme for a
    teleoperator with time-varying communication delay, Mechatronics 20(7).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from foretouch.devices import DeviceSpecification
from foretouch.messages import VERSION, Command, LeaderState
from foretouch.models import MotionFilter
from foretouch.rendering import LARGEST_FORCE, EnergyAccount, ForceLimiter, Proxy
from foretouch.rendering.passivity_control import PassivityController
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps.follower_view import FollowerView
from foretouch.session.steps.leader import Inputs, Outputs, meeting_place, moving_time
from foretouch.settings import NO_GRIP

LOCAL_DAMPING = 5.0
"""Damping of the local damper that is added to a delayed force, at the hand [N s/m]."""


@dataclass(slots=True)
class State:
    """State of a baseline, updated in place in each tick.

    Attributes:
        proxy: Couples hand and follower; it is never indexed.
        limiter: Force limits, as for models.
        account: Energy account, for the record: it limits nothing.
        controller: Passivity controller, None where there is none.
        settings: Session settings.
        holder: Name of this leader.
        epoch: Epoch of this process.
        follower_view: Messages received from the follower.
        start_ns: Clock at the first tick, None before it.
        newest_ns: Clock at the newest tick, None before the first.
        sequence: Sequence number of the newest command.
        refused: Always 0: models are not used.
        proxy_motion: Velocity of the proxy.
        hand_motion: Velocity of the hand.
    """

    proxy: Proxy
    limiter: ForceLimiter
    account: EnergyAccount
    controller: PassivityController | None
    settings: SessionSettings
    holder: str
    epoch: int
    follower_view: FollowerView
    start_ns: int | None = None
    newest_ns: int | None = None
    sequence: int = 0
    refused: int = 0
    proxy_motion: MotionFilter = field(default_factory=MotionFilter)
    hand_motion: MotionFilter = field(default_factory=MotionFilter)


def start(
    settings: SessionSettings, *, holder: str = "leader", epoch: int = 1, device: DeviceSpecification | None = None
) -> State:
    """State before the first tick, as `foretouch.session.steps.leader.start`; no baseline has its own `device`."""
    device = settings.device
    felt = settings.grip != NO_GRIP
    return State(
        Proxy(settings.position_scale),
        ForceLimiter(min(LARGEST_FORCE, device.force_limit) if felt else LARGEST_FORCE),
        EnergyAccount.of(device if felt else None, SAMPLE_PERIOD),
        # Passive rendering of a damper from samples requires b > |B|.
        PassivityController(device.damping) if settings.baseline == "delayed-tdpa" else None,
        settings,
        holder,
        epoch,
        FollowerView(epoch),
    )


def step(state: State, inputs: Inputs, now_ns: int) -> tuple[State, Outputs]:
    """One tick of a leader that renders the delayed force.

    Args:
        state: Updated in place and returned.
        inputs: Inputs of this tick.
        now_ns: This side's monotonic clock [ns].
    """
    if state.start_ns is None:
        state.start_ns = now_ns
    follower_view = state.follower_view
    for telemetry in inputs.telemetry:
        follower_view.take_telemetry(telemetry)
    for model in inputs.models:
        follower_view.is_for_us(model)  # counted, not used
    proxy, account, time = state.proxy, state.account, (now_ns - state.start_ns) * 1e-9
    account.observe(inputs.position, moving_time(inputs.period_ns, inputs.exact_position, now_ns, state.newest_ns))
    state.newest_ns = now_ns
    energy, energy_bound = account.energy, account.bound
    _couple(state, inputs)
    proxy.follow(inputs.position)
    velocity = state.proxy_motion.update(time, proxy.position)
    wanted = _render(state, inputs, state.hand_motion.update(time, inputs.position))
    rendered = state.limiter.force
    state.sequence += 1
    settings = state.settings
    command = Command(
        VERSION,
        state.sequence,
        now_ns,
        proxy.position,
        0,
        settings.guards(),
        state.holder,
        state.epoch,
        telemetry_sequence=follower_view.telemetry.newest,
        run=follower_view.run,
    )
    record = LeaderState(
        VERSION,
        state.sequence,
        now_ns,
        proxy.position,
        velocity,
        wanted / settings.force_scale,
        rendered,
        follower_view.force,
        follower_view.telemetry.newest,
        follower_view.models.newest,
        0.0,
        state.limiter.clipped,
        inputs.period_ns,
        inputs.compute_ns,
        math.nan,
        inputs.position,
        inputs.exact_position,
        inputs.intended_position,
        wanted,
        0.0,
        energy,
        energy_bound,
        math.nan,
        proxy.engaged,
        state.epoch,
        follower_view.run,
        account.late_energy,
    )
    return state, Outputs(command, record)


def _render(state: State, inputs: Inputs, velocity: float) -> float:
    """Set the limiter's force, which the hand gets; return the force wanted before the limits [N]."""
    follower_view = state.follower_view
    # In free air the sensor shows noise, which the operator is not to feel.
    touching = follower_view.touching and follower_view.force > 0.0 and state.proxy.engaged
    wanted = 0.0
    if touching:
        wanted = max(state.settings.force_scale * follower_view.force + LOCAL_DAMPING * velocity, 0.0)
    ceiling = math.inf
    if state.controller is not None:
        state.controller.observe(inputs.position)
        controlled = state.controller.control(wanted, velocity, SAMPLE_PERIOD)
        if controlled < wanted:  # a reduction for passivity takes effect at once, whatever the rate
            ceiling = controlled
        wanted = controlled
    # A tick that came late is no reason for a larger step of force.
    rendered = state.limiter.update(wanted, min(inputs.period_ns * 1e-9, SAMPLE_PERIOD), ceiling)
    if state.controller is not None:
        state.controller.hold(rendered, touching=touching)
    if not touching and rendered == 0.0:
        state.account.close()
    state.account.hold(rendered)
    return wanted


def _couple(state: State, inputs: Inputs) -> None:
    proxy, hand, follower_view = state.proxy, inputs.position, state.follower_view
    if inputs.stopping or follower_view.stopped or not follower_view.in_control or follower_view.take_renewed():
        proxy.leave()
        return
    if state.settings.grip == NO_GRIP:
        if not proxy.engaged and math.isfinite(hand):
            proxy.engage(hand)
        return
    place = meeting_place(proxy, hand, follower_view.position, clutched=inputs.clutched)
    if math.isfinite(place):
        proxy.engage(hand, place)
