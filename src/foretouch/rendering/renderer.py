"""From models and the hand's motion to the force that the hand is given."""

from __future__ import annotations

import math
from typing import Protocol

from foretouch.models import NO_STATE, ContactModel, ContactState, Predictor
from foretouch.models.checks import require
from foretouch.models.motion import VELOCITY_CUTOFF
from foretouch.rendering.energy import EnergyAccount
from foretouch.rendering.limits import LARGEST_FORCE, ForceLimiter
from foretouch.rendering.mediation import Mediation
from foretouch.rendering.proxy import RETURN_SPEED, Proxy

__all__ = ["Renderer", "RenderingDevice", "rendered_share"]

SAMPLE_PERIOD = 1e-3
"""Time for which a force is held where nothing else is said [s]."""

LARGEST_MOVE = 5e-4
"""A surface that is suddenly nearer to the hand by more than this [m] is met by the index; less, by mediation alone."""

FARTHEST = 10.0
"""No hand is further from its zero than this [m]."""

PHANTOM = 0.05
"""Contact is lost where neither the model asks for more nor more is rendered than this [N]: maps give some millinewtons
in the air, and people feel no less."""

CLEARANCE = 1e-3
"""In free air the proxy is brought back until it is so near to the surface [m]."""

SHORTEST_REACH = 3e-5
"""Local slopes are taken over at least so far [m], and over as far as the next tick may get."""

COUNT_FORCE = 0.1
"""One count of the encoder may change the force by so much [N] on a device without friction."""

YIELDING_RATE = 0.05
"""Share per tick in which the average of what the hand goes for one step of the proxy follows it."""

LARGEST_RETURN = 0.02
"""What is given back in contact changes the force by at most so much in a tick [N]."""


class RenderingDevice(Protocol):
    """What rendering has to know of a device that the hand feels."""

    @property
    def damping(self) -> float:
        """B [N s/m]."""

    @property
    def friction(self) -> float:
        """Coulomb friction [N]."""

    @property
    def force_limit(self) -> float:
        """[N]."""

    @property
    def resolution(self) -> float:
        """One count of the encoder [m]."""


def rendered_share(stiffness: float, rendered_damping: float, *, device_damping: float, sample_period: float) -> float:
    r"""Share rho of the hand's motion in which a device can carry a model.

    .. math:: \rho \left(\frac{K T}{2} + \max(\kappa B, -B)\right) \le b, \quad \rho \le 1, \quad
        \kappa = \frac{c}{2 - c}, \quad c = 1 - e^{-2 \pi f_c T}

    A proxy that takes part in the share rho of the motion is felt with rho K and rho B, so that the condition for
    passive rendering from samples holds. For a velocity that is the plain difference of two positions it is the
    well-known :math:`b > K T / 2 + |B|`. Ours goes through the low-pass of `MotionFilter`; the theorem holds for any
    transfer function H(z) of position to force,

    .. math:: b > \max_\omega \frac{T}{2} \frac{\mathrm{Re}\,(1 - e^{-j \omega T}) H(e^{j \omega T})}
        {1 - \cos \omega T}, \quad H = K + \frac{B}{T} \frac{c\,(1 - z^{-1})}{1 - (1 - c)\, z^{-1}}

    whose damping part is largest at half the sample rate for B > 0, where the low-pass leaves the share kappa of it (a
    quarter at 80 Hz and 1 kHz), and at rest for B < 0.

    Args:
        stiffness: K, local, at the hand [N/m], not negative.
        rendered_damping: B, local, at the hand [N s/m].
        device_damping: b [N s/m], not negative.
        sample_period: T [s].

    References:
        Colgate and Schenkel (1997), Passivity of a class of sampled-data systems: application to haptic interfaces,
        Journal of Robotic Systems 14(1).
    """
    gain = -math.expm1(-2.0 * math.pi * VELOCITY_CUTOFF * sample_period)
    needed = 0.5 * stiffness * sample_period + max(gain / (2.0 - gain) * rendered_damping, -rendered_damping)
    return min(1.0, device_damping / needed) if needed > 0.0 else 1.0


class Renderer:
    """Proxy, prediction, mediation, limits and energy account, in this order, once a tick.

    Args:
        device: That the hand holds and feels; None where nobody feels it (an open loop): then the proxy is coupled from
            the first tick on and the whole model is rendered.
        position_scale: Proxy's motion for the hand's, positive.
        force_scale: Hand's force for the model's, positive.
        largest_stiffness: Largest local stiffness at the hand [N/m]; 0 for what the device carries: `rendered_share`,
            and no more than K = 2 f / d for a Coulomb friction f and an encoder count d, within which friction takes
            what rounding gives (Abbott and Okamura 2005, Effects of position quantization and sampling rate on
            virtual-wall passivity, IEEE Transactions on Robotics 21(5)); f counts as at least 0.05 N.
        guarded: Whether a surface that turns up where the hand already is, is met by the index.
        sample_period: T [s].

    Attributes:
        predictor: Runs the newest model at the proxy.
        proxy: Where that is.
        mediation: Lets new models in.
        limiter: The clamps.
        account: Of the energy.
        share: rho, of the hand's motion from now to the next tick.
        energy: Of the account at the newest tick [J], before its force acts.
        energy_bound: Of the account then [J].

    Raises:
        SettingError: A scale or stiffness out of range.
    """

    __slots__ = (
        "_device",
        "_force_scale",
        "_free",
        "_guarded",
        "_period",
        "_position_scale",
        "_stiffest",
        "_surface",
        "_time",
        "_was_engaged",
        "_yielding",
        "account",
        "energy",
        "energy_bound",
        "limiter",
        "mediation",
        "predictor",
        "proxy",
        "share",
    )

    def __init__(
        self,
        device: RenderingDevice | None = None,
        *,
        position_scale: float = 1.0,
        force_scale: float = 1.0,
        largest_stiffness: float = 0.0,
        guarded: bool = False,
        sample_period: float = SAMPLE_PERIOD,
    ) -> None:
        require("force_scale", force_scale, above=0.0)
        require("largest_stiffness", largest_stiffness, at_least=0.0)
        require("sample_period", sample_period, above=0.0)
        self._stiffest = math.inf
        if device is not None:
            self._stiffest = min(largest_stiffness or math.inf, 2.0 * device.damping / sample_period)
            if device.resolution > 0.0:
                self._stiffest = min(self._stiffest, max(2.0 * device.friction, COUNT_FORCE) / device.resolution)
        self._device = device
        self._position_scale = position_scale
        self._force_scale = force_scale
        self._guarded = guarded
        self._period = sample_period
        self._surface = math.nan
        self._time = -math.inf
        self._was_engaged = False
        self.predictor = Predictor()
        self.proxy = Proxy(position_scale)
        self.mediation = Mediation()
        self.limiter = ForceLimiter(LARGEST_FORCE if device is None else min(LARGEST_FORCE, device.force_limit))
        self.account = EnergyAccount(0.0 if device is None else device.resolution)
        self.share = 1.0
        self._free = 0.0
        self._yielding = 1.0
        self.energy = self.energy_bound = 0.0

    def adopt(
        self,
        model: ContactModel | None,
        surface: float,
        state: ContactState = NO_STATE,
        tick: int | None = None,
        message: int = 0,
    ) -> None:
        """Render from this model from now on: see `Predictor.adopt`."""
        self.predictor.adopt(model, surface, state, tick, message)

    @property
    def closed_loop(self) -> bool:
        """Whether somebody feels the force."""
        return self._device is not None

    def engage(self, hand: float, position: float) -> None:
        """Couple the hand [m] with a follower that is at this position [m]: nothing jumps, whatever the two are.

        A hand that is nowhere (no number, or beyond 10 m) is not coupled.
        """
        if not abs(hand) <= FARTHEST:
            return
        self.proxy.engage(hand, position)
        self.predictor.shift(position - self.predictor.position)

    def update(self, time: float, hand: float, period: float) -> float:
        """One tick.

        Args:
            time: [s], later than at the tick before; otherwise nothing happens.
            hand: Position of the hand [m]; one that is no number, or none within 10 m, counts as not moved.
            period: Time since the tick before [s].

        Returns:
            The force for the hand [N].
        """
        proxy, predictor, account = self.proxy, self.predictor, self.account
        if not time > self._time:  # no time has passed: nothing to do
            return self.limiter.force
        self._time = time
        if not abs(hand) <= FARTHEST:
            hand = math.nan
        account.observe(hand)
        self.energy, self.energy_bound = account.energy, account.bound
        if self._device is None and math.isnan(proxy.position) and math.isfinite(hand):
            proxy.engage(hand)
        predictor.catch_up()
        position = proxy.follow(hand, self.share, self._free)
        if predictor.model is not None and predictor.surface != self._surface:
            self._meet_surface(predictor.surface)
            position = proxy.position
        predicted = predictor.update(time, position)
        wanted, jump = self._wanted(predicted)
        mediated = self.mediation.update(
            wanted,
            jump,
            period,
            energy=account.energy,
            bound=account.bound_with(wanted),
            exit_work=self._exit_work,
        )
        # A tick that came late is no reason for a larger step of force; nor is the limit of its rate one to push a hand
        # that leaves with more than there is.
        force = self.limiter.update(mediated, min(period, self._period), min(account.ceiling, mediated))
        if force <= PHANTOM and wanted <= PHANTOM:
            account.close()
        account.hold(force)
        self._give_back(wanted)
        self.share = self._carried()
        self._free = max(-predictor.depth, 0.0)
        self._yielding += YIELDING_RATE * (1.0 / max(self.share, 1e-3) - self._yielding)
        return force

    def _wanted(self, predicted: float) -> tuple[float, float]:
        """Force of the model for the hand within the limit [N], and what models or clutch changed of it now [N]."""
        engaged, was_engaged = self.proxy.engaged, self._was_engaged
        self._was_engaged = engaged
        # What is beyond the limit is never rendered: mediated, it would take minutes to come down.
        largest = self.limiter.largest_force
        force = min(self._force_scale * predicted, largest) if engaged else 0.0
        former = min(self._force_scale * (predicted - self.predictor.jump), largest) if was_engaged else 0.0
        return force, force - former

    def _meet_surface(self, surface: float) -> None:
        """A surface has come [m]: the proxy stays as deep as it was when the last one was there.

        Where it is further from the hand than before, that is what was indexed at most.
        """
        before, self._surface = self._surface, surface
        proxy = self.proxy
        if not self._guarded or not proxy.engaged:
            return
        depth = 0.0 if math.isnan(before) else max(proxy.position - before, 0.0)
        nearer = max(proxy.position - surface - depth, -proxy.indexed)
        if abs(nearer) > LARGEST_MOVE:
            proxy.index(nearer)
            self.predictor.shift(-nearer)

    def _exit_work(self, offset: float) -> tuple[float, float]:
        """What the model with an offset [N] gives the hand back on the hand's way out [J], and that way [m].

        Where the proxy yielded the hand has the longer way, under the same force, which is less than it is: yielding is
        at the top of the way. But no force falls more steeply than at the stiffest K that is rendered, and gives back
        F^2 / 2 K at least.
        """
        scale = self._force_scale
        work, way = self.predictor.exit_work(offset / scale, self.limiter.largest_force / scale)
        if not way > 0.0:
            return 0.0, 0.0
        force = max(min(self.predictor.force, self.limiter.largest_force / scale) + offset / scale, 0.0)
        mean, top = 1.0 + self.proxy.yielded / way, self._yielding
        if top > mean and work > 0.0:
            steepness = max(force * way / work - 1.0, 0.0)
            mean += (top - mean) * steepness / (steepness + 2.0)
        work *= scale * mean / self._position_scale
        if self._stiffest > 0.0:
            work = max(work, 0.5 * (scale * force) ** 2 / self._stiffest)
        return work, (way + self.proxy.yielded) / self._position_scale

    def _give_back(self, wanted: float) -> None:
        """Bring the proxy back: freely in free air, as dissipation pays in contact."""
        proxy, predictor = self.proxy, self.predictor
        if not proxy.engaged or predictor.model is None or proxy.apart == 0.0:
            return
        step = RETURN_SPEED * self._period
        if wanted <= PHANTOM and predictor.depth < 0.0:
            room = -CLEARANCE - predictor.depth if proxy.apart > 0.0 else math.inf
            self._return(min(max(room, 0.0), step), yielded=True)
            return
        if not proxy.indexed > 0.0 or self.mediation.offset < 0.0 or not wanted > 0.0:
            return
        # The surface moves out against the force: that is the work of it, on the proxy's way.
        paid = max(self.account.energy - self._exit_work(0.0)[0], 0.0) * self._position_scale / wanted
        stiffness = self._force_scale * predictor.local_slopes(SHORTEST_REACH)[0]
        gentle = LARGEST_RETURN / stiffness if stiffness > 0.0 else step
        self._return(min(step, paid, gentle), yielded=False)

    def _return(self, distance: float, *, yielded: bool) -> None:
        """Give back so much [m]; it is no motion of the hand, and no damping answers it."""
        before = self.proxy.position
        self.proxy.give_back(distance, yielded=yielded)
        self.predictor.shift(self.proxy.position - before)

    def _carried(self) -> float:
        """Share of the hand's motion in which the device carries the model from here to the next tick."""
        device, predictor = self._device, self.predictor
        if device is None or predictor.model is None or not self.proxy.engaged:
            return 1.0
        reach = max(SHORTEST_REACH, 1.5 * abs(predictor.velocity) * self._period)
        if predictor.depth < -2.0 * reach:
            return 1.0
        stiffness, damping = predictor.local_slopes(reach)
        scale = self._force_scale * self._position_scale
        stiffness, damping = scale * stiffness, scale * damping
        share = rendered_share(stiffness, damping, device_damping=device.damping, sample_period=self._period)
        return min(share, self._stiffest / stiffness) if stiffness > 0.0 else share
