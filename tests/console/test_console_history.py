"""What the console keeps of a session, and how it brings forces to one time."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.console.history import History
from foretouch.console.plots import Curve, TimePlot
from foretouch.messages import VERSION, LeaderState, Status, Telemetry
from foretouch.quantities.colours import INK


def leader(sequence: int, predicted: float, delayed: float = 0.0, position: float = 0.0) -> LeaderState:
    return LeaderState(
        VERSION, sequence, sequence * 1_000_000, position, 0.0, predicted, predicted, delayed, 0, 1, 0.0, False, 0, 0
    )


def telemetry(
    sequence: int, applied: int, force: float, position: float = 0.0, status: Status = Status.FOLLOWING
) -> Telemetry:
    numbers = (position, position, 0.0, force, force, force, force > 0, False, 1, 0, 0)
    return Telemetry(VERSION, sequence, 0, applied, *numbers, status=status)


def history_of(
    count: int, state: Any = lambda i: leader(i, 1.0), felt: Any = lambda i: telemetry(i, i, 1.0)
) -> History:
    """As many ticks of both sides; of the follower those that there are."""
    history = History()
    for i in range(1, count + 1):
        history.add_leader(state(i))
        if (tick := felt(i)) is not None:
            history.add_telemetry(tick)
    return history


def test_true_force_stands_where_its_command_was_given():
    history = History()
    true = {i: 1.0 + i * 1e-3 for i in range(1, 1001)}
    for i in range(1, 1001):
        history.add_leader(leader(i, predicted=true[i] + 0.1, delayed=0.5))
        if i > 80:  # the follower applies a command 80 ticks later, twice
            history.add_telemetry(telemetry(2 * i, i - 80, true[i - 80]))
            history.add_telemetry(telemetry(2 * i + 1, i - 80, 99.0))
    window = history.window(points=2000)
    sequence = np.rint(window.time * 1000).astype(int) + 1000
    assert list(sequence) == list(range(1, 1001))
    known = sequence <= 920
    assert window.true[known] == pytest.approx([true[i] for i in sequence[known]])
    assert np.isnan(window.true[~known]).all()
    rms = np.sqrt(np.mean([true[i] ** 2 for i in range(1, 921)]))
    assert window.prediction_error == pytest.approx(100 * 0.1 / rms)
    delayed = np.sqrt(np.mean([(true[i] - 0.5) ** 2 for i in range(1, 921)]))
    assert window.delayed_error == pytest.approx(100 * delayed / rms)
    felt = np.sqrt(np.mean((window.true[known] - window.rendered[known]) ** 2))
    assert window.rendered_error == pytest.approx(100 * felt / rms)


def test_what_the_robot_does_beside_following_is_no_error_of_the_prediction():
    """It holds for 0.3 s, in which no command is applied, and is on its way back for 0.2 s."""

    def felt(i: int) -> Telemetry:
        if i < 1000 or i >= 1500:
            return telemetry(i, i, 3.0)
        away = (i, Status.RETURNING) if i >= 1300 else (999, Status.HOLDING)
        return telemetry(i, away[0], 0.5, status=away[1])

    window = history_of(2000, lambda i: leader(i, predicted=3.1), felt).window(points=4000)
    sequence = np.rint(window.time * 1000).astype(int) + 2000
    np.testing.assert_array_equal(window.away, (sequence >= 1000) & (sequence < 1500))
    assert np.isnan(window.true[(sequence >= 1000) & (sequence < 1300)]).all()
    assert window.prediction_error == pytest.approx(100 * 0.1 / 3.0)


def test_a_window_ends_where_it_is_asked_to():
    history = history_of(499, lambda i: leader(i, predicted=float(i)))
    assert history.window(newest=300).predicted[-1] == 300.0
    assert history.window().predicted[-1] in (498.0, 499.0)


def test_free_air_and_nothing_at_all_have_no_error():
    in_air = history_of(500, lambda i: leader(i, 0.0), lambda i: telemetry(i, i, 0.01))
    assert np.isnan(in_air.window().prediction_error)
    window = History().window()
    assert len(window.time) == 0
    assert np.isnan(window.prediction_error)


def test_points_stay_the_same_ticks_while_the_window_moves():
    history = history_of(8999, lambda i: leader(i, float(i)))
    before = history.window()
    assert 300 <= len(before.time) <= 400
    for i in range(9000, 9037):
        history.add_leader(leader(i, float(i)))
    after = history.window()
    assert set(before.predicted[5:]) <= set(after.predicted)
    assert after.time[-1] <= 0.0
    assert after.time[0] >= -6.0


def test_lines_bridge_a_few_lost_commands_but_no_outage():
    def felt(i: int) -> Telemetry | None:
        return telemetry(i, i, i * 1e-3) if i % 3 == 0 and not 400 < i < 600 else None

    window = history_of(1000, lambda i: leader(i, 0.0), felt).window(points=2000)
    sequence = np.rint(window.time * 1000).astype(int) + 1000
    inside = (sequence >= 3) & (sequence <= 999) & ((sequence < 400) | (sequence > 600))
    assert window.true[inside] == pytest.approx(sequence[inside] * 1e-3)
    assert np.isnan(window.true[(sequence > 402) & (sequence < 598)]).all()


def test_where_the_robot_was_in_one_telemetry():
    history = History(length=16)
    for i in range(1, 40):
        history.add_telemetry(telemetry(i, i, 0.0, position=i * 1e-3))
    assert history.follower_position(39) == pytest.approx(0.039)
    assert history.follower_position(24) == pytest.approx(0.024)
    assert np.isnan(history.follower_position(23))  # overwritten
    assert np.isnan(history.follower_position(0))
    assert np.isnan(history.follower_position(41))


@settings(derandomize=True, deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(1, 300), st.integers(0, 300), st.floats(-1.0, 10.0)), max_size=60))
def test_any_order_of_messages_gives_a_window(messages):
    history = History(length=64)
    for sequence, applied, force in messages:
        history.add_leader(leader(sequence, force))
        history.add_telemetry(telemetry(sequence, applied, force))
    window = history.window()
    assert (np.diff(window.time) > 0).all()
    assert len({len(a) for a in window[:4]}) == 1


def test_storing_costs_the_same_after_many_messages():
    history = History()
    messages = [(leader(i, 1.0), telemetry(i, i, 1.0)) for i in range(1, 20_001)]

    def cost(part):
        begin = time.thread_time()
        for state, tick in part:
            history.add_leader(state)
            history.add_telemetry(tick)
        return (time.thread_time() - begin) / len(part)

    costs = [cost(messages[i : i + 1000]) for i in range(0, 20_000, 1000)]
    assert min(costs[10:]) < 3 * min(costs[:10])
    assert min(costs) < 100e-6


def test_a_model_that_has_diverged_is_not_hidden():
    assert history_of(200, lambda i: leader(i, 1e6)).window().prediction_error > 1e7


def test_the_deviation_stands_beside_its_prediction():
    def state(i: int) -> LeaderState:
        deviation = 0.1 * i if i > 100 else np.nan
        return msgspec.structs.replace(leader(i, predicted=float(i)), standard_deviation=deviation)

    window = history_of(400, state).window(points=1000)
    known = window.predicted > 100.0
    np.testing.assert_allclose(window.deviation[known], 0.1 * window.predicted[known])
    assert np.isnan(window.deviation[~known]).all()


def test_while_hand_and_robot_are_apart_nothing_is_predicted():
    window = history_of(1000, lambda i: leader(i, 1.1, position=np.nan if i > 500 else 0.0)).window(points=2000)
    assert np.isnan(window.predicted[500:]).all()
    assert window.prediction_error == pytest.approx(10.0)


class Drawn:
    """Stands where the viewer's interface stands, and keeps what it is given to draw."""

    def __init__(self) -> None:
        self.data = ()

    def add_uplot(self, data, series, **looks):
        assert len(data) == len(series)
        return self


def test_what_is_not_known_is_a_gap_and_never_a_fall_to_zero():
    nan, gui = float("nan"), Drawn()
    plot = TimePlot(gui, "", (Curve("a", INK), Curve("b", INK, band=True)))
    known = np.array([nan, 1.0, nan, 20.0, nan])
    plot.draw(np.arange(5.0), (known, np.full(5, nan)), (np.ones(5),), most=15.0)
    time_axis, first, second, above, below = gui.data
    assert list(time_axis) == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_array_equal(first, [1.0, 1.0, nan, 15.0, nan])
    np.testing.assert_array_equal(second, [0.0, nan, nan, nan, nan])
    for edge in (above, below):  # a band has no width there: it would be filled over a gap
        np.testing.assert_array_equal(edge, np.zeros(5))
    assert np.isnan(known[0])  # what is drawn is a copy


def test_a_band_is_one_deviation_to_either_side_and_none_where_it_is_not_known():
    gui = Drawn()
    TimePlot(gui, "", (Curve("a", INK, band=True),), lowest=None).draw(
        np.arange(3.0), (np.array([1.0, -2.0, 3.0]),), (np.array([0.5, np.nan, 1.0]),)
    )
    np.testing.assert_array_equal(gui.data[2], [1.5, -2.0, 4.0])
    np.testing.assert_array_equal(gui.data[3], [0.5, -2.0, 2.0])


def test_the_round_trip_is_the_age_of_the_motion_that_the_newest_answer_is_of():
    """Commands take 80 ticks there, answers 300 back."""

    def state(i: int) -> LeaderState:
        return msgspec.structs.replace(leader(i, 1.0), telemetry_sequence=max(i - 300, 0))

    history = history_of(2000, state, lambda i: telemetry(i, i - 80, 1.0) if i > 80 else None)
    window = history.window(points=3000)
    sequence = np.rint(window.time * 1000).astype(int) + 2000
    np.testing.assert_allclose(window.round_trip[sequence > 381], 0.38, atol=1e-9)
    assert np.isnan(window.round_trip[sequence <= 380]).all()


def test_energy_and_rendered_force_stand_at_their_ticks():
    changes = {"rendered_force": 1.5, "late_energy": -2e-3, "energy_bound": 1e-6}
    history = history_of(500, lambda i: msgspec.structs.replace(leader(i, 2.0), energy=i * 1e-3, **changes))
    window = history.window(points=1000)
    np.testing.assert_allclose(np.diff(window.energy), 1e-3)
    assert (window.energy_bound == 1e-6).all()
    assert (window.late_energy == -2e-3).all()
    assert (window.rendered == 1.5).all()
