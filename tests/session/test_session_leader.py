"""The leader's step by itself: what may and what may not move the rendered force."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np
import pytest
from commanded import SCENES, parts_with
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from foretouch.devices import DeviceSpecification
from foretouch.messages import VERSION, FollowerSpace, LeaderState, ModelUpdate, SessionLog, Status, Telemetry
from foretouch.models import HuntCrossley
from foretouch.quantities.pose import Vector
from foretouch.report import energy_figures
from foretouch.report.energy import BookedDevice
from foretouch.session import SessionSettings
from foretouch.session.spatial.hand import HandInSpace
from foretouch.session.spatial.scenes import Scene
from foretouch.session.steps import leader

sys.path.append(str(Path(__file__).parents[1] / "rendering"))
from renderer_runs import Books

MS = 1_000_000


def model(
    sequence: int,
    *,
    valid: bool = True,
    law: str = "hunt-crossley",
    parameters: Sequence[float] = (),
    surface: float = 0.01,
) -> ModelUpdate:
    numbers = tuple(parameters) or (3000.0, 0.0, 1.4)
    return ModelUpdate(VERSION, sequence, 0, 0, law, numbers, (), surface, valid, "", "fprls", b"")


def telemetry(sequence: int, force: float) -> Telemetry:
    return Telemetry(VERSION, sequence, 0, 0, 0.0, 0.0, 0.0, force, force, force, True, False, 0, MS, 0)


def run(
    models: dict[int, ModelUpdate], forces: Sequence[float] = (), *, ticks: int = 200, pressed: int = 0
) -> list[leader.Outputs]:
    """A hand that is 10 mm inside, or goes there from 1 mm outside and arrives in the tick `pressed`."""
    state, outputs = leader.start(), []
    for tick in range(ticks):
        depth = 0.01 - 0.011 * max(1.0 - tick / pressed, 0.0) if pressed else 0.01
        arrived = [telemetry(tick + 1, forces[tick])] if tick < len(forces) else []
        inputs = leader.Inputs(0.01 + depth, [*arrived, *([models[tick]] if tick in models else [])], MS, 0)
        state, output = leader.step(state, inputs, tick * MS)
        outputs.append(output)
    return outputs


@given(st.lists(st.floats(-100.0, 100.0), min_size=200, max_size=200))
@pytest.mark.long
def test_the_delayed_force_moves_nothing(forces: list[float]) -> None:
    quiet, loud = run({5: model(1)}, [0.0] * len(forces)), run({5: model(1)}, forces)
    assert [o.record.predicted_force for o in quiet] == [o.record.predicted_force for o in loud]
    assert [o.record.rendered_force for o in quiet] == [o.record.rendered_force for o in loud]
    assert [o.command for o in quiet] == [o.command for o in loud]
    assert loud[-1].record.delayed_force == forces[-1]


def test_there_is_no_force_before_a_valid_model_nor_in_a_hand_at_rest_when_one_comes() -> None:
    outputs = run({5: model(1, valid=False)})
    assert max(o.record.rendered_force for o in outputs) == 0.0
    assert outputs[-1].command.acknowledged_model == 1
    outputs = run({5: model(1), 50: model(2, parameters=(9000.0, 0.0, 1.4))})
    assert max(o.record.rendered_force for o in outputs) == 0.0


def test_the_force_is_the_model_s_within_the_rate_limit() -> None:
    outputs = run({1: model(1)}, pressed=100)
    law = HuntCrossley(3000.0, 0.0, 1.4)
    expected = law.advance((), 0.01, 0.0, 1e-3)[1]
    assert outputs[-1].record.rendered_force == pytest.approx(expected, rel=5e-3)
    jumps = np.abs(np.diff([o.record.rendered_force for o in outputs]))
    assert jumps.max() < 0.2
    assert not any(o.record.clipped for o in outputs)
    quick = run({1: model(1)}, pressed=20)
    assert np.abs(np.diff([o.record.rendered_force for o in quick])).max() == pytest.approx(0.2)
    assert quick[20].record.clipped
    assert quick[-1].record.rendered_force < expected  # the hand was faster than the limit, and paid less


def test_the_tick_that_adopts_a_model_says_by_how_much_it_changed_the_force() -> None:
    outputs = run({5: model(1), 50: model(2, parameters=(9000.0, 0.0, 1.4)), 100: model(3, valid=False)})
    jumps = np.array([o.record.model_jump for o in outputs])
    force = 3000.0 * 0.01**1.4
    np.testing.assert_allclose(jumps[[5, 50, 100]], [force, 2.0 * force, -3.0 * force])
    assert np.flatnonzero(jumps).tolist() == [5, 50, 100]


def test_an_old_model_does_not_replace_a_newer_one() -> None:
    outputs = run({5: model(7), 50: model(6, parameters=(9000.0, 0.0, 1.4))})
    assert outputs[-1].record.model_sequence == 7
    assert outputs[-1].record.predicted_force == outputs[40].record.predicted_force


@pytest.mark.parametrize(
    "bad",
    [
        model(2, law="jelly"),
        model(2, parameters=(1.0,)),
        model(2, parameters=(float("nan"), 0.0, 1.4)),
        model(2, parameters=(-1.0, 0.0, 1.4)),
    ],
)
def test_a_model_that_cannot_be_run_lets_the_force_go(bad: ModelUpdate) -> None:
    outputs = run({1: model(1), 100: bad}, pressed=60, ticks=400)
    assert outputs[99].record.rendered_force > 4.0
    assert outputs[-1].record.rendered_force == 0.0


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=50, max_size=50))
def test_no_position_raises_or_breaks_the_limits(positions: list[float]) -> None:
    state, before = leader.start(), 0.0
    for tick, position in enumerate(positions):
        arrived = [model(1)] if tick == 0 else []
        state, output = leader.step(state, leader.Inputs(position, arrived, MS, 0), tick * MS)
        force = output.record.rendered_force
        assert 0.0 <= force <= 10.0
        assert force - before <= 0.2 + 1e-9
        before = force


@pytest.mark.parametrize("bad", [model(2, law="jelly"), model(2, surface=-1e300), model(2, surface=float("-inf"))])
def test_a_refused_model_is_not_acknowledged(bad: ModelUpdate) -> None:
    outputs = run({1: model(1), 100: bad}, pressed=60, ticks=150)
    assert outputs[50].command.acknowledged_model == 1
    assert outputs[-1].command.acknowledged_model == 0
    assert np.isfinite([o.command.position for o in outputs]).all()


# --- a simulated hand in a loop that is late: what it does meanwhile counts for the time that it took -----------------


SPEED = 0.05
LATE = 25
MODEL = ModelUpdate(VERSION, 1, 0, 0, "hunt-crossley", (400.0, 0.0, 1.0), (), 0.0, True, "", "fprls", b"")
SEEN = Telemetry(VERSION, 1, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, False, 0, MS, 0)


def pressed(*, simulated: bool) -> list[LeaderState]:
    settings = SessionSettings(grip="normal", first_touch="follow")
    state, records, begun = leader.start(settings, device=None if simulated else settings.device), [], 0
    for tick in (*range(100), *range(99 + LATE, 200)):
        begins = (tick + (LATE - 1 if tick == 99 else 0)) * MS
        position = SPEED * 1e-9 * (tick * MS if simulated else begins)
        inputs = leader.Inputs(position, {0: [SEEN], 1: [MODEL]}.get(tick, []), begins - begun if tick else 0, 0)
        inputs = inputs._replace(exact_position=position if simulated else math.nan)
        state, output = leader.step(state, inputs, tick * MS)
        records.append(output.record)
        begun = begins
    return records


@pytest.mark.parametrize("simulated", [True, False])
def test_no_late_tick_widens_the_bound(simulated: bool) -> None:
    records = pressed(simulated=simulated)
    newest, device = records[-1], SessionSettings(grip="normal").device
    assert newest.rendered_force > 1.0
    farthest = SPEED * 1e-3 + device.resolution
    largest = max(record.rendered_force for record in records[:-1])
    allowed = (1.0 + 2.0 * device.delay / 1e-3) * largest * farthest
    assert newest.energy_bound == pytest.approx(allowed, rel=1e-6)


@pytest.mark.parametrize("simulated", [True, False])
def test_the_report_books_a_late_tick_as_the_leader_did(simulated: bool) -> None:
    records = pressed(simulated=simulated)
    device = SessionSettings(grip="normal").device
    log = SessionLog.from_messages(records)
    figures = energy_figures(log.leader, BookedDevice(device.resolution, device.delay, device.watchdog))
    assert figures["energy_agrees"] is True
    assert figures["certificate_holds"] is True


# --- a hand in space: whatever arrives, and however it moves ----------------------------------------------------------

NOWHERE, MOST, RISE, PHANTOM, FADED = (math.nan,) * 3, 10.0, 0.2, 0.05, 7
"""Largest force [N], its rise in a tick, what counts as none, and missing positions after which there is none."""


class Led:
    """A leader whose device a hand holds, over a follower that goes where it is told; every tick is judged.

    `felt` counts ticks under a force, `rubbed` those of them in which it pushed along the surface.
    """

    def __init__(self, scene: Scene, device: DeviceSpecification, start: Vector, **changes: float) -> None:
        chosen = SessionSettings(scene="plane", **changes)
        self.state = leader.start(chosen, device=device, hand=HandInSpace(scene.surface, scene.nominal, 1.0))
        self.device, self.books, self.at, self.run, self.now = device, Books(device, 3), start, 1, 0
        self.sequence = self.model_sequence = self.missing = self.felt = self.rubbed = 0
        self.nominal, self.energy, self.pushed, self.coefficient, self.viscous = scene.nominal, 0.0, 0.0, 0.0, 0.0

    def follower_says(self, *, status: Status = Status.FOLLOWING, epoch: int = 1) -> list[Telemetry]:
        self.sequence += 1
        numbers = dict.fromkeys(FollowerSpace.__struct_fields__[:28], 0.0)
        numbers |= dict(zip(("desired_x", "desired_y", "desired_z"), self.at, strict=True))
        space, said = FollowerSpace(**numbers), {"status": int(status), "epoch": epoch, "run": self.run}
        return [msgspec.structs.replace(SEEN, sequence=self.sequence, space=space, **said)]

    def model(self, random: np.random.Generator, trouble: str) -> ModelUpdate:
        self.model_sequence += 1
        size, fixture = 10.0 ** random.uniform(2.0, 5.0), self.nominal
        law = random.choice(
            ("kelvin-voigt", "hunt-crossley", "jelly") if trouble == "invalid" else ("kelvin-voigt",) * 2
        )
        surface = float(random.uniform(-4e-3, 4e-3)) if trouble == "jump" else 0.0
        if trouble == "belief":
            wrong = (*random.uniform(-0.02, 0.02, 3), *random.uniform(-0.3, 0.3, 3))
            fixture = tuple(np.add(self.nominal, wrong).tolist())
        self.coefficient, self.viscous = random.uniform(0.0, 1.5), float(random.choice((0.0, 0.0, 5.0)))
        valid = trouble != "invalid" or random.random() < 0.5
        numbers = (size, 0.0, 1.4) if law == "hunt-crossley" else (size, 0.0)
        made = model(self.model_sequence, valid=valid, law=str(law), parameters=numbers, surface=surface)
        friction = (self.coefficient, self.viscous, *6 * (0.0,))
        return msgspec.structs.replace(made, fixture=fixture, friction=friction, run=self.run)

    def tick(
        self, place: Vector, arrived: Sequence, *, period: int = 1, clutched: bool = False, stopping: bool = False
    ) -> None:
        self.now += period * MS
        count = self.device.resolution
        seen = tuple(count * math.floor(one / count + 0.5) for one in place) if math.isfinite(place[0]) else place
        inputs = leader.Inputs(seen, arrived, period * MS, 0, clutched, NOWHERE, NOWHERE, stopping)
        outputs = leader.step(self.state, inputs, self.now)[1]
        self.missing = 0 if math.isfinite(place[0]) else self.missing + 1
        self.books.move(seen, period * 1e-3)
        self.judge(outputs)
        self.at = outputs.command.place or self.at

    def judge(self, outputs: leader.Outputs) -> None:
        record, space, books = outputs.record, outputs.record.space, self.books
        force = np.array((space.force_x, space.force_y, space.force_z))
        normal = np.array((space.normal_x, space.normal_y, space.normal_z))
        size, pressed, before = float(np.linalg.norm(force)), float(force @ normal), math.hypot(*books.force)
        # The account: every tick of it is the work that was done, and only a lost contact forgives a surplus.
        books.check(record.energy, record.energy_bound, record.late_energy)
        kept = (self.energy, min(self.energy, 0.0) if self.pushed <= PHANTOM else self.energy)
        assert min(abs(record.energy - one - books.work) for one in kept) < 1e-9
        # The force: finite, outwards, within the device and within the cone of friction.
        assert np.isfinite([*force, *normal, *outputs.command.place]).all()
        assert size <= min(MOST, self.device.force_limit) + 1e-9
        assert pressed == pytest.approx(record.rendered_force, abs=1e-9), "what is told is what is given"
        aside = float(np.linalg.norm(force - pressed * normal))
        if self.viscous == 0.0:
            assert aside <= self.coefficient * pressed + 1e-9
        # No jump: a force rises by so much, not at all while the hand is lost, and models change it by less.
        assert pressed - self.pushed <= RISE + 1e-9
        assert abs(record.update_step) <= 0.1
        if self.missing:
            assert size <= before + 1e-9
        if self.missing >= FADED:
            assert size == 0.0
        books.hold(tuple(force.tolist()))
        self.energy, self.pushed = record.energy, pressed
        self.felt, self.rubbed = self.felt + (size > 0.5), self.rubbed + (aside > 0.1)


LEADER_TROUBLES = (
    "", "", "models", "models", "jump", "belief", "belief", "invalid", "late", "lost", "clutch", "stop", "stopping",
    "other", "restart", "dither",
)  # fmt: skip
devices = st.builds(
    DeviceSpecification,
    damping=st.sampled_from((0.0, 0.1, 2.0, 5.0)),
    force_limit=st.sampled_from((2.0, 10.0, 1000.0)),
    resolution=st.sampled_from((1e-6, 1e-4)),
    delay=st.sampled_from((0.0, 5e-4, 1e-3)),
    watchdog=st.sampled_from((0.0, 0.02)),
)


def lead(name: str, parts: list, seed: int, device: DeviceSpecification, scale: float) -> Led:
    random, before = np.random.default_rng(seed), np.array((0.0, 0.0, 0.01))
    led = Led(SCENES[name], device, tuple(before.tolist()), force_scale=scale)
    for target, ticks, trouble in parts:
        if trouble == "restart":
            led.run += 1
        for tick in range(ticks + 60):
            place = before + (np.array(target) - before) * min((tick + 1) / ticks, 1.0)
            if trouble == "dither":
                place = place + random.normal(0.0, 3e-4, 3)
            short = 5 < tick < 30
            said = {"stop": {"status": Status.STOPPED}, "other": {"epoch": 2}}.get(trouble, {}) if short else {}
            arrived = led.follower_says(**said)
            if tick % {"models": 3, "jump": 10, "belief": 25, "invalid": 10}.get(trouble, 60) == 1:
                arrived.append(led.model(random, trouble))
            led.tick(
                NOWHERE if trouble == "lost" and tick % 40 > 20 + seed % 20 else tuple(place.tolist()),
                arrived,
                period=int(random.choice((1, 3, 120))) if trouble == "late" and tick % 10 == 5 else 1,
                clutched=trouble == "clutch" and short,
                stopping=trouble == "stopping" and short,
            )
        before = np.array(target)
    return led


PRESS = [((0.01, 0.005, -0.03), 120, "models"), ((-0.012, -0.01, -0.03), 120, "")]
"""Into each scene, and along its surface: some force and some friction is judged whatever else is drawn."""
HELD = DeviceSpecification(damping=5.0, delay=5e-4, watchdog=0.02)


@pytest.mark.parametrize(
    ("name", "examples"),
    [*((name, 8) for name in SCENES), *(pytest.param(name, 150, marks=pytest.mark.long) for name in SCENES)],
)
@pytest.mark.first
def test_no_hand_in_space_is_given_more_energy_or_force_than_promised(name: str, examples: int) -> None:
    felt = rubbed = 0

    @settings(max_examples=examples, suppress_health_check=[HealthCheck.too_slow])
    @given(parts_with(LEADER_TROUBLES), st.integers(0, 100), devices, st.sampled_from((1.0, 0.3)))
    @example(PRESS, 1, HELD, 1.0)
    def motions(parts: list, seed: int, device: DeviceSpecification, scale: float) -> None:
        nonlocal felt, rubbed
        led = lead(name, parts, seed, device, scale)
        felt, rubbed = felt + led.felt, rubbed + led.rubbed

    motions()
    assert felt > 100
    assert rubbed > 50
