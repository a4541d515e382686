"""What the console shows over time beside forces: models, and what is lost."""

from __future__ import annotations

import math
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.console.history import Losses
from foretouch.console.models_seen import ModelsSeen, figures_of
from foretouch.console.panels.session import BESIDE, GUESSED, stages_html
from foretouch.console.watched import Watched
from foretouch.messages import COUNT_PREFIX, VERSION, Hello, ModelUpdate
from foretouch.models import HuntCrossley
from foretouch.session.latency import HALVES, IN_THE_LOOP, STAGES


def update(sequence: int, law: str, parameters: tuple[float, ...], run: int = 1, *, valid: bool = True) -> ModelUpdate:
    return ModelUpdate(VERSION, sequence, 0, 0, law, parameters, (), 0.0, valid, "", "x", b"", run=run)


def test_the_local_stiffness_of_a_spring_is_its_own() -> None:
    figures = figures_of(update(1, "kelvin-voigt", (800.0, 2.0)), 0.005)
    assert figures is not None
    assert figures.stiffness == pytest.approx(800.0)
    assert np.isnan(figures.deviation)  # a law of numbers alone carries no uncertainty
    assert figures.parameters == (800.0, 2.0)


@given(st.floats(0.001, 0.02), st.floats(1.0, 2.0))
def test_the_local_stiffness_of_a_power_law_is_its_derivative(depth: float, exponent: float) -> None:
    law = HuntCrossley(stiffness=3000.0, damping=0.0, exponent=exponent)
    figures = figures_of(update(1, law.law, law.parameters), depth)
    assert figures is not None
    slope = 3000.0 * exponent * depth ** (exponent - 1.0)
    assert figures.stiffness == pytest.approx(slope, rel=2e-3)


def test_what_cannot_be_run_has_no_figures() -> None:
    assert figures_of(update(1, "jelly", (1.0,)), 0.005) is None
    assert figures_of(update(1, "kelvin-voigt", (800.0, 2.0), valid=False), 0.005) is None


def test_parameters_have_their_standard_errors_where_they_were_told() -> None:
    seen = ModelsSeen()
    for sequence in range(1, 101):
        errors = (30.0, math.nan) if sequence > 50 else ()
        one = update(sequence, "kelvin-voigt", (500.0, 2.0))
        seen.add(msgspec.structs.replace(one, standard_errors=errors))
        seen.adopt(0.02 * sequence, sequence)
    trace = seen.trace(0.005, 3.0, 2.0)
    assert trace.errors.shape == trace.parameters.shape
    late = trace.time > -0.9
    np.testing.assert_array_equal(trace.errors[late, 0], 30.0)
    assert np.isnan(trace.errors[late, 1]).all()
    assert np.isnan(trace.errors[~late][:-1]).all()
    wrong = msgspec.structs.replace(update(1, "kelvin-voigt", (500.0, 2.0)), standard_errors=(1.0,))
    figures = figures_of(wrong, 0.005)
    assert figures is not None
    assert np.isnan(figures.errors).all()  # as many as parameters, or they are of something else


def test_a_trace_has_a_model_every_tenth_of_a_second_and_forgets_a_process_that_began_anew() -> None:
    seen = ModelsSeen()
    for sequence in range(1, 301):
        seen.add(update(sequence, "kelvin-voigt", (500.0 + sequence, 2.0)))
        seen.adopt(0.02 * sequence, sequence)
    trace = seen.trace(0.005, 3.0, 6.0)
    assert 25 <= len(trace.time) <= 31
    assert trace.time[0] >= -3.0
    np.testing.assert_allclose(trace.stiffness, 500.0 + (trace.time + 6.0) / 0.02, rtol=1e-9)
    assert trace.names == ("stiffness", "damping")
    seen.add(update(1, "kelvin-voigt", (9.0, 2.0), run=2))
    seen.adopt(6.1, 1)
    assert seen.trace(0.005, 3.0, 6.1).stiffness[-1] == pytest.approx(9.0)


def counted(losses: Losses, role: str, counts: list[int], period: float = 0.5) -> None:
    name = {"follower": "commands_lost", "leader": "telemetry_lost"}[role]
    for index, count in enumerate(counts):
        losses.take(role, {COUNT_PREFIX + name: str(count)}, 10.0 + period * index)


def test_a_share_is_what_was_lost_of_a_thousand_a_second() -> None:
    losses = Losses()
    counted(losses, "follower", [0, 100, 200, 300])  # 200 a second
    counted(losses, "leader", [5, 5, 5, 5])
    trace = losses.trace(11.5, 6.0)
    assert trace.there[-1] == pytest.approx(20.0)
    assert trace.back[-1] == 0.0
    assert (trace.time <= 0.0).all()


def test_counters_that_begin_anew_or_are_none_are_no_losses() -> None:
    losses = Losses()
    counted(losses, "follower", [1000, 1000, 0, 0])
    losses.take("follower", {COUNT_PREFIX + "commands_lost": "many"}, 12.0)
    losses.take("recorder", {COUNT_PREFIX + "commands_lost": "7"}, 12.0)
    assert (losses.trace(12.0, 6.0).there == 0.0).all()


def test_choices_are_offered_while_somebody_supervises() -> None:
    watched = Watched()
    assert not watched.supervised(10.0)
    watched.take(Hello(VERSION, 1, 1, "supervisor", ("supervised", "recording"), ("yes", "a.mcap")), 10.0)
    assert watched.supervised(10.5)
    assert watched.settings["recording"] == "a.mcap"
    assert not watched.supervised(14.0)


def stages(clocks: str | None, **medians: float) -> str:
    """What is written of these stages, whose sum is 100 ms; a stage that is not named is not known."""
    known = {name: medians.get(name) for name in STAGES}
    return stages_html({"stages_ms": known, "sum_ms": 100.0, "loop_ms": None, "clocks": clocks})


def test_each_stage_of_the_loop_begins_where_that_before_it_ends() -> None:
    text = stages(None, leader=0.05, link_there=29.95, playout=0.0, robot=20.0, link_back=50.0, device=0.5)
    begins = re.findall(r"margin-left:([\d.]+)%;width:max\(([\d.]+)%", text)
    loop = [tuple(map(float, pair)) for pair in begins[: len(IN_THE_LOOP)]]
    assert loop == [(0.0, 0.1), (0.1, 29.9), (30.0, 0.0), (30.0, 20.0), (50.0, 50.0)]
    assert "0.05 ms" in text
    assert "29.9 ms" in text
    assert "100 ms" in text
    assert text.index(">sum<") < text.index(BESIDE) < text.index(">device<") < text.index(">learner<")
    assert GUESSED not in text


def test_a_stage_that_is_not_known_has_a_dash_and_no_bar_and_guessed_ways_are_said() -> None:
    text = stages(HALVES, link_there=500.0)  # a robot's motion shows less than its clock: the bar ends with the column
    assert text.count("–") == len(STAGES)  # the other seven, and the motion's
    assert text.count("margin-left") == 2
    assert "width:max(100.0%" in text
    assert GUESSED in text
