"""From models and the hand's motion to the force on the hand."""

from __future__ import annotations

import math

from foretouch.core import Held
from foretouch.errors.checks import require, require_type
from foretouch.models import NO_STATE, ContactModel, ContactState, Predictor
from foretouch.quantities import brief_number, brief_text
from foretouch.rendering import tick
from foretouch.rendering.energy import SAMPLE_PERIOD, EnergyAccount, RenderingDevice, SpatialEnergyAccount
from foretouch.rendering.limits import LARGEST_FORCE, ForceLimiter, low_pass
from foretouch.rendering.mediation import Mediation
from foretouch.rendering.proxy import Proxy
from foretouch.rendering.tick import BACK_IN_AIR, FARTHEST, NOTHING_BACK, SHORTEST_REACH

LARGEST_MOVE = 5e-4
"""Least jump of a surface towards the hand [m] that is met by the index; smaller ones are met by mediation alone."""


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
        self._device, self._guarded, self._force_scale = device, guarded, force_scale
        self._surface, self._time = math.nan, -math.inf
        self._move, self._want = tick.move.entry, tick.want.entry
        self._render, self._carry = tick.render.entry, tick.carry.entry
        self._rendering = tick.Rendering.new()
        proxies, mediations, limiters = (self._rendering[name] for name in ("proxy", "mediation", "limiter"))
        self._largest_force = largest = LARGEST_FORCE if device is None else min(LARGEST_FORCE, device.force_limit)
        self.predictor = Predictor()
        self.proxy = Proxy(position_scale, proxies=proxies)
        self.mediation = Mediation(mediations=mediations)
        self.limiter = ForceLimiter(largest, limiters=limiters)
        self.account: EnergyAccount | SpatialEnergyAccount
        self.account = EnergyAccount.of(device, sample_period) if account is None else account
        setup = Held(self._rendering["setup"])
        setup.closed_loop, setup.along, setup.period = device is not None, account is None, sample_period
        setup.position_scale, setup.force_scale = position_scale, force_scale
        if device is not None:
            setup.stiffest = min(largest_stiffness or math.inf, device.largest_stiffness(sample_period))
            setup.device_damping, setup.delay = device.damping, device.delay
            setup.by_encoder = device.stiffness_by_encoder
            setup.gain, setup.left = low_pass(sample_period, device.delay)
        self.shown: tick.Shown = (math.nan, False, False, 0.0, 0.0, 1.0)
        self.booked = (0.0, 0.0, 0.0)

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

    @property
    def share(self) -> float:
        """rho, share of the hand's motion that the proxy takes part in until the next tick."""
        return self.shown[5]

    @property
    def energy(self) -> float:
        """Energy of the account at the newest tick [J], before its force acts."""
        return self.booked[0]

    @property
    def energy_bound(self) -> float:
        """Bound of the account then [J]."""
        return self.booked[1]

    @property
    def late_energy(self) -> float:
        """Late energy of the account then [J]."""
        return self.booked[2]

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
        if not time > self._time:  # no time has passed: nothing to do
            return self.limiter.force
        self._time = time
        predictor, r, account = self.predictor, self._rendering, self.account.records
        predictor.catch_up()
        position, self.booked = self._move(r, account, hand, period, free)
        if predictor.surface != self._surface and predictor.model is not None:
            self._meet_surface(predictor.surface)
            position = self.proxy.position
        predicted = predictor.update(time, position)
        wanted, offset = self._want(r, predicted, predictor.jump, predictor.velocity)
        work = way = 0.0
        if wanted > 0.0:
            scale, largest = self._force_scale, self._largest_force
            work, way = predictor.leaving_work(offset / scale, largest / scale)
        velocity, depth = predictor.velocity, predictor.depth
        force, reach, back = self._render(r, account, work, way, predicted, velocity, depth, period)
        if back != NOTHING_BACK and predictor.model is not None:
            self._give_back(back)
        stiffness, damping = predictor.local_slopes(reach) if reach > 0.0 else (0.0, 0.0)
        self.shown = self._carry(r, stiffness, damping, reach, predicted, depth)
        return force

    def _give_back(self, how: int) -> None:
        """Bring the proxy back, which is no motion of the hand."""
        predictor, scale = self.predictor, self._force_scale
        if how == BACK_IN_AIR:
            predictor.shift(tick.return_in_air.entry(self._rendering, predictor.depth))
            return
        work, way = predictor.leaving_work(0.0, self._largest_force / scale)
        stiffness = predictor.local_slopes(SHORTEST_REACH)[0]
        back = tick.return_in_contact.entry
        predictor.shift(back(self._rendering, self.account.records, work, way, predictor.force, stiffness))

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
