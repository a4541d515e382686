r"""The baselines: the one place where a delayed force is rendered, for comparison.

Nothing imports it but a session that asks for a baseline (`foretouch.session.runners.driven.LineLeader`).

- ``delayed``: the newest force that has arrived, times the force scale, and in contact a local damper,

  .. math:: f = \max(0,\; s_f F_{delayed} + B v), \quad B = 5\ \mathrm{N\,s/m}

  with v the velocity of the hand. Damping is what helped most at unchanged transparency: see `docs/baselines.md` for
  all that was tried.
- ``delayed-tdpa``: the same, and a time-domain passivity observer and controller at the leader's port
  (`foretouch.rendering.passivity_control`). It observes one port. The two-port form for delayed channels (Ryu, Artigas
  and Preusche 2010) sends the follower's observed energy along and keeps the channel passive by itself; the hand feels
  this port alone, and a controller here acts only where this port gives more than it got, so it is the milder of the
  two, and needs nothing of the other side.

In a scene that is the force along the normal of the surface under the hand; friction is not rendered.

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

from foretouch.devices import DeviceSpecification
from foretouch.models import MotionFilter
from foretouch.quantities.pose import scaled
from foretouch.rendering import Renderer, tick
from foretouch.rendering.passivity_control import PassivityController
from foretouch.rendering.renderer import ContactFrame, frame_of
from foretouch.rendering.surfaces.line import PLACE_AT
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.steps import leader
from foretouch.session.steps.axis import HandOnAxis
from foretouch.session.steps.delaying import LOCAL_DAMPING
from foretouch.session.steps.follower_view import FollowerView
from foretouch.settings import NO_GRIP


class DelayedForce(Renderer):
    """Renders the newest force that has arrived instead of a model; its account limits nothing and is for the record.

    Args:
        settings: Session settings.
        follower_view: Messages received from the follower.
        hand: The operator's hand.
    """

    def __init__(self, settings: SessionSettings, follower_view: FollowerView, hand: HandOnAxis) -> None:
        device = settings.device
        felt = None if settings.grip == NO_GRIP else device
        super().__init__(
            felt,
            position_scale=settings.position_scale,
            force_scale=settings.force_scale,
            sample_period=SAMPLE_PERIOD,
            account=leader.ACCOUNTS[hand.axes].of(felt, SAMPLE_PERIOD),
        )
        self._settings, self._follower_view = settings, follower_view
        # Passive rendering of a damper from samples requires b > |B|.
        self._controller = PassivityController(device.damping) if settings.baseline == "delayed-tdpa" else None
        self._hand_motion, self._proxy_motion = MotionFilter(), MotionFilter()

    def adopt(self, *_arrived: object, **_named: object) -> None:
        """Use no model, whichever comes."""

    def update(
        self, time: float, hand: float, period: float, *, free: bool = False, frame: ContactFrame | None = None
    ) -> float:
        """One tick; see `Renderer.update`."""
        place, lines = frame_of(hand) if frame is None else frame
        x, y, z = lines[0].closest.normal.tolist()
        proxy, account, follower_view = self.proxy, self.account, self._follower_view
        position, self.booked = tick.MOVE.entry(self._rendering[0], account.records[0], hand, place, period, free)
        self.predictor.velocity = self._proxy_motion.update(time, position)
        velocity = self._hand_motion.update(time, hand)
        # In free air the sensor shows noise, which the operator is not to feel.
        touching = follower_view.touching and follower_view.force > 0.0 and proxy.engaged
        wanted, ceiling = 0.0, math.inf
        if touching:
            wanted = max(self._settings.force_scale * follower_view.force + LOCAL_DAMPING * velocity, 0.0)
        if self._controller is not None:
            self._controller.observe(hand)
            controlled = self._controller.control(wanted, velocity, SAMPLE_PERIOD)
            if controlled < wanted:  # a reduction for passivity takes effect at once, whatever the rate
                ceiling = controlled
            wanted = controlled
        # A tick that came late is no reason for a larger step of force.
        rendered = self.limiter.update(wanted, min(period, SAMPLE_PERIOD), ceiling)
        if self._controller is not None:
            self._controller.hold(rendered, touching=touching)
        if not touching and rendered == 0.0:
            account.close()
        self.force = scaled((x, y, z), rendered)
        account.hold_force(self.force)
        self.shown = (proxy.position, proxy.engaged, self.limiter.clipped, wanted, 0.0, math.nan)
        self.touched = PLACE_AT.entry(lines[0], proxy.position), math.nan
        self.mediation.force = wanted
        self.predicted = (self.predictor.velocity, wanted / self._settings.force_scale, 0.0, math.nan)
        return rendered


def start(
    settings: SessionSettings,
    *,
    holder: str = "leader",
    epoch: int = 1,
    device: DeviceSpecification | None = None,
    hand: HandOnAxis | None = None,
) -> leader.State:
    """State before the first tick, as `foretouch.session.steps.leader.start`; no baseline has its own `device`."""
    view, hand = FollowerView(epoch), HandOnAxis() if hand is None else hand
    return leader.State(DelayedForce(settings, view, hand), settings.guards(), holder, view, hand)
