"""From models and the hand's motion to the force that the hand is given."""

from __future__ import annotations

import math

from foretouch.errors.checks import require, require_type
from foretouch.models import NO_STATE, ContactModel, ContactState, Predictor
from foretouch.quantities import brief_number, brief_text
from foretouch.rendering.energy import SAMPLE_PERIOD, EnergyAccount, RenderingAccount, RenderingDevice
from foretouch.rendering.limits import LARGEST_FORCE, ForceLimiter, rendered_share
from foretouch.rendering.mediation import Mediation
from foretouch.rendering.proxy import RETURN_SPEED, Proxy

LARGEST_MOVE = 5e-4
"""A surface that is suddenly nearer to the hand by more than this [m] is met by the index; less, by mediation alone."""

FARTHEST = 10.0
"""No hand is further from its zero than this [m]."""

PHANTOM = 0.05
"""Contact is lost where neither the model asks for more nor more is rendered than this [N]: maps give some millinewtons
in the air, and people feel no less."""

SHARE_RATE = 0.05
"""The share of the motion that is carried falls at once, and rises by this part of the way in a tick: one that goes up
and down with every encoder count would be felt as chatter."""

SHARE_ROUNDING = 0.01
"""What is nearer to the share that is carried is that."""

FORCE_IN_AIR = 0.3
"""Before its surface a map may give so much [N] and is held to one encoder count alone, not to what the damping of the
device carries: to yield all the way through the air costs more than so small a force can do."""

CLEARANCE = 1e-3
"""In free air the proxy is brought back until it is so near to the surface [m]."""

SHORTEST_REACH = 3e-5
"""Local slopes are taken over at least so far [m], and over as far as the next tick may get."""

YIELDING_RATE = 0.05
"""Share per tick in which the average of what the hand goes for one step of the proxy follows it."""

LARGEST_RETURN = 0.02
"""What is given back in contact changes the force by at most so much in a tick [N]."""

MISSING = 3
"""From so many positions on that are missing one after the other, nobody knows where the hand is."""

FADING = 5
"""The force then fades to nothing in so many ticks: within 5 ms."""

MEDIATED_SHARE = 0.5
"""Part of the account's bound that mediation uses up; the rest is for what it cannot foresee, and for the first tick of
a new contact of a hand that owes."""


class Renderer:
    """Proxy, prediction, mediation, limits and energy account, in this order, once a tick.

    Args:
        device: That the hand holds and feels; None where nobody feels it (an open loop): then the proxy is coupled from
            the first tick on and the whole model is rendered.
        position_scale: Proxy's motion for the hand's, positive.
        force_scale: Hand's force for the model's, positive.
        largest_stiffness: Largest local stiffness at the hand [N/m]; 0 for what the device carries: `rendered_share`,
            and no more than its `largest_stiffness` by damping and encoder.
        guarded: Whether a surface that turns up where the hand already is, is met by the index.
        sample_period: T [s].
        account: Of the energy; None for one along this line.

    Attributes:
        predictor: Runs the newest model at the proxy.
        proxy: Where that is.
        mediation: Lets new models in.
        limiter: The clamps.
        account: Of the energy.
        share: rho, of the hand's motion from now to the next tick.
        energy: Of the account at the newest tick [J], before its force acts.
        energy_bound: Of the account then [J].
        late_energy: Of the account then [J].

    Raises:
        SettingError: A scale or stiffness out of range.
        ArgumentTypeError: A device that is none.
    """

    __slots__ = (
        "_delay",
        "_device",
        "_device_damping",
        "_fades_from",
        "_force_scale",
        "_free",
        "_guarded",
        "_hand",
        "_missing",
        "_period",
        "_position_scale",
        "_stiffest",
        "_stiffest_by_encoder",
        "_surface",
        "_time",
        "_velocity",
        "_wanted_before",
        "_was_felt",
        "_yielding",
        "account",
        "energy",
        "energy_bound",
        "late_energy",
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
        account: RenderingAccount | None = None,
    ) -> None:
        wanted = "a DeviceSpecification, such as SessionSettings(...).device, or None for a force that no hand feels"
        require_type("device", device, (RenderingDevice, type(None)), wanted)
        require("force_scale", force_scale, above=0.0)
        require("largest_stiffness", largest_stiffness, at_least=0.0)
        require("sample_period", sample_period, above=0.0)
        self._stiffest = self._stiffest_by_encoder = math.inf
        self._device_damping = self._delay = 0.0
        if device is not None:
            self._stiffest = min(largest_stiffness or math.inf, device.largest_stiffness(sample_period))
            self._stiffest_by_encoder = device.stiffness_by_encoder
            self._device_damping, self._delay = device.damping, device.delay
        self._device = device
        self._position_scale = position_scale
        self._force_scale = force_scale
        self._guarded = guarded
        self._period = sample_period
        self._surface = math.nan
        self._time = -math.inf
        self._was_felt = False
        self._hand = math.nan
        self._missing = 0
        self._fades_from = 0.0
        self._wanted_before = self._velocity = 0.0
        self.predictor = Predictor()
        self.proxy = Proxy(position_scale)
        self.mediation = Mediation()
        self.limiter = ForceLimiter(LARGEST_FORCE if device is None else min(LARGEST_FORCE, device.force_limit))
        self.account = EnergyAccount.of(device, sample_period) if account is None else account
        self.share = 1.0
        self._free = 0.0
        self._yielding = 1.0
        self.energy = self.energy_bound = self.late_energy = 0.0

    def __repr__(self) -> str:
        """What predicts, and what the hand is given."""
        now = {"share": brief_number(self.share), "force": brief_number(self.limiter.force)}
        return brief_text("Renderer", {"predictor": self.predictor, "closed_loop": self.closed_loop, **now}.items())

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

    def update(self, time: float, hand: float, period: float, *, free: bool = False) -> float:
        """One tick.

        A position that is missing counts as not moved, and no force rises on it. From the third one after the other on
        the force fades within 5 ms, as nobody knows any more what it does; once the hand is seen again, the force comes
        back from nothing as a new model does.

        Args:
            time: [s], later than at the tick before; otherwise nothing happens.
            hand: Position of the hand [m]; one that is no number, or none within 10 m, is missing.
            period: Time since the tick before [s].
            free: Whether the hand is let go, from whatever it is coupled with, and given no force.

        Returns:
            The force for the hand [N].
        """
        proxy, predictor, account = self.proxy, self.predictor, self.account
        if not time > self._time:  # no time has passed: nothing to do
            return self.limiter.force
        self._time = time
        there = abs(hand) <= FARTHEST
        if not there:
            hand = math.nan
        self._missing = 0 if there else self._missing + 1
        account.observe(hand, period)
        self.energy, self.energy_bound, self.late_energy = account.energy, account.bound, account.late_energy
        if free:
            proxy.leave()
        elif self._device is None and there and math.isnan(proxy.position):
            proxy.engage(hand)
        predictor.catch_up()
        position = proxy.follow(hand, self.share, self._free)
        if predictor.model is not None and predictor.surface != self._surface:
            self._meet_surface(predictor.surface)
            position = proxy.position
        predicted = predictor.update(time, position)
        wanted, jump = self._wanted(predicted)
        leaving = self._device is not None and hand < self._hand
        mediated = self.mediation.update(
            wanted,
            jump,
            period,
            leaving=leaving,
            surplus=self._surplus(wanted - jump) if leaving else 0.0,
            energy=account.energy,
            bound=MEDIATED_SHARE * account.bound_with(wanted),
            exit_work=self._exit_work,
        )
        # A tick that came late is no reason for a larger step of force; nor is the limit of its rate one to push a hand
        # that leaves with more than there is.
        ceiling = min(account.ceiling, self._fade())
        held = period if period < self._period else self._period
        force = self.limiter.update(mediated, held, mediated if mediated < ceiling else ceiling)
        self.mediation.wind_down(force)
        if there and force <= PHANTOM and wanted <= PHANTOM:  # of a hand that is not seen nobody knows
            account.close()
            self.mediation.part(account.energy)
        account.hold(force)
        if proxy.indexed != 0.0 or proxy.yielded != 0.0:
            self._give_back(wanted)
        self._wanted_before, self._velocity = wanted, predictor.velocity
        if there:
            self._hand = hand
        if self._device is not None:
            self._carry()
        return force

    def _wanted(self, predicted: float) -> tuple[float, float]:
        """Force of the model for the hand within the limit [N], and what changed it now but motion [N].

        That is a model, the clutch, or a hand that is lost or found.
        """
        felt, was_felt = self.proxy.engaged and self._missing < MISSING, self._was_felt
        self._was_felt = felt
        # What is beyond the limit is never rendered: mediated, it would take minutes to come down.
        largest, jump = self.limiter.largest_force, self.predictor.jump
        force = self._force_scale * predicted if felt else 0.0
        force = force if force < largest else largest
        if jump == 0.0 and felt == was_felt:
            return force, 0.0
        former = min(self._force_scale * (predicted - jump), largest) if was_felt else 0.0
        return force, force - former

    def _fade(self) -> float:
        """Largest force for a hand that is not seen [N]."""
        if self._missing < MISSING:
            self._fades_from = self.limiter.force
            return math.inf
        return self._fades_from * max(1.0 - (self._missing - MISSING + 1) / FADING, 0.0)

    def _surplus(self, force: float) -> float:
        """What a force [N] has grown by, as the hand went out, beyond b times the change of its velocity [N].

        A spring never grows there, and a damper by what it was less than before; a model with negative damping does,
        the faster the hand leaves, and where nothing yielded the share of the motion cannot bound it.
        """
        grown = force - self._wanted_before
        if not grown > 0.0:
            return 0.0
        change = abs(self.predictor.velocity - self._velocity) / self._position_scale
        return max(grown - self._device_damping * change, 0.0)

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
        offset, largest, yielded = offset / scale, self.limiter.largest_force / scale, self.proxy.yielded
        work, way = self.predictor.exit_work(offset, largest)
        if not way > 0.0:
            return 0.0, 0.0
        force = self.predictor.force
        force = (force if force < largest else largest) + offset
        force = force if force > 0.0 else 0.0
        mean, top = 1.0 + yielded / way, self._yielding
        if top > mean and work > 0.0:
            steepness = max(force * way / work - 1.0, 0.0)
            mean += (top - mean) * steepness / (steepness + 2.0)
        work *= scale * mean / self._position_scale
        if self._stiffest > 0.0:
            least = 0.5 * (scale * force) ** 2 / self._stiffest
            work = least if least > work else work
        return work, (way + yielded) / self._position_scale

    def _give_back(self, wanted: float) -> None:
        """Bring the proxy back: freely in free air, as dissipation pays in contact."""
        proxy, predictor = self.proxy, self.predictor
        if not proxy.engaged or predictor.model is None:
            return
        step = RETURN_SPEED * self._period
        if wanted <= PHANTOM and predictor.depth < 0.0:
            self._return(min(max(-CLEARANCE - predictor.depth, 0.0), step), yielded=True)
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

    def _carry(self) -> None:
        """Set the share of the hand's motion that the proxy takes part in until the next tick."""
        predictor, carried, share = self.predictor, self._carried(), self.share
        if share == carried == self._yielding == 1.0:  # in free air, and on what is soft
            self._free = 0.0
            return
        risen = share + SHARE_RATE * (carried - share)
        self.share = share = risen if risen < carried - SHARE_ROUNDING else carried
        self._free = 0.0 if predictor.force > 0.0 else max(-predictor.depth, 0.0)
        self._yielding += YIELDING_RATE * (1.0 / max(share, 1e-3) - self._yielding)

    def _carried(self) -> float:
        """Share of the hand's motion in which the device carries the model from here to the next tick."""
        predictor = self.predictor
        if predictor.model is None or not self.proxy.engaged:
            return 1.0
        reach = 1.5 * abs(predictor.velocity) * self._period
        reach = reach if reach > SHORTEST_REACH else SHORTEST_REACH
        outside, force = predictor.depth < -2.0 * reach, self._force_scale * predictor.force
        if outside and not force > 0.0:
            return 1.0
        stiffness, damping = predictor.local_slopes(reach)
        scale = self._force_scale * self._position_scale
        stiffness, damping = scale * stiffness, scale * damping
        light = outside and force <= FORCE_IN_AIR
        share = rendered_share(
            stiffness,
            damping,
            device_damping=math.inf if light else self._device_damping,
            sample_period=self._period,
            delay=self._delay,
            stiffness_by_encoder=self._stiffest_by_encoder,
        )
        if light or not stiffness > 0.0:
            return share
        stiffest = self._stiffest / stiffness
        return stiffest if stiffest < share else share
