"""A renderer driven by any models and any hand, and what its docstrings promise, reckoned again beside it."""

from __future__ import annotations

import copy
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from foretouch.core import Held
from foretouch.devices import DeviceSpecification
from foretouch.models import (
    ContactMapModel,
    ContactModel,
    ContinuousSwitching,
    HuntCrossley,
    KelvinVoigt,
    LinearisedContinuousSwitching,
    ThresholdSwitching,
)
from foretouch.models.contact_map.layout import MEMORY
from foretouch.quantities.pose import Vector, add, dot, scaled, subtract
from foretouch.rendering import Renderer

sys.path.append(str(Path(__file__).parents[1] / "models"))
from example_maps import example_map, model_of, random_numbers

TICK = 1e-3
FARTHEST = 10.0
NO_DEVICE_LIMIT = 10.0
SMALLEST_COUNT = 1e-6
ROUNDING = 1e-12
NOTHING, NOWHERE = (0.0, 0.0, 0.0), (math.nan, math.nan, math.nan)


def sticky_numbers(seed: int) -> np.ndarray:
    """Any map that pulls: by some newtons, from where it catches until some way further out."""
    maps, random = random_numbers(seed), np.random.default_rng(seed)
    learnt = maps[0]
    learnt.pull, learnt.catch = random.uniform(0.1, 8.0), random.uniform(-1e-3, 3e-3)
    learnt.hold = learnt.catch - random.uniform(0.0, 5e-3)
    learnt.zero = random.uniform(0.0, 3.0)  # of what it gives
    return maps


MAPS = [example_map(), example_map((0.0, 0.0, 1.0)), *(model_of(random_numbers(seed)) for seed in range(8))]
MAPS += [model_of(sticky_numbers(seed)) for seed in range(8, 14)]


def powers(lowest: float, largest: float) -> st.SearchStrategy[float]:
    """Numbers of every size."""
    return st.floats(lowest, largest).map(lambda exponent: 10.0**exponent)


class StifferOut(KelvinVoigt):
    """A model that gives back more than it takes: twice as stiff for a hand that leaves."""

    def advance(self, state, depth, velocity, sample_period):  # type: ignore[no-untyped-def]
        state, force, deviation = super().advance(state, depth, velocity, sample_period)
        return state, force * (2.0 if velocity < 0.0 else 1.0), deviation


class OnlyOut(KelvinVoigt):
    """A model that does not resist, and pushes whoever leaves, before its surface too."""

    def advance(self, state, depth, velocity, sample_period):  # type: ignore[no-untyped-def]
        return state, (self.stiffness * 1e-3 if velocity < -1e-3 and depth > -0.01 else 0.0), math.nan


class Sticky(KelvinVoigt):
    """A model that pulls with its damping as a force [N]: from the first touch on until 2 mm outside."""

    def advance(self, state, depth, velocity, sample_period):  # type: ignore[no-untyped-def]
        sticks = depth > 0.0 or (depth > -2e-3 and state == (1.0,))
        force = self.stiffness * max(depth, 0.0) - self.damping if sticks else 0.0
        return (1.0,) if sticks else (), force, math.nan


CATCHES = 1e-3


class Latch(KelvinVoigt):
    """A model that catches: a millimetre deep it becomes three times as stiff, and is so until the probe is out."""

    def advance(self, state, depth, velocity, sample_period):  # type: ignore[no-untyped-def]
        caught = depth > CATCHES or (depth > 0.0 and state == (1.0,))
        _, force, deviation = super().advance(state, depth, velocity, sample_period)
        return (1.0,) if caught else (), force * (3.0 if caught else 1.0), deviation

    def leaving_work(self, state, depth, offset=0.0, largest=math.inf):  # type: ignore[no-untyped-def]
        return KelvinVoigt(self.stiffness, self.damping).leaving_work((), depth, offset, largest)  # it does not say so


stiffness, damping = powers(-1.0, 7.0), st.just(0.0) | powers(-2.0, 4.0)
laws: st.SearchStrategy[ContactModel] = st.one_of(
    st.builds(KelvinVoigt, stiffness, damping),
    st.builds(StifferOut, stiffness, damping),
    st.builds(OnlyOut, stiffness, damping),
    st.builds(Latch, stiffness, damping),
    st.builds(Sticky, stiffness, damping),
    st.builds(HuntCrossley, stiffness, damping, st.floats(0.5, 2.5)),
    st.builds(ContinuousSwitching, stiffness, damping, st.floats(0.0, 1.5), st.floats(0.01, 1.0)),
    st.builds(
        LinearisedContinuousSwitching, st.floats(-5.0, 25.0), st.floats(-1.0, 3.0), st.floats(-50, 50), st.floats(-1, 1)
    ),
    st.builds(ThresholdSwitching, stiffness, damping, stiffness, damping, st.floats(0.5, 2.5), st.just(4000.0)),
    st.sampled_from(MAPS),
)
memories = st.just(()) | st.tuples(*[st.floats(-0.02, 0.02)] * MEMORY) | st.just((math.nan,) * MEMORY)


@dataclass(frozen=True)
class Part:
    """Some ticks: what the hand does in them, and the models that come.

    Attributes:
        ticks: So many.
        motion: "smooth", "wild", "noise", "rest", or a place to be at [m], or none.
        size: Of the motion [m].
        model: Comes in the first tick.
        other: Comes in turn with the first one, in every tick; NEVER for not.
        surfaces: Of the two models [m].
        state: The first one's, where it remembers.
        late: Belongs to a sample so many ticks ago.
        clutch: Whether the clutch is pressed or let go in the first tick.
        period: Of these ticks [s].
    """

    ticks: int
    motion: str | float
    size: float
    model: ContactModel | None
    other: ContactModel | str | None
    surfaces: tuple[float, float]
    state: tuple[float, ...]
    late: int
    clutch: bool
    period: float


NEVER = "never"
MOTIONS = ("smooth", "wild", "noise", "rest")
surfaces = st.tuples(st.floats(-0.004, 0.004), st.floats(-0.004, 0.004))


def parts(*, teleports: bool = True, most: int = 14) -> st.SearchStrategy[list[Part]]:
    """Sessions of anything."""
    places = st.floats(-0.02, 0.05) | st.floats(-9.0, 9.0) | st.sampled_from((math.nan, math.inf, -1e300, 10.1))
    motions: st.SearchStrategy[str | float] = st.sampled_from(MOTIONS)
    return st.lists(
        st.builds(
            Part,
            ticks=st.integers(1, 40),
            motion=motions | places if teleports else motions,
            size=powers(-5.0, -2.0 if teleports else -3.0),
            model=st.none() | laws,
            other=st.just(NEVER) | st.none() | laws,
            surfaces=surfaces,
            state=memories,
            late=st.sampled_from((0, 5, 3000)),
            clutch=st.integers(0, 9).map(lambda number: number == 0),
            period=st.sampled_from((TICK,) * 5 + (1e-4, 0.02, 0.3)) if teleports else st.just(TICK),
        ),
        min_size=2,
        max_size=most,
    )


renderers = st.fixed_dictionaries(
    {
        "device": st.none()
        | st.builds(
            DeviceSpecification,
            damping=st.sampled_from((0.0, 0.5, 2.0, 5.0)),
            force_limit=st.sampled_from((1.0, 10.0, 1000.0)),
            resolution=st.sampled_from((0.0, 1e-6, 1e-5, 3e-4)),
            delay=st.sampled_from((0.0, 5e-4, 1e-3)),
            watchdog=st.sampled_from((0.0, 0.02)),
            pulls=st.booleans(),
        ),
        "position_scale": st.sampled_from((0.2, 1.0, 3.0)),
        "force_scale": st.sampled_from((0.1, 1.0, 10.0)),
        "largest_stiffness": st.sampled_from((0.0, 1000.0)),
        "guarded": st.booleans(),
    }
)


FASTEST_HAND = 2.0
LONGEST_GAP = 3  # from so many missing positions on the force fades ...
FADING = 5  # ... in so many ticks


class Books:
    """The energy of the hand as it is defined: force times motion in space, summed up over the whole session.

    A force, as it pushes the hand, acts from a delay after its tick began until the next one does, and no longer than
    the watchdog lets it; between two positions that are read the hand moves evenly. Nothing is ever begun anew.
    """

    def __init__(self, device: DeviceSpecification | None, axes: int = 1) -> None:
        self.count = math.sqrt(axes) * max(0.0 if device is None else device.resolution, SMALLEST_COUNT)
        self.delay = 0.0 if device is None else device.delay
        self.watchdog = math.inf if device is None or not device.watchdog else device.watchdog
        self.whole = self.late = self.work = 0.0
        self.largest_force, self.largest_step = 0.0, self.count
        self.position = NOWHERE
        self.before = self.force = self.first = self.impulse = NOTHING
        self.elapsed, self.before_ends = 0.0, self.delay

    def acted(self, begin: float, end: float) -> Vector:
        """The force's integral between two times of this tick [N s]."""
        former = max(min(end, self.before_ends) - max(begin, 0.0), 0.0)
        newest = max(min(end, self.delay + self.watchdog) - max(begin, self.delay), 0.0)
        return add(scaled(self.before, former), scaled(self.force, newest))

    def move(self, position: Vector, period: float) -> None:
        if self.elapsed == 0.0:
            self.first = self.acted(0.0, TICK)
            self.impulse = add(self.first, self.acted(TICK, period))
        else:
            self.impulse = add(self.impulse, self.acted(0.0, period))
        self.before, self.before_ends = self.force, min(self.delay, self.delay + self.watchdog - period)
        self.elapsed += period
        self.work = 0.0
        if not all(map(math.isfinite, position)):
            return
        way, time = subtract(position, self.position), max(self.elapsed, TICK)
        self.position, self.elapsed = position, 0.0
        distance = math.hypot(*way)
        if math.isnan(distance):
            return
        nominal = min(distance / time, FASTEST_HAND) * TICK
        self.work = -dot(self.first, way) / TICK * nominal / distance if distance > 0.0 else 0.0
        whole = -dot(self.impulse, way) / time if time > TICK else -dot(self.first, way) / TICK
        self.whole += whole
        self.late = min(self.late + whole - self.work, 0.0)
        if self.first != NOTHING:
            self.largest_step = max(self.largest_step, nominal + self.count)

    def hold(self, force: Vector) -> None:
        self.force = force
        self.largest_force = max(self.largest_force, math.hypot(*force))

    @property
    def bound(self) -> float:
        return (1.0 + 2.0 * self.delay / TICK) * self.largest_force * self.largest_step

    def check(self, energy: float, bound: float, late: float) -> None:
        """Over the whole session the hand was given no more than one bound, and what late ticks gave is told [J]."""
        rounding = 1e-12 * max(1.0, abs(self.whole), self.largest_force)
        assert self.whole >= self.late - self.bound - rounding
        assert math.isclose(bound, self.bound, rel_tol=1e-9, abs_tol=1e-12)
        assert math.isclose(late, self.late, rel_tol=1e-9, abs_tol=rounding)
        assert -bound - rounding <= energy <= self.whole - self.late + rounding


def hold(held: Held, records: np.ndarray) -> Held:
    """The same kind of object, of other records."""
    made = object.__new__(type(held))
    Held.__init__(made, records)
    return made


def fork(renderer: Renderer) -> Renderer:
    """The same renderer once more, which waits for no model."""
    twin, rendering = copy.copy(renderer), renderer._rendering.copy()
    predictor = object.__new__(type(renderer.predictor))
    for name in ("records", *type(predictor).__slots__):
        object.__setattr__(predictor, name, copy.copy(getattr(renderer.predictor, name)))
    predictor._waits, predictor.records["waiting"]["arrivals"]["waits"] = False, 0
    twin.predictor, twin._rendering = predictor, rendering
    parts = (("proxy", rendering), ("mediation", rendering), ("limiter", rendering))
    for name, records in parts:
        setattr(twin, name, hold(getattr(renderer, name), records[name]))
    twin.account = hold(renderer.account, renderer.account.records.copy())
    return twin


class Run:
    """One renderer and its books; `largest_step` is what models changed at most, reckoned from a twin without them."""

    def __init__(self, device: DeviceSpecification | None = None, **options: float) -> None:
        self.device = device
        self.options = options
        self.renderer = Renderer(device, **options)
        self.scale = options.get("force_scale", 1.0)
        self.count = 0.0 if device is None else device.resolution
        self.limit = NO_DEVICE_LIMIT if device is None else min(device.force_limit, NO_DEVICE_LIMIT)
        self.books = Books(device)
        self.missing = 0
        self.time = self.hand = 0.0
        self.place = math.nan
        self.messages = self.ticks = 0
        self.largest_step = self.largest_debt = self.largest_pull = self.force_before = 0.0
        self.lowest_share = 1.0
        if device is not None:
            self.renderer.engage(0.0, -0.002)
        for _ in range(2):  # the first sample has no force, whatever the model
            self.tick(0.0)

    def adopt(self, model: ContactModel | None, surface: float, state: tuple[float, ...] = (), late: int = 0) -> None:
        self.messages += 1
        tick = max(self.renderer.predictor.ticks - late, 0)
        state = state if isinstance(model, ContactMapModel) else ()
        self.renderer.adopt(model, surface, state, tick, self.messages)

    def press_or_let_go(self, renderer: Renderer, hand: float) -> None:
        if renderer.proxy.engaged:
            renderer.proxy.release()
        elif abs(hand) <= FARTHEST and not math.isnan(renderer.proxy.position):
            renderer.engage(hand, renderer.proxy.position)

    def tick(self, hand: float, arrivals: tuple[tuple, ...] = (), clutch: bool = False, period: float = TICK) -> float:
        """One tick with all promises checked; returns the force [N]."""
        if self.count > 0.0 and math.isfinite(hand):
            hand = self.count * math.floor(hand / self.count + 0.5)
        if self.books.delay > 0.0:
            period = max(period, TICK)  # in a tick that comes early the hand is not taken to move evenly
        renderer, self.time = self.renderer, self.time + period
        felt, offset = renderer.proxy.engaged and self.missing < LONGEST_GAP, renderer.mediation.offset
        twin = None
        if arrivals or renderer.predictor.message != self.messages:  # a model begins, or one that waits may
            twin = fork(renderer)
        for arrival in arrivals:
            self.adopt(*arrival)
        if clutch:
            self.press_or_let_go(renderer, hand)
        before, velocity = renderer.mediation.force, renderer.predictor.velocity
        force = renderer.update(self.time, hand, period)
        self._check_leaving(hand, before, velocity)
        self._check_force(force)
        self._check_missing(hand, force)
        self._check_energy(hand, force, period)
        if twin is None:
            former = renderer.predictor.force
        else:
            if clutch:
                self.press_or_let_go(twin, hand)
            former = (twin.update(self.time, hand, period), twin.predictor.force)[1]
        # At the very surface rounding alone decides whether a law that begins with damping has a force yet.
        if twin is None or abs(twin.predictor.depth) > ROUNDING:
            offset -= renderer.mediation.surplus  # what a leaving hand is spared: `_check_leaving`
            self._check_step(max((self.felt(former) if felt else 0.0) + offset, 0.0))
        self.ticks += 1
        return force

    def felt(self, force: float) -> float:
        """What of a model's force the hand may be given [N]."""
        return min(max(self.scale * force, 0.0), self.limit)

    def _check_leaving(self, hand: float, before: float, velocity: float) -> None:
        """A hand that goes out is not pushed by more than its change of speed, against the device's damping."""
        if not abs(hand) <= FARTHEST:
            return
        if self.device is not None and hand < self.place:
            change = abs(self.renderer.predictor.velocity - velocity) / self.options.get("position_scale", 1.0)
            assert self.renderer.mediation.force <= before + self.device.damping * change + 2e-6
        self.place = hand

    def _check_force(self, force: float) -> None:
        assert math.isfinite(force)
        assert abs(force) <= self.limit
        if force < 0.0:  # a hand is drawn in only by what pulls, and only on a device that does
            assert self.device is None or self.device.pulls
            assert self.scale * self.renderer.predictor.force <= force
            assert force >= self.force_before - 0.08 - ROUNDING
        self.force_before = min(force, 0.0)
        self.largest_pull = max(self.largest_pull, -force)

    def _check_missing(self, hand: float, force: float) -> None:
        """Without a position no force rises, and from the third on it fades to nothing in five ticks."""
        self.missing = 0 if abs(hand) <= FARTHEST else self.missing + 1
        if self.missing:
            assert abs(force) <= abs(self.books.force[0])
        if self.missing >= LONGEST_GAP + FADING - 1:
            assert force == 0.0

    def _check_energy(self, hand: float, force: float, period: float) -> None:
        renderer, books = self.renderer, self.books
        books.move((hand if abs(hand) <= FARTHEST else math.nan, 0.0, 0.0), period)
        books.check(*renderer.booked)
        if books.bound > 0.0:
            self.largest_debt = max(self.largest_debt, -renderer.booked[0] / books.bound)
        books.hold((-force, 0.0, 0.0))
        assert 0.0 <= renderer.share <= 1.0
        self.lowest_share = min(self.lowest_share, renderer.share)

    def _check_step(self, without: float) -> None:
        """What the twin would feel, had no model come and nothing been let in, is `without` [N]."""
        mediation = self.renderer.mediation
        step, digits = mediation.force - without, 1e-9 * max(1.0, without)
        assert abs(step) <= 0.1 + digits
        assert abs(mediation.step) <= 0.1
        assert math.isclose(mediation.step, step, abs_tol=1e-9 + digits)
        self.largest_step = max(self.largest_step, abs(step))

    def play(self, part: Part, seed: int) -> None:
        """All ticks of a part."""
        random = np.random.default_rng(seed)
        begin = self.hand
        for number in range(part.ticks):
            arrivals = []
            if number == 0:
                arrivals.append((part.model, part.surfaces[0], part.state, part.late))
            elif part.other != NEVER:
                second = number % 2
                arrivals.append(((part.model, part.other)[second], part.surfaces[second], part.state, part.late))
            phase = 2.0 * math.pi * (number + 1) / part.ticks
            hand = {
                "smooth": begin + part.size * (1.0 - math.cos(phase)),
                "wild": begin + part.size * random.normal(),
                "noise": self.hand + 1e-5 * random.normal(),
                "rest": self.hand,
            }.get(part.motion, part.motion)
            clutch = part.clutch and number == 0 and self.device is not None
            self.tick(hand, tuple(arrivals), clutch, part.period)
            if math.isfinite(hand) and abs(hand) < 0.05:
                self.hand = hand
