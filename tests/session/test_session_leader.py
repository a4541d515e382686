"""The leader's step by itself: what may and what may not move the rendered force."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.messages import VERSION, LeaderState, ModelUpdate, SessionLog, Telemetry
from foretouch.models import HuntCrossley
from foretouch.report import energy_figures
from foretouch.report.energy import BookedDevice
from foretouch.session import SessionSettings
from foretouch.session.steps import leader

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
