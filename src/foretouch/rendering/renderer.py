"""From models and the hand's motion to the force on the hand."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Held
from foretouch.errors.checks import require, require_type
from foretouch.models import NO_STATE, ContactModel, ContactState, Predictor
from foretouch.quantities import brief_number, brief_text
from foretouch.quantities.pose import Vector
from foretouch.rendering import tick, whole
from foretouch.rendering.energy import SAMPLE_PERIOD, EnergyAccount, RenderingDevice, SpatialEnergyAccount
from foretouch.rendering.friction import FrictionRenderer
from foretouch.rendering.limits import LARGEST_FORCE, ForceLimiter, low_pass
from foretouch.rendering.mediation import Mediation
from foretouch.rendering.proxy import Proxy
from foretouch.rendering.surfaces.line import PLACE_AT, Coordinates, Line
from foretouch.rendering.tick import FARTHEST, SHORTEST_REACH

ContactFrame: TypeAlias = tuple[Vector, NDArray[np.void]]
"""Place of the hand [m], and an array of one `Line` that has followed it over the surface."""

ON_AXIS = Line.new()
ON_AXIS["closest"]["normal"] = -1.0, 0.0, 0.0  # positions along a line grow into the material


def frame_of(hand: float) -> ContactFrame:
    """Frame of a hand [m] on a line; without a place where it is missing."""
    return (hand if abs(hand) <= FARTHEST else math.nan, 0.0, 0.0), ON_AXIS


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
        account: Energy account in space; None for one along this line.
        friction: Friction along the surface; None for that of a hand without a device.

    Attributes:
        closed_loop: Whether the force is felt by an operator.
        predictor: Runs the newest model at the proxy.
        proxy: Position of the hand for the model and the follower.
        mediation: Lets new models in.
        limiter: Limits force and its rate.
        account: The energy account.
        coefficient: Coefficient of Coulomb friction along the surface [-].
        share: rho, share of the hand's motion that the proxy takes part in until the next tick.
        booked: Of the account at the newest tick, before its force acts: energy, its bound, and late energy [J].

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
        friction: FrictionRenderer | None = None,
    ) -> None:
        wanted = "a DeviceSpecification, such as SessionSettings(...).device, or None for a force that no hand feels"
        require_type("device", device, (RenderingDevice, type(None)), wanted)
        require("force_scale", force_scale, above=0.0)
        require("largest_stiffness", largest_stiffness, at_least=0.0)
        require("sample_period", sample_period, above=0.0)
        self.closed_loop, self._force_scale = device is not None, force_scale
        self._time, self._whole = -math.inf, whole.whole.entry
        self._rendering = tick.Rendering.new()
        proxies, mediations, limiters = (self._rendering[name] for name in ("proxy", "mediation", "limiter"))
        self._largest_force = largest = LARGEST_FORCE if device is None else min(LARGEST_FORCE, device.force_limit)
        self.predictor = Predictor()
        self._rendering["friction"] = (FrictionRenderer(math.inf) if friction is None else friction).records
        self.coefficient: float = self._rendering["friction"]["coefficient"].item()
        self.proxy = Proxy(position_scale, proxies=proxies)
        self.mediation = Mediation(mediations=mediations)
        pulls = device is None or device.pulls
        self.limiter = ForceLimiter(largest, pulls=pulls, limiters=limiters)
        self.account: EnergyAccount | SpatialEnergyAccount
        self.account = EnergyAccount.of(device, sample_period) if account is None else account
        setup = Held(self._rendering["setup"])
        setup.guarded = guarded
        setup.closed_loop, setup.period = device is not None, sample_period
        setup.position_scale, setup.force_scale = position_scale, force_scale
        if device is not None:
            setup.stiffest = min(largest_stiffness or math.inf, device.largest_stiffness(sample_period))
            setup.device_damping, setup.delay = device.damping, device.delay
            setup.by_encoder = device.stiffness_by_encoder
            setup.gain, setup.left = low_pass(sample_period, device.delay)
        self.shown: tick.Shown = (math.nan, False, False, 0.0, 0.0, 1.0)
        self.force: Vector = (0.0, 0.0, 0.0)
        self.booked = (0.0, 0.0, 0.0)
        self.predicted: whole.Predicted = (0.0, 0.0, 0.0, math.nan)
        self.touched: whole.Touched = (self.force, math.nan)

    def __repr__(self) -> str:
        """Predictor, and the force on the hand."""
        now = {"share": brief_number(self.share), "force": brief_number(self.limiter.force)}
        return brief_text("Renderer", {"predictor": self.predictor, "closed_loop": self.closed_loop, **now}.items())

    def move_into(self, rendering: NDArray[np.void], account: NDArray[np.void], prediction: NDArray[np.void]) -> None:
        """Keep the state from now on in these arrays of one record each, parts of another record."""
        for mine, theirs in zip(self._records, (rendering, account, prediction), strict=True):
            theirs[:] = mine
        self._rendering, self.account.records, self.predictor.records = rendering, account, prediction
        self.proxy.records, self.mediation.records = rendering["proxy"], rendering["mediation"]
        self.limiter.records = rendering["limiter"]

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

    def engage(self, hand: float, position: float) -> None:
        """Couple the hand [m] with a follower at this position [m]: nothing jumps, whatever the two positions are.

        A hand without a valid position (not a number, or beyond 10 m) is not coupled.
        """
        whole.engage_entry.entry(self._rendering[0], self.predictor.records[0], hand, position)

    @property
    def _records(self) -> whole.Records:
        return self._rendering, self.account.records, self.predictor.records

    @property
    def share(self) -> float:
        """rho, share of the hand's motion that the proxy takes part in until the next tick."""
        return self.shown[5]

    def rub(self, coefficient: float, viscous: float, stiffness: float = math.inf, excess: float = 0.0) -> None:
        """Friction along the surface from now on: coefficient of Coulomb friction [-] and viscous friction [N s/m].

        The stiffness is that with which a surface yields before it slides [N/m], infinite where it is unknown, and the
        excess how much larger the coefficient is at rest [-].
        """
        friction = self._rendering["friction"]
        friction["bristle"], friction["excess"] = stiffness, excess
        friction["coefficient"], friction["viscous"], self.coefficient = coefficient, viscous, coefficient

    def go_over(self, hand: whole.OverSurface, now: whole.Now) -> tuple[Coordinates, float | None]:
        """Follow a hand over a surface, and do the tick there: `foretouch.rendering.whole.whole_over_surface`.

        Returns:
            The hand's coordinates; the force for the hand along the normal [N], None where `update` has to be called
            for it, after what the tick waits for: as for every `update` of a subclass.
        """
        time, measured, even, free, waits = now
        waits = waits or self.predictor.needs_python or type(self).update is not Renderer.update
        now = time, measured, even, free, waits or not time > self._time
        coordinates, done, ticked = whole.whole_over_surface.entry(self._records, hand, now)
        if not done:
            return coordinates, None
        self._time = time
        force, self.force, self.shown, self.booked, self.predicted, self.touched = ticked
        return coordinates, force

    def update(
        self, time: float, hand: float, period: float, *, free: bool = False, frame: ContactFrame | None = None
    ) -> float:
        """One tick.

        A position that is missing counts as not moved, and no force rises on it. From the third missing one in a row on
        the force fades within 5 ms, as the position of the hand is unknown; once it is measured again, the force comes
        back from zero as that of a new model does.

        Args:
            time: Time of the tick [s], later than that of the previous one; otherwise nothing happens.
            hand: Position of the hand [m]; one that is not a number, or beyond 10 m, is missing.
            period: Time since the previous tick [s].
            free: Whether the hand is uncoupled and given no force.
            frame: In space, the place of the hand [m], and the line that has followed it; None on a line.

        Returns:
            The force for the hand along the normal [N], negative where it draws it in; `force`: in all directions.
        """
        if not time > self._time:  # no time has passed: nothing to do
            return self.limiter.force
        self._time = time
        frame = frame_of(hand) if frame is None else frame
        self.predictor.catch_up()
        if self.predictor.foreign:
            return self._update_by_stages(time, hand, period, free, frame)
        force, self.force, self.shown, self.booked, self.predicted, self.touched = self._whole(
            self._records, time, hand, period, free, frame
        )
        return force

    def _update_by_stages(self, time: float, hand: float, period: float, free: bool, frame: ContactFrame) -> float:
        """`foretouch.rendering.whole`, with a law in Python."""
        predictor, r, account = self.predictor, self._rendering[0], self.account.records[0]
        position, self.booked = tick.MOVE.entry(r, account, hand, frame[0], period, free)
        if predictor.surface != r.surface and predictor.model is not None:
            predictor.shift(-tick.MEET_SURFACE.entry(r, predictor.surface))
            position = self.proxy.position
        predicted = predictor.update(time, position)
        velocity, depth = predictor.velocity, predictor.depth
        wanted, offset = tick.WANT.entry(r, predicted, predictor.jump, velocity)
        work = way = 0.0
        scale, largest = self._force_scale, self._largest_force
        if wanted > 0.0:
            work, way = predictor.leaving_work(offset / scale, largest / scale)
        force, reach, back = tick.RENDER.entry(r, account, work, way, predicted, velocity, depth, period)
        if back == tick.BACK_IN_AIR and predictor.model is not None:
            predictor.shift(self.proxy.return_freely(depth, r.setup.period))
        elif back == tick.BACK_IN_CONTACT and predictor.model is not None:
            work, way = predictor.leaving_work(0.0, largest / scale)
            stiffness = predictor.local_slopes(SHORTEST_REACH)[0]
            predictor.shift(tick.RETURN_IN_CONTACT.entry(r, account, work, way, predicted, stiffness))
        stiffness, damping = predictor.local_slopes(reach) if reach > 0.0 else (0.0, 0.0)
        self.shown = tick.CARRY.entry(r, stiffness, damping, reach, predicted, depth)
        self.force = tick.GIVE.entry(r, account, force, frame[1][0], period)
        stiffness = math.nan if predictor.model is None else predictor.local_slopes(tick.SHOWN_REACH)[0]
        self.touched = PLACE_AT.entry(frame[1][0], self.proxy.position), stiffness
        self.predicted = velocity, predicted, predictor.jump, predictor.standard_deviation
        return force
