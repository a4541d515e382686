"""The leader's step by itself: what may and what may not move the rendered force."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.messages import VERSION, ModelUpdate, Telemetry
from foretouch.models import HuntCrossley
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
        inputs = leader.Inputs(0.01 + depth, [models[tick]] if tick in models else [], arrived, MS, 0)
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


def test_there_is_no_force_before_a_valid_model() -> None:
    outputs = run({5: model(1, valid=False)})
    assert max(o.record.rendered_force for o in outputs) == 0.0
    assert outputs[-1].command.acknowledged_model == 1


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


def test_a_hand_at_rest_inside_is_not_pushed_by_a_model_that_comes() -> None:
    outputs = run({5: model(1), 50: model(2, parameters=(9000.0, 0.0, 1.4))})
    assert max(o.record.rendered_force for o in outputs) == 0.0


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
        state, output = leader.step(state, leader.Inputs(position, arrived, [], MS, 0), tick * MS)
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
