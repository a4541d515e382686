"""A recorded session run again: itself under its own settings, and what other delays and laws change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from watched_robot import watched

from foretouch.errors import RecordingError, SettingError, UnknownNameError
from foretouch.messages import EmergencyStop, SessionLog, Status
from foretouch.report import session_figures
from foretouch.session import (
    CLOSED_LOOP,
    FIXED_MOTION,
    SessionSettings,
    material_answers,
    recorded_settings,
    replay_notes,
    replay_under,
    simulate,
)
from foretouch.session.replay.machines import PlayedOperator

MS = 1_000_000


def recorded(seconds: float = 4.0, **changes: Any) -> SessionLog:
    return simulate(SessionSettings(**{"material": "hunt-crossley"} | changes), duration=seconds).log


def again(log: SessionLog, *, closed_loop: bool = False, **changes: Any) -> SessionLog:
    return replay_under(log, recorded_settings(log.settings, changes)[0], closed_loop)


def assert_same(one: SessionLog, other: SessionLog) -> None:
    for table, expected in ((one.leader, other.leader), (one.follower, other.follower)):
        for name in set(expected.dtype.names) - {"compute_ns"}:
            np.testing.assert_array_equal(table[name], expected[name], err_msg=name)
    assert one.models == other.models
    assert one.counts == other.counts


def on_a_real_robot(log: SessionLog) -> SessionLog:
    follower = log.follower.copy()
    follower["exact_force"] = np.nan
    follower["time_ns"] += 7_000_000_000_123
    return replace(log, follower=follower)


@pytest.fixture(scope="module")
def pressed() -> SessionLog:
    return recorded(4.0)


@pytest.fixture(scope="module")
def felt() -> SessionLog:
    return recorded(4.0, grip="normal", clutch="3.2:3.6")


FAULTS = {"jitter": 0.01, "loss": 0.05, "outage": 0.3, "burst": 3.0, "stall": 0.05, "seed": 4}


@pytest.mark.parametrize(
    "changes",
    [pytest.param({}, marks=pytest.mark.long), FAULTS, {"leader_frame": "0.02,-1", "follower_frame": "0.1,-1"}],
    ids=str,
)
@pytest.mark.first
def test_under_its_own_settings_a_session_comes_out_bit_by_bit(changes: dict[str, Any]) -> None:
    log = recorded(2.5, **changes)
    out = again(log)
    assert_same(out, log)
    assert out.settings == log.settings | {"replay": "open loop"}


@pytest.mark.long
@pytest.mark.parametrize("closed_loop", [False, True])
def test_so_does_one_whose_hand_was_moved_whether_its_motion_is_fixed_now_or_it_answers(
    felt: SessionLog, closed_loop: bool
) -> None:
    out = again(felt, closed_loop=closed_loop)
    assert not felt.leader["engaged"][3700:3800].all()  # the clutch was pressed, and is again
    assert_same(out, felt)
    assert session_figures(out)["loop"].startswith("closed loop" if closed_loop else "open loop")


@pytest.mark.long
def test_a_longer_force_delay_makes_the_delayed_force_worse_and_the_prediction_little() -> None:
    pressed = recorded(8.0)
    before, after = session_figures(pressed), session_figures(again(pressed, force_delay=0.6))
    assert after["delayed_force_error_percent"] > 1.2 * before["delayed_force_error_percent"]
    late = {"score_from": 4.0}  # what was touched first is known one delay later
    before, after = (session_figures(log, **late) for log in (pressed, again(pressed, force_delay=0.6)))
    assert after["prediction_error_percent"] < 1.3 * before["prediction_error_percent"] + 1.0


@pytest.mark.long
def test_the_hand_goes_where_it_went_whatever_comes_of_it(pressed: SessionLog) -> None:
    out = again(pressed, model="kelvin-voigt", force_delay=0.1, loss=0.2, position_delay=0.2)
    np.testing.assert_array_equal(out.leader["hand_position"], pressed.leader["hand_position"])
    assert {model.law for model in out.models if model.valid} == {"kelvin-voigt"}
    assert out.settings["estimator"] != pressed.settings["estimator"]
    rows = out.rows()
    assert np.median(rows.follower["time_ns"] - rows.leader["time_ns"]) >= 200 * MS


@pytest.mark.long
def test_the_hand_gives_way_where_it_is_to_answer() -> None:
    pressed = recorded(8.0)
    out = again(pressed, closed_loop=True, grip="soft")
    pushed = out.leader["rendered_force"] > 0.5
    assert pushed.sum() > 500
    given = (out.leader["intended_position"] - out.leader["hand_position"])[pushed]
    assert np.median(given) > 1e-3  # half a newton or more against 150 N/m
    assert replay_notes(pressed, SessionSettings(grip="soft"), True)[:2] == (
        CLOSED_LOOP,
        "what the hand meant was not recorded: where it was is taken for that",
    )


def test_a_closed_loop_needs_a_hand_and_a_robot_that_answers(pressed: SessionLog, felt: SessionLog) -> None:
    with pytest.raises(SettingError, match="choose a grip of normal, soft, stiff"):
        again(pressed, closed_loop=True)
    with pytest.raises(SettingError, match="needs a material that answers"):
        again(on_a_real_robot(felt), closed_loop=True)


# --- robots that do not answer ----------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("changes", [{}, FAULTS], ids=str)
def test_a_real_robot_s_force_comes_with_its_commands_and_gives_the_same_prediction(changes: dict[str, Any]) -> None:
    log = on_a_real_robot(recorded(3.0, first_touch="follow", **changes))
    assert not material_answers(log)
    out = again(log)
    for name in ("predicted_force", "delayed_force", "rendered_force", "position"):
        np.testing.assert_array_equal(out.leader[name], log.leader[name][: out.leader.size], err_msg=name)
    np.testing.assert_array_equal(out.follower["sensor_force"], log.follower["sensor_force"])


@pytest.mark.long
@pytest.mark.parametrize("position_delay", [0.0, 0.03, 0.2])
def test_under_another_delay_true_and_predicted_force_stay_at_equal_command(position_delay: float) -> None:
    simulated = recorded(5.0, first_touch="follow")
    log = on_a_real_robot(simulated)
    out = again(log, position_delay=position_delay)
    rows, before = out.rows(), log.rows()
    offset = rows.leader["sequence"][200] - before.leader["sequence"][200]
    force = before.follower["sensor_force"][200 + offset : 3000 + offset]
    np.testing.assert_array_equal(rows.follower["sensor_force"][200:3000], force)
    # The simulated robot, which does follow, feels the same but for its noise.
    report, answered = session_figures(out), session_figures(again(simulated, position_delay=position_delay))
    for figure in ("prediction_error_percent", "delayed_force_error_percent"):
        assert report[figure] == pytest.approx(answered[figure], abs=1.5)


@pytest.mark.long
def test_what_was_not_believed_is_not_learnt_again_and_what_comes_after_is() -> None:
    log = recorded(4.5, first_touch="follow")
    follower = log.follower.copy()
    follower["validity"][2500:2600] = 3  # stuck, until somebody said that it was mended
    follower["sensor_force"][2500:2600] = 4.0
    out = again(on_a_real_robot(replace(log, follower=follower)))
    assert out.follower["validity"][2500:2600].all()
    assert not out.follower["validity"][3200:].any()
    assert session_figures(out)["prediction_error_percent"] < 40.0


@pytest.mark.long
def test_a_robot_that_somebody_else_moved_goes_its_way_again() -> None:
    log, _ = watched(SessionSettings(material="hunt-crossley"), 4.0)
    out = again(log)
    assert set(out.follower["status"]) == {Status.SHADOW}
    assert np.isnan(out.follower["desired_position"]).all()
    assert out.settings["operator"] == "shadow"
    # Its commands are heard one tick later than in the one process of the shadow.
    for kind in ("predicted_force", "delayed_force"):
        apart = np.abs(out.leader[kind] - log.leader[kind][: out.leader.size])
        assert np.percentile(apart, 99.0) < 0.1
    assert session_figures(out)["prediction_error_percent"] == pytest.approx(
        session_figures(log)["prediction_error_percent"], abs=1.0
    )


# --- recordings as they come ------------------------------------------------------------------------------------------


def test_a_session_in_real_time_is_replayed_on_an_even_clock(pressed: SessionLog) -> None:
    late = np.random.default_rng(0).random(pressed.leader.size) < 0.03
    leader, follower = pressed.leader[~late].copy(), pressed.follower.copy()
    leader["time_ns"] += 55_000_000_000
    follower["time_ns"] += 99_000_000_000
    leader["epoch"] = follower["epoch"] = 77
    leader["run"] = follower["run"] = 88
    log = replace(pressed, leader=leader, follower=follower)
    out = again(log)
    assert (np.diff(out.leader["time_ns"]) == MS).all()
    kept = np.flatnonzero(~late)
    np.testing.assert_allclose(out.leader["hand_position"][kept - kept[0]], leader["hand_position"], atol=1e-12)
    between = out.leader["hand_position"][: late.size - kept[0]] - pressed.leader["hand_position"][kept[0] :]
    assert np.abs(between).max() < 2e-6
    own, result = session_figures(pressed), session_figures(out)
    assert result["prediction_error_percent"] == pytest.approx(own["prediction_error_percent"], abs=1.5)
    assert "the session was in real time: its late ticks are not late again" in replay_notes(log, SessionSettings())


def test_a_recording_of_old_has_the_proxy_alone_and_one_that_was_cut_is_replayed_as_far_as_it_goes(
    pressed: SessionLog,
) -> None:
    leader = pressed.leader[:3000].copy()
    leader["hand_position"] = np.nan
    out = again(replace(pressed, leader=leader, follower=pressed.follower[:3003]))
    assert out.leader.size == 3000
    np.testing.assert_array_equal(out.leader["predicted_force"], pressed.leader["predicted_force"][:3000])


def test_a_side_or_a_motion_that_is_missing_is_said(pressed: SessionLog) -> None:
    still, idle = pressed.leader.copy(), on_a_real_robot(pressed).follower
    still["hand_position"] = still["position"] = np.nan
    idle["command_sequence"] = 0
    wrong: list[tuple[dict[str, Any], str]] = [
        ({"leader": pressed.leader[:0]}, "a side is missing"),
        ({"follower": pressed.follower[:0]}, "a side is missing"),
        ({"leader": still}, "no position of the operator's hand"),
        ({"settings": pressed.settings | {"scene": "torso"}}, "three dimensions"),
        ({"follower": idle}, "applied no command"),
    ]
    for changes, message in wrong:
        with pytest.raises(RecordingError, match=message):
            replay_under(replace(pressed, **changes), SessionSettings(material="hunt-crossley"))


def test_what_is_to_be_known_is_said(pressed: SessionLog, felt: SessionLog) -> None:
    settings = recorded_settings(pressed.settings)[0]
    assert replay_notes(pressed, settings) == (
        FIXED_MOTION,
        "the robot and its material (hunt-crossley) are simulated again",
    )
    stopped = replace(on_a_real_robot(felt), emergencies=(EmergencyStop(4, 1, 1, "asked for"),))
    output = " / ".join(replay_notes(stopped, recorded_settings(felt.settings)[0]))
    assert "the robot's motion is fixed too" in output
    assert "emergency stops are not given again" in output
    assert "the hand is where it was" in output
    assert (
        "recorded in a closed loop, and the hand does not answer here /" in output
    )  # nor could it: no material answers
    settings, advice = (
        recorded_settings(felt.settings)[0],
        "recorded in a closed loop, and the hand does not answer here: -",
    )
    assert advice in " / ".join(replay_notes(felt, settings))
    assert advice not in " / ".join(replay_notes(felt, settings, closed_loop=True))
    replayed = replace(felt, settings=felt.settings | {"replay": "open loop"})
    assert advice not in " / ".join(replay_notes(replayed, settings))


# --- settings ---------------------------------------------------------------------------------------------------------


def test_the_recorded_settings_are_those_of_the_session(felt: SessionLog) -> None:
    settings, notes = recorded_settings(felt.settings)
    assert settings == SessionSettings(
        material="hunt-crossley", grip="normal", clutch="3.2:3.6", device_damping=2.0, device_delay=5e-4
    )
    assert notes == ()


def test_changes_take_the_place_of_what_was_recorded_and_wrong_ones_are_refused_and_not_mended() -> None:
    texts = SessionSettings(model="kelvin-voigt", estimator="rls", seed=3).as_text()
    assert recorded_settings(texts, {"force_delay": 1.0})[0] == SessionSettings(
        model="kelvin-voigt", estimator="rls", seed=3, force_delay=1.0, device_damping=2.0, device_delay=5e-4
    )
    assert recorded_settings(texts, {"model": "contact-map"})[0] == SessionSettings(
        seed=3, device_damping=2.0, device_delay=5e-4
    )
    assert recorded_settings(texts, {"model": "kelvin-voigt"})[0].estimator == "rls"
    texts = SessionSettings(model="kelvin-voigt").as_text()
    with pytest.raises(UnknownNameError, match="'bank'"):
        recorded_settings(texts, {"estimator": "bank"})
    with pytest.raises(SettingError, match="force_delay"):
        recorded_settings(texts, {"force_delay": -1.0})


def test_what_a_material_answered_is_played_where_its_package_is_not_installed(pressed: SessionLog) -> None:
    log = replace(pressed, settings=pressed.settings | {"material": "a gel"})
    settings, notes = recorded_settings(log.settings)
    assert notes == ()
    again = replay_under(log, settings)
    assert again.settings["material"] == "a gel"
    assert "the robot's motion is fixed too" in " / ".join(replay_notes(log, settings))
    assert session_figures(log)["settings"]["material"] == "a gel"


@pytest.mark.long
def test_a_scene_of_a_material_whose_package_is_not_installed_is_not_run_again() -> None:
    log = simulate(SessionSettings(scene="plane", fusion="contact"), duration=0.1).log
    log = replace(log, settings=log.settings | {"material": "a gel"})
    with pytest.raises(RecordingError, match="was of the material 'a gel', which is not here to be simulated again"):
        replay_under(log, recorded_settings(log.settings)[0])


def test_what_is_missing_or_not_known_has_its_default_and_is_said() -> None:
    texts = SessionSettings(clutch="1:2", grip="soft").as_text() | {
        "model": "a-law-of-old",
        "jitter": "much",
        "operator": "a-device",
        "note": "no setting",
    }
    del texts["sensor_fault"]
    settings, notes = recorded_settings(texts)
    assert settings == SessionSettings(clutch="1:2", grip="soft", device_damping=2.0, device_delay=5e-4)
    assert "does not say sensor_fault" in notes[0]
    assert any("jitter = 'much'" in note for note in notes)
    assert any("model = 'a-law-of-old'" in note and "its default is taken" in note for note in notes)
    assert not any("operator" in note or "note" in note.split(" = ")[0] for note in notes)


@given(st.lists(st.integers(1, 400), min_size=2, max_size=60), st.integers(0, 2**31))
def test_a_played_hand_is_where_it_was_at_every_recorded_tick_and_between_them_on_the_way(
    gaps: list[int], seed: int
) -> None:
    random = np.random.default_rng(seed)
    leader = np.zeros(len(gaps), dtype=SessionLog.from_messages([]).leader.dtype)
    leader["time_ns"] = np.cumsum(gaps) * MS // 100 + 10**13
    leader["hand_position"] = random.normal(0.0, 0.01, len(gaps))
    leader["exact_hand_position"] = np.nan
    leader["intended_position"] = np.nan
    leader["engaged"] = random.random(len(gaps)) < 0.8
    played = PlayedOperator("somebody", leader)
    assert not played.closed_loop
    assert not np.isfinite(played.intention)
    met = False
    for row, after in zip(leader, [*leader[1:], leader[-1]], strict=True):
        now = int(row["time_ns"] - leader["time_ns"][0])
        assert played.read(now) == row["hand_position"]
        met = met or bool(row["engaged"])
        assert played.clutched == (met and not row["engaged"])
        half = int(after["time_ns"] - row["time_ns"]) // 2
        low, high = sorted((row["hand_position"], after["hand_position"]))
        assert low - 1e-15 <= played.read(now + half) <= high + 1e-15
    assert played.read(10**12) == leader["hand_position"][-1]
