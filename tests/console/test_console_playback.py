"""Recordings in the console: what is shown at a moment is what was recorded at it."""

from __future__ import annotations

import dataclasses
import os
import re
import time
from pathlib import Path

import numpy as np
import pytest
from console_driver import simulated_session

from foretouch.console.models_seen import figures_of
from foretouch.console.playback import NOT_YET, Library, Playback
from foretouch.errors import RecordingError
from foretouch.messages import LEADER_DTYPE, SessionLog, SettingsReport

pytest.importorskip("mujoco")
SECONDS = 5.0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SessionLog]:
    path = tmp_path_factory.mktemp("recordings") / "one.mcap"
    return path, simulated_session(path, SECONDS)


@pytest.mark.parametrize("moment", [0.0, 0.777, 2.5, 4.999, 99.0, -1.0, float("nan")])
def test_a_moment_shows_the_tick_that_was_recorded_at_it(recorded: tuple[Path, SessionLog], moment: float) -> None:
    log = recorded[1]
    shown = Playback(log)
    shown.go_to(moment)
    within = min(max(moment, 0.0), shown.duration) if np.isfinite(moment) else 0.0
    assert shown.now == within
    row = log.leader[round(within * 1000)]
    assert shown.leader is not None
    assert shown.leader.sequence == row["sequence"]
    assert shown.leader.predicted_force == row["predicted_force"]
    if row["telemetry_sequence"]:
        known = log.follower[log.follower["sequence"] == row["telemetry_sequence"]][0]
        assert shown.robot_position == known["position"]
        assert shown.telemetry is not None
        assert shown.telemetry.force == known["force"]
    else:
        assert shown.telemetry is None
    if row["model_sequence"]:
        assert shown.model is not None
        assert shown.model.sequence == row["model_sequence"]


def test_the_window_has_the_recorded_forces_and_the_exact_true_one(recorded: tuple[Path, SessionLog]) -> None:
    log = recorded[1]
    shown = Playback(log)
    shown.go_to(4.0)
    window = shown.window(3.0)
    assert (window.time >= -3.0).all()
    assert (window.time <= 0.0).all()
    index = np.rint((window.time + 4.0) * 1000).astype(int)
    np.testing.assert_array_equal(window.predicted, log.leader["predicted_force"][index])
    np.testing.assert_array_equal(window.delayed, log.leader["delayed_force"][index])
    np.testing.assert_array_equal(window.energy, log.leader["energy"][index])
    rows = log.rows()
    exact = dict(zip(rows.leader["sequence"].tolist(), rows.follower["exact_force"].tolist(), strict=True))
    for true, sequence in zip(window.true, log.leader["sequence"][index], strict=True):
        if int(sequence) in exact:
            assert true == exact[int(sequence)]
    assert np.isfinite(window.true).mean() > 0.9
    assert window.prediction_error < window.delayed_error
    # Commands take 80 ms there and answers 300 ms back; the play-out adds a few ticks.
    np.testing.assert_allclose(np.nanmedian(window.round_trip), 0.38, atol=0.005)


def test_models_over_time_are_those_that_the_leader_had(recorded: tuple[Path, SessionLog]) -> None:
    log = recorded[1]
    shown = Playback(log)
    shown.go_to(4.5)
    trace = shown.model_trace(3.0)
    assert len(trace.time) > 10
    assert (np.diff(trace.time) >= 0.1 - 1e-9).all()
    row = log.leader[round((4.5 + trace.time[-1]) * 1000)]
    model = next(model for model in log.models if model.sequence == row["model_sequence"])
    figures = figures_of(model, shown.model_depth)
    assert figures is not None
    assert trace.stiffness[-1] == figures.stiffness
    assert tuple(trace.parameters[-1]) == figures.parameters


def test_time_goes_on_while_it_is_played_and_ends_at_the_end(recorded: tuple[Path, SessionLog]) -> None:
    playback = Playback(recorded[1], name="one")
    playback.tick(100.0)
    assert playback.now == 0.0
    playback.play(True)
    playback.tick(100.0)
    playback.tick(100.5)
    assert playback.now == pytest.approx(0.5)
    playback.go_to(2.0)
    playback.tick(200.0)
    playback.tick(200.25)
    assert playback.now == pytest.approx(2.25)
    playback.play(False)
    playback.tick(300.0)
    assert playback.now == pytest.approx(2.25)
    playback.play(True)
    playback.tick(300.0)
    playback.tick(400.0)
    assert playback.now == playback.duration
    assert not playback.playing
    playback.play(True)
    assert playback.now == 0.0


def test_a_session_of_a_follower_alone_is_refused(recorded: tuple[Path, SessionLog]) -> None:
    alone = dataclasses.replace(recorded[1], leader=np.empty(0, LEADER_DTYPE))
    with pytest.raises(RecordingError, match="holds nothing of a leader"):
        Playback(alone)


@pytest.mark.long
def test_the_list_has_the_newest_first_and_what_is_broken_is_one_line(recorded: tuple[Path, SessionLog]) -> None:
    folder = recorded[0].parent
    whole = recorded[0].read_bytes()
    for age, (name, content) in enumerate(
        (("cut.mcap", whole[: len(whole) // 2]), ("text.mcap", b"no recording"), ("empty.mcap", b"")), 1
    ):
        (folder / name).write_bytes(content)
        os.utime(folder / name, (age, age))
    library = Library([folder])
    assert library.names() == ("one.mcap", "empty.mcap", "text.mcap", "cut.mcap")
    for name in ("text.mcap", "empty.mcap", "gone.mcap"):
        library.open(name)
        library.wait()
        assert library.playback is None
        assert library.note.startswith("This recording cannot be looked at: ")
        assert "\n" not in library.note
    library.open("cut.mcap")
    library.wait()
    assert library.note == "It ends before its session did."
    assert library.playback is not None
    assert 1.0 < library.playback.duration < SECONDS
    library.open("one.mcap")
    library.wait()
    assert library.note.startswith("Read in")
    assert library.playback.duration == pytest.approx(SECONDS, abs=0.002)
    library.close()
    assert library.playback is None
    assert Library([folder / "no such folder"]).names() == ()


def test_recordings_of_the_session_s_folder_and_of_the_current_one_are_listed_together(
    recorded: tuple[Path, SessionLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = recorded[0].read_bytes()
    (tmp_path / "out").mkdir()
    for age, name in enumerate(("oldest.mcap", "out/session.mcap", "newest.mcap"), 1):
        (tmp_path / name).write_bytes(whole)
        os.utime(tmp_path / name, (age, age))
    monkeypatch.chdir(tmp_path)
    library = Library([Path("out"), Path(), tmp_path])
    assert library.names() == ("newest.mcap", "out/session.mcap", "oldest.mcap")
    assert library.where == f"Of {tmp_path / 'out'} and {tmp_path}, the newest first."
    for name in library.names():
        library.open(name)
        library.wait()
        assert library.playback is not None
        assert library.playback.name == name
        library.close()


def test_the_recording_that_is_being_written_is_said_to_be_that(
    recorded: tuple[Path, SessionLog], tmp_path: Path
) -> None:
    whole = recorded[0].read_bytes()
    for name in ("now.mcap", "cut.mcap"):
        (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    library = Library([tmp_path])
    library.being_written = str(tmp_path / "out" / ".." / "now.mcap")
    (tmp_path / "out").mkdir()
    notes = {}
    for name in library.names():
        library.open(name)
        library.wait()
        notes[name] = library.note
    assert notes == {"now.mcap": NOT_YET, "cut.mcap": "It ends before its session did."}


@pytest.mark.long
def test_a_second_run_under_another_delay_stands_beside_the_recorded_one(recorded: tuple[Path, SessionLog]) -> None:
    library = Library([recorded[0].parent])
    library.run_again(0.0, 0.0, closed_loop=False)  # of nothing: nothing
    assert not library.busy
    library.open("one.mcap")
    library.wait()
    library.run_again(0.0, 0.05, closed_loop=False)
    assert library.busy
    notes = set()
    while library.busy:
        notes.add(library.note)
        time.sleep(0.02)
    percents = [
        int(result[1]) for note in notes if (result := re.fullmatch(r"Running it again … (\d+) %, \d+ s", note))
    ]
    assert len(percents) > 2
    assert max(percents) > 50
    library.run_again(0.0, 0.05, closed_loop=False)
    library.open("one.mcap")
    assert library.note == "Another recording is still being read."
    library.wait()
    assert library.playback is not None
    assert library.playback.other is not None, library.note
    assert "0.05 s back; the hand's motion is the recorded one" in library.note
    library.playback.go_to(4.0)
    shown, other = library.playback.window(3.0), library.playback.other.window(3.0)
    np.testing.assert_allclose(other.time, shown.time, atol=1e-6)
    assert np.nanmedian(other.round_trip) < 0.06
    assert other.delayed_error < shown.delayed_error
    library.run_again(0.0, 0.05, closed_loop=True)
    library.wait()
    assert library.note.startswith("It cannot be run again: ")  # nobody holds a device


def test_playback_shows_what_was_set_then(recorded: tuple[Path, SessionLog]) -> None:
    """A material that was chosen later is not that of now, nor is a delay that was set later."""
    log = recorded[1]
    leader, follower = log.leader.copy(), log.follower.copy()
    leader["epoch"] = follower["epoch"] = 5
    leader["run"] = follower["run"] = 105
    changed = int(leader["time_ns"][3000])
    output = (
        SettingsReport("follower", 105, 0, {"material": "foam", "position_delay": "0.08"}),
        SettingsReport("leader", 5, 0, {"grip": "none", "force_delay": "0.3"}),
        SettingsReport("leader", 5, changed, {"grip": "none", "force_delay": "0.6"}),
        SettingsReport("follower", 109, 0, {"material": "sponge", "position_delay": "0.08"}),
        SettingsReport("leader", 9, 0, {"grip": "normal", "force_delay": "0.6"}),
    )
    shown = Playback(
        dataclasses.replace(log, leader=leader, follower=follower, reports=output, settings={"grip": "normal"})
    )
    for moment, delay in ((1.0, 0.3), (2.9, 0.3), (3.1, 0.6), (1.0, 0.3)):
        shown.go_to(moment)
        assert shown.settings["material"] == "foam"
        assert shown.grip == ""
        assert shown.setting("force_delay", 0.0) == delay
