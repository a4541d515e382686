"""`foretouch replay`: a recording again, what it prints, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typed_commands import run

from foretouch.errors import InputError, RecordingError, SettingError, UnknownNameError
from foretouch.messages import encode
from foretouch.recordings import read_session


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of four simulated seconds."""
    path = tmp_path_factory.mktemp("replay") / "session.mcap"
    made = run("simulate", "--duration", 4, "--material", "hunt-crossley", "--recording", path, "--jitter", 0.005)
    assert made.exit_code == 0, made.exception
    return path


@pytest.mark.long
def test_without_options_both_are_the_same(session: Path, tmp_path: Path) -> None:
    out = tmp_path / "again.mcap"
    result = run("replay", session, "--json", "--recording", out)
    assert result.exit_code == 0, result.exception
    content = json.loads(result.stdout)
    assert content["settings"] == {}
    assert "motion is fixed" in content["motion"]
    differing = {
        name
        for name, value in content["recorded"].items()
        if value != content["replayed"][name] and name not in ("timing", "settings")
    }
    assert differing == set()
    written, log = read_session(out), read_session(session)
    for table, expected in ((written.leader, log.leader), (written.follower, log.follower)):
        for name in set(expected.dtype.names) - {"compute_ns"}:
            np.testing.assert_array_equal(table[name], expected[name], err_msg=name)
    assert list(map(encode, written.models)) == list(map(encode, log.models))
    assert written.counts == log.counts
    assert written.settings == log.settings | {"replay": "open loop"}


@pytest.mark.long
def test_what_is_given_is_otherwise_and_the_rest_is_as_recorded(session: Path, tmp_path: Path) -> None:
    arguments = ("--force-delay", 0.6, "--jitter", 0, "--model", "continuous-switching", "--report", tmp_path)
    result = run("replay", session, *arguments)
    assert result.exit_code == 0, result.exception
    first = result.stdout.splitlines()
    assert first[1] == "Replay in an open loop."
    assert first[2].startswith("The operator's motion is fixed: ")
    assert (tmp_path / "index.html").exists()
    content = json.loads(run("replay", session, *arguments, "--json").stdout)
    assert content["settings"] == {
        "force_delay": {"recorded": "0.3", "replayed": "0.6"},
        "jitter": {"recorded": "0.005", "replayed": "0.0"},
        "model": {"recorded": "contact-map", "replayed": "continuous-switching"},
        "estimator": {"recorded": "bank", "replayed": "fprls"},
    }
    assert content["replayed"]["settings"]["seed"] == content["recorded"]["settings"]["seed"]
    ratio = content["replayed"]["delayed_force_error_percent"] / content["recorded"]["delayed_force_error_percent"]
    assert ratio > 1.1


@pytest.mark.long
def test_a_hand_answers(session: Path) -> None:
    result = run("replay", session, "--closed-loop", "--grip", "normal")
    assert result.exit_code == 0, result.exception
    assert "The hand answers" in result.stdout
    assert "was taken" not in result.stdout
    assert "where it was is taken for that" in result.stdout
    assert "stable" in result.stdout


@pytest.mark.long
def test_a_recording_that_was_cut_is_replayed_as_far_as_it_goes(session: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(session.read_bytes()[: session.stat().st_size // 2])
    result = run("replay", cut, "--force-delay", 0.1)
    assert result.exit_code == 0, result.exception
    assert "was not ended by its recorder" in result.stderr
    assert "error of the delayed force" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "kind", "words"),
    [
        (["--estimator", "wrong"], UnknownNameError, "choose one of bank"),
        (["--model", "wrong"], UnknownNameError, "choose one of"),
        (["--force-delay", "11"], SettingError, "force_delay"),
        (["--loss", "2"], InputError, "loss"),
        (["--grip", "soft"], SettingError, "--closed-loop"),
        (["--closed-loop"], SettingError, "choose a grip"),
        (["--recording", "again.csv"], SettingError, "must end with .mcap"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(
    session: Path, arguments: list[str], kind: type[Exception], words: str
) -> None:
    result = run("replay", session, *arguments)
    assert isinstance(result.exception, kind)
    assert words in str(result.exception)
    assert "\n" not in str(result.exception)


def test_what_is_no_session_is_refused(session: Path, tmp_path: Path) -> None:
    press = tmp_path / "press.csv"
    press.write_text("time_s,position_m,force_N\n0,0,0\n")
    for path, words in (
        (press, "foretouch predict"),
        (tmp_path / "none.mcap", "No such file"),
        (tmp_path / "wrong.mcap", "is not an MCAP file"),
    ):
        if path.name == "wrong.mcap":
            path.write_bytes(b"something else, and long enough")
        result = run("replay", path)
        assert isinstance(result.exception, RecordingError)
        assert words in str(result.exception)
    result = run("replay", session, "--recording", session)
    assert isinstance(result.exception, SettingError)
    assert session.stat().st_size > 100_000
