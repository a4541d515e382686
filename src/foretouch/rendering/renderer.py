"""From models and the hand's motion to the force on the hand."""

from __future__ import annotations

import math

from foretouch.errors.checks import require, require_type
from foretouch.models import NO_STATE, ContactModel, ContactState, Predictor
from foretouch.quantities import brief_number, brief_text
from foretouch.rendering.energy import SAMPLE_PERIOD, EnergyAccount, RenderingDevice, SpatialEnergyAccount
from foretouch.rendering.limits import LARGEST_FORCE, ForceLimiter, rendered_share
from foretouch.rendering.mediation import Mediation
from foretouch.rendering.proxy import RETURN_SPEED, Proxy

LARGEST_MOVE = 5e-4
"""Least jump of a surface towards the hand [m] that is met by the index; smaller ones are met by mediation alone."""

FARTHEST = 10.0
"""Largest distance of a hand from its zero [m]."""

PHANTOM = 0.05
"""Force [N] below which, both wanted and rendered, contact is lost: maps give some millinewtons in the air, and people
feel no less."""

SHARE_RATE = 0.05
"""Fraction of the remaining way by which the rendered share of the motion rises in a tick; it falls at once. A share
that went up and down with every encoder count would be felt as chatter."""

SHARE_ROUNDING = 0.01
"""Difference from the target below which the rendered share is set to it [-]."""

FORCE_IN_AIR = 0.3
"""Largest force [N] of a map in front of its surface that is limited by one encoder count alone, not by the damping of
the device: to yield all the way through the air costs more than so small a force can do."""

CLEARANCE = 1e-3
"""Distance from the surface up to which the proxy is brought back in free air [m]."""

SHORTEST_REACH = 3e-5
"""Least distance over which local slopes are taken [m]; it is longer where the next tick may get further."""

YIELDING_RATE = 0.05
"""Weight of the newest tick in the average of the hand's motion per step of the proxy [-]."""

LARGEST_RETURN = 0.02
"""Largest change of force in a tick by giving back in contact [N]."""

MISSING = 3
"""Number of missing positions in a row from which on the position of the hand counts as unknown."""

FADING = 5
"""Number of ticks in which the force then fades to zero: within 5 ms."""

MEDIATED_SHARE = 0.5
"""Fraction of the account's bound that mediation uses up; the rest is for what it cannot foresee, and for the first
tick of a new contact of a hand whose account is in debt."""


class Renderer:
    """Proxy, prediction, mediation, limits and energy account, in this order, once a tick.

    Args:
        device: Device that the hand holds and feels; None for an open loop, where no force is felt: then the proxy is
            coupled from the first tick on and the whole model is rendered.
        position_scale: Motion of the proxy over that of the hand, positive.
        force_scale: Force on the hand over that of the model, positive.
        largest_stiffness: Largest local stiffness at the hand [N/m]; 0 for what the device carries: `rendered_share`,
            and no more than its `largest_stiffness` by damping and encoder.
        guarded: Whether a surface that turns up where the hand already is, is met by the index.
        sample_period: T [s].
        account: Energy account in space, in which the caller books and holds; None for one along this line.

    Attributes:
        predictor: Runs the newest model at the proxy.
        proxy: Position of the hand for the model and the follower.
        mediation: Lets new models in.
        limiter: Limits force and its rate.
        account: The energy account.
        share: rho, share of the hand's motion that the proxy takes part in until the next tick.
        energy: Energy of the account at the newest tick [J], before its force acts.
        energy_bound: Bound of the account then [J].
        late_energy: Late energy of the account then [J].

    Raises:
        SettingError: A scale or stiffness out of range.
        ArgumentTypeError: `device` is not a device.
    """

    def __init__(
        self,
        device: RenderingDevice | None = None,
        *,
        position_scale: float = 1.0,
        force_scale: float = 1.0,
        largest_stiffness: float = 0.0,
        guarded: bool = False,
        sample_period: float = SAMPLE_PERIOD,
        account: SpatialEnergyAccount | None = None,
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
        self.account: EnergyAccount | SpatialEnergyAccount
        self.account = EnergyAccount.of(device, sample_period) if account is None else account
        self.share = 1.0
        self._free = 0.0
        self._yielding = 1.0
        self.energy = self.energy_bound = self.late_energy = 0.0

    def __repr__(self) -> str:
        """Predictor, and the force on the hand."""
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
        """Whether the force is felt by an operator."""
        return self._device is not None

    def engage(self, hand: float, position: float) -> None:
        """Couple the hand [m] with a follower at this position [m]: nothing jumps, whatever the two positions are.

        A hand without a valid position (not a number, or beyond 10 m) is not coupled.
        """
        if not abs(hand) <= FARTHEST:
            return
        self.proxy.engage(hand, position)
        self.predictor.shift(position - self.predictor.position)

    def update(self, time: float, hand: float, period: float, *, free: bool = False) -> float:
        """One tick.

        A position that is missing counts as not moved, and no force rises on it. From the third missing one in a row on
        the force fades within 5 ms, as the position of the hand is unknown; once it is measured again, the force comes
        back from zero as that of a new model does.

        Args:
            time: Time of the tick [s], later than that of the previous one; otherwise nothing happens.
            hand: Position of the hand [m]; one that is not a number, or beyond 10 m, is missing.
            period: Time since the previous tick [s].
            free: Whether the hand is uncoupled and given no force.

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
        if isinstance(account, EnergyAccount):
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
            leaving_work=self._leaving_work,
        )
        # A late tick is no reason for a larger step of force; nor may the limit of its rate push a hand that leaves
        # with more force than the model has.
        ceiling = min(account.ceiling, self._fade())
        held = period if period < self._period else self._period
        force = self.limiter.update(mediated, held, mediated if mediated < ceiling else ceiling)
        self.mediation.wind_down(force)
        if there and force <= PHANTOM and wanted <= PHANTOM:  # unknown while the hand is missing
            account.close()
            self.mediation.part(account.energy)
        if isinstance(account, EnergyAccount):
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
        """Force of the model for the hand within the limit [N], and its change now that is not due to motion [N].

        Such a change comes from a new model, the clutch, or a hand that is lost or seen again.
        """
        felt, was_felt = self.proxy.engaged and self._missing < MISSING, self._was_felt
        self._was_felt = felt
        # Force beyond the limit is never rendered: mediated, it would take minutes to come down.
        largest, jump = self.limiter.largest_force, self.predictor.jump
        force = self._force_scale * predicted if felt else 0.0
        force = force if force < largest else largest
        if jump == 0.0 and felt == was_felt:
            return force, 0.0
        former = min(self._force_scale * (predicted - jump), largest) if was_felt else 0.0
        return force, force - former

    def _fade(self) -> float:
        """Largest force while the position of the hand is missing [N]."""
        if self._missing < MISSING:
            self._fades_from = self.limiter.force
            return math.inf
        return self._fades_from * max(1.0 - (self._missing - MISSING + 1) / FADING, 0.0)

    def _surplus(self, force: float) -> float:
        """Growth of a force [N] while the hand leaves, beyond b times the change of its velocity [N].

        A spring's force never grows there, and a damper's only by its former decrease; with negative
        damping it does, the faster the hand leaves; without yielding the share of the motion cannot bound it.
        """
        grown = force - self._wanted_before
        if not grown > 0.0:
            return 0.0
        change = abs(self.predictor.velocity - self._velocity) / self._position_scale
        return max(grown - self._device_damping * change, 0.0)

    def _meet_surface(self, surface: float) -> None:
        """Take a new surface [m]: the proxy keeps its depth below the former one.

        Where the new surface is further from the hand, the proxy goes back by at most the indexed distance.
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

    def _leaving_work(self, offset: float) -> tuple[float, float]:
        """Work of the model with an offset [N] on the hand until it leaves contact [J], and the distance to there [m].

        Where the proxy yielded the hand has the longer way, under the same force, which underestimates the work:
        yielding happens at the top of the way. But no force falls more steeply than at the stiffest K that is rendered,
        and gives back F^2 / 2 K at least.
        """
        scale = self._force_scale
        offset, largest, yielded = offset / scale, self.limiter.largest_force / scale, self.proxy.yielded
        work, way = self.predictor.leaving_work(offset, largest)
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
        """Bring the proxy back: freely in free air, as far as dissipation pays for it in contact."""
        proxy, predictor = self.proxy, self.predictor
        if not proxy.engaged or predictor.model is None:
            return
        step = RETURN_SPEED * self._period
        if wanted <= PHANTOM and predictor.depth < 0.0:
            self._return(min(max(-CLEARANCE - predictor.depth, 0.0), step), yielded=True)
            return
        if not proxy.indexed > 0.0 or self.mediation.offset < 0.0 or not wanted > 0.0:
            return
        # The surface moves out against the force: its work is that force over the proxy's way.
        paid = max(self.account.energy - self._leaving_work(0.0)[0], 0.0) * self._position_scale / wanted
        stiffness = self._force_scale * predictor.local_slopes(SHORTEST_REACH)[0]
        gentle = LARGEST_RETURN / stiffness if stiffness > 0.0 else step
        self._return(min(step, paid, gentle), yielded=False)

    def _return(self, distance: float, *, yielded: bool) -> None:
        """Give back a distance [m]; it is no motion of the hand, and causes no damping force."""
        before = self.proxy.position
        self.proxy.give_back(distance, yielded=yielded)
        self.predictor.shift(self.proxy.position - before)

    def _carry(self) -> None:
        """Set the share of the hand's motion that the proxy takes part in until the next tick."""
        predictor, carried, fraction = self.predictor, self._carried(), self.share
        if fraction == carried == self._yielding == 1.0:  # in free air, and on soft material
            self._free = 0.0
            return
        risen = fraction + SHARE_RATE * (carried - fraction)
        self.share = fraction = risen if risen < carried - SHARE_ROUNDING else carried
        self._free = 0.0 if predictor.force > 0.0 else max(-predictor.depth, 0.0)
        self._yielding += YIELDING_RATE * (1.0 / max(fraction, 1e-3) - self._yielding)

    def _carried(self) -> float:
        """Share of the hand's motion at which the device can carry the model until the next tick."""
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
        fraction = rendered_share(
            stiffness,
            damping,
            device_damping=math.inf if light else self._device_damping,
            sample_period=self._period,
            delay=self._delay,
            stiffness_by_encoder=self._stiffest_by_encoder,
        )
        if light or not stiffness > 0.0:
            return fraction
        stiffest = self._stiffest / stiffness
        return stiffest if stiffest < fraction else fraction
