"""Simulated sessions from the command line: reports, recordings, repetition, refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from typed_commands import output_of, refusal_of, run

from foretouch.cli.commands import sessions
from foretouch.cli.options import require_folder
from foretouch.errors import ForetouchError
from foretouch.messages import Hello
from foretouch.recordings import SessionWriter
from foretouch.settings import GROUPS, SETTINGS

REPORT_KEYS = {
    "contact_force_rms_N",
    "prediction_rmse_N",
    "prediction_error_percent",
    "delayed_force_error_percent",
    "rendered_error_percent",
    "within_jnd_percent",
    "phantom_force_rms_N",
    "max_rendered_force_N",
    "max_follower_force_N",
    "clipped_ticks",
    "messages",
    "recording",
    "status",
    "timing",
}


class Simulated(NamedTuple):
    """A session, its recording, and the folder of its page."""

    report: dict[str, Any]
    recording: Path
    page: Path


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    folder = tmp_path_factory.mktemp("simulated")
    path, page = folder / "s.mcap", folder / "out"
    options = ("--duration", 6, "--material", "hunt-crossley", "--recording", path, "--report", page)
    return Simulated(output_of("simulate", *options), path, page)


def test_the_report_keeps_its_contract(simulated: Simulated) -> None:
    report = simulated.report
    assert report.keys() >= REPORT_KEYS
    assert report["messages"].keys() >= {"sent", "lost", "late"}
    for side in ("leader", "follower"):
        for figure in ("period_ms", "compute_us"):
            assert report["timing"][side][figure].keys() == {"p50", "p99", "max"}
    assert report["status"] == "ok"
    assert 0.0 < report["max_rendered_force_N"] <= 10.0


@pytest.mark.long
def test_a_session_repeats_but_for_timing_and_paths(tmp_path: Path) -> None:
    def once(name: str) -> tuple[dict[str, Any], bytes]:
        path = tmp_path / name
        options = ("--duration", 2, "--seed", 4, "--jitter", 0.01, "--loss", 0.05, "--outage", 0.2)
        report = output_of("simulate", *options, "--recording", path)
        assert report.pop("recording") == str(path)
        del report["timing"], report["latency"]  # the leader's computing is the machine's
        return report, path.read_bytes()

    assert once("a.mcap") == once("b.mcap")


def test_predict_on_the_recording_gives_the_session_s_own_figures(simulated: Simulated) -> None:
    report, path = simulated.report, simulated.recording
    content = json.loads(run("predict", path, "--delay", 0.3, "--json").stdout)
    for figure in ("prediction_error_percent", "delayed_force_error_percent", "within_jnd_percent"):
        assert content[figure] == pytest.approx(report[figure], abs=0.1)
    assert content["scored_samples"] == report["scored_samples"]
    again = json.loads(run("report", path, "--json").stdout)
    for figure in REPORT_KEYS - {"timing", "recording"}:
        assert again[figure] == report[figure]
    assert json.loads(run("identify", path, "--json").stdout)["status"] == "ok"


def test_the_page_is_written(simulated: Simulated) -> None:
    page = (simulated.page / "index.html").read_text()
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    assert page.rstrip().endswith("</html>")


@pytest.mark.long
def test_a_recorded_hand_presses() -> None:
    report = output_of("simulate", "--duration", 5, "--operator", "recorded")
    assert report["operator"] == "recorded"
    assert report["contact_force_rms_N"] > 0.3


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("simulate", "--operator", "browser"), "operator = 'browser': needs real time"),
        (("simulate", "--material", "jelly"), "unknown material 'jelly': choose one of "),
        (("simulate", "--duration", "0"), "duration = 0.0: must be finite and above 0 s"),
        (("simulate", "--duration", "nan"), "duration = nan: must be finite and above 0 s"),
        (("simulate", "--duration", "inf"), "duration = inf: must be finite and above 0 s"),
        (("simulate", "--position-delay", "-0.1"), "position_delay = -0.1: must lie between 0 and 10"),
        (("simulate", "--loss", "3"), "loss = 3.0"),
        (("simulate", "--recording", "/proc/no/s.mcap"), "folder = '/proc/no': is not there: mkdir -p /proc/no"),
        (("simulate", "--recording", "s.csv"), "recording = 's.csv': must end with .mcap"),
        (("simulate", "--report", "/proc/no"), "folder = '/proc/no': cannot be written"),
        (("simulate", "--seed", "-1"), "seed = -1: must be finite and at least 0"),
        (("simulate", "--grip", "normal", "--device-mass", "-1"), "device_mass = -1.0: must lie between"),
        (
            ("simulate", "--grip", "soft", "--device-damping", "0"),
            "device_damping = 0.0: must be at least 0.001 N s/m with a grip",
        ),
        (("simulate", "--device-friction", "-1"), "device_friction = -1.0: must lie between 0 and 100"),
        (("simulate", "--largest-stiffness", "4001"), "delay at 1000 Hz carries at most b / (T / 2 + d) = 2000 N/m"),
        (
            ("simulate", "--grip", "soft", "--device-resolution", "1e-4", "--largest-stiffness", "2001"),
            "0.1 N of friction and an encoder count of 0.0001 m carries at most max(2 f, 0.1 N) / count = 2000 N/m",
        ),
        (("simulate", "--position-scale", "0"), "position_scale = 0.0: must lie between 0.01 and 100"),
        (("simulate", "--force-scale", "0"), "force_scale = 0.0: must lie between 0.01 and 100"),
        (("simulate", "--position-scale", "50"), "reaches this material by a scale of 0.09 to 10"),
        (("simulate", "--force-delay", "100"), "force_delay = 100.0: must lie between 0 and 10"),
        (("simulate", "--force-delay", "nan"), "force_delay = nan: must lie between 0 and 10"),
        (("simulate", "--guarded-force", "0.2"), "guarded_force = 0.2: must lie between 0.5 and 15 N: sensor noise"),
        (("simulate", "--grip", "soft", "--device-damping", "1e-9"), "device_damping = 1e-09: must be at least 0.001"),
        (("simulate", "--device-resolution", "0.01"), "device_resolution = 0.01: must lie between 0 and 0.001"),
        (("simulate", "--largest-stiffness", "-1"), "largest_stiffness = -1.0: must be finite and at least 0"),
        (
            ("simulate", "--grip", "soft", "--baseline", "delayed", "--largest-stiffness", "500"),
            "largest_stiffness = 500.0: is of models, and baseline = 'delayed' renders none: leave it at 0",
        ),
        (
            ("simulate", "--baseline", "delayed-tdpa", "--first-touch", "guarded"),
            "baseline = 'delayed-tdpa' never does: take follow",
        ),
        (("simulate", "--grip", "soft", "--clutch", "5:inf"), "clutch = '5:inf': must be START:END,START:END in"),
        (("simulate", "--grip", "firm"), "unknown grip 'firm': choose one of none, normal, soft, stiff"),
        (("simulate", "--first-touch", "never"), "unknown first touch 'never': choose one of auto, follow, guarded"),
        (("simulate", "--baseline", "tdpa"), "unknown baseline 'tdpa': choose one of delayed, delayed-tdpa, none"),
        (("simulate", "--grip", "soft", "--clutch", "5:3"), "clutch = '5:3': must be START:END,START:END in seconds"),
        (("simulate", "--clutch", "1:2"), "clutch = '1:2': needs a hand that presses it: choose a grip of"),
        (("simulate", "--leader-frame", "nonsense"), "leader_frame = 'nonsense': must be ORIGIN,DIRECTION: metres"),
        (("simulate", "--follower-frame", "0,2"), "follower_frame = '0,2': must be ORIGIN,DIRECTION: metres"),
        (("simulate", "--loss", "0.7", "--burst", "2"), "take at most 0.666, or burst = 1 for independent losses"),
        (
            ("teleop", "--grip", "soft", "--device-damping", "0"),
            "device_damping = 0.0: must be at least 0.001 N s/m with a grip",
        ),
        (("teleop", "--port", "70000"), "port = 70000: must be 0 to 65535"),
        (("teleop", "--material", "jelly"), "unknown material 'jelly'"),
        (("teleop", "--operator", "nobody"), "unknown operator 'nobody'"),
        (
            ("sweep", "--replay", "3", "--baseline", "foo"),
            "unknown baseline 'foo': choose one of delayed, delayed-tdpa, none",
        ),
        (("sweep", "--baseline", "delayed"), "baseline = 'delayed': is of the session to replay: give its number by"),
        (("follower",), "no endpoint: give --listen or --connect"),
        (("follower", "--listen", "tcp/0.0.0.0:7447"), "off this machine"),
        (("leader", "--connect", "7447"), "write it as tcp/HOST:PORT"),
        (("report", "/nowhere.mcap"), "/nowhere.mcap: cannot be read: No such file"),
        (("datasets", "fetch", "moon"), "unknown dataset 'moon': choose one of "),
        (("materials", "fit", "jelly"), "unknown fitted material 'jelly': choose one of foam-measured"),
    ],
)
def test_bad_input_is_refused_in_one_line(command: tuple[str, ...], message: str) -> None:
    result = run(*command)
    assert isinstance(result.exception, ForetouchError), result.output
    assert not list(Path.cwd().glob("*.csv"))
    assert message in str(result.exception)
    assert "\n" not in str(result.exception)


@pytest.mark.parametrize("command", ["simulate", "teleop", "leader", "follower"])
def test_help_has_every_option_under_its_heading(command: str) -> None:
    text = run(command, "--help").stdout
    sections = dict(section.split(":\n", 1) for section in text.split("\n\n") if ":\n" in section)
    assert list(sections) == ["Options", *GROUPS]
    for name, declared in SETTINGS.items():
        assert f"--{name.replace('_', '-')} " in sections[declared.group]
    assert "--duration" in sections["Options"]
    assert "--help" in sections["Options"]


def test_lists_are_printed() -> None:
    assert "foam-measured" in run("materials", "list").stdout
    assert "tue/a-foam" in run("datasets", "list").stdout
    assert json.loads(run("datasets", "list", "--json").stdout)["tue/a-foam"]["kind"] == "foam"
    assert json.loads(run("materials", "list", "--json").stdout).keys() >= {"foam-measured", "kelvin-voigt"}


@pytest.mark.parametrize(
    "command",
    [
        ("teleop", "--headless", "--duration", 1, "--recording", "no/such/s.mcap"),
        ("record", "no/such/s.mcap", "--connect", "tcp/127.0.0.1:1"),
        ("simulate", "--duration", 1, "--recording", "no/such/s.mcap"),
        ("simulate", "--duration", 1, "--report", "no/such/report"),
        ("teleop", "--headless", "--duration", 1, "--report", "no/such/report"),
    ],
    ids=lambda command: f"{command[0]} {command[-2]}",
)
def test_no_folder_is_made_where_none_was_asked_for(command: tuple[object, ...], tmp_path: Path) -> None:
    arguments = [str(tmp_path / word) if str(word).startswith("no/") else str(word) for word in command]
    assert f"{tmp_path}/no/such" in refusal_of(*arguments)
    assert not list(tmp_path.iterdir())


def test_folders_for_results_are_tried_and_not_left_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    for folder in (Path("out/of/three"), tmp_path / "out" / "beside" / "two", Path("there"), Path("there/two")):
        require_folder(folder)
    assert [path.name for path in tmp_path.rglob("*")] == ["there"]
    with pytest.raises(ForetouchError, match=r"there is no .*nowhere that it could be made in"):
        require_folder(Path(f"../{tmp_path.name}-nowhere/out"))


@pytest.mark.parametrize("command", ["simulate", "teleop"])
def test_a_refused_session_leaves_no_folder(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("trimesh")
    monkeypatch.chdir(tmp_path)
    Path("empty.stl").touch()
    refused = refusal_of(command, "--scene", "empty.stl", "--report", "out/of/two", "--duration", 1)
    assert "empty.stl: the file is empty" in refused
    assert [path.name for path in tmp_path.iterdir()] == ["empty.stl"]


@pytest.mark.parametrize(("failed", "why"), [(True, "failed for what stands above"), (False, "never began")])
def test_a_session_without_a_tick_of_its_leader_has_no_report_and_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], failed: bool, why: str
) -> None:
    path = tmp_path / "s.mcap"
    with SessionWriter(path) as writer:
        writer.write(Hello.of("follower", 1, 1, {"material": "sponge"}), 1)
    assert sessions._recorded(path, None, json_output=False, code=int(failed), remember=None).code == int(failed)
    assert capsys.readouterr().err == f"no report: the session {why}, and {path} holds no tick of a leader\n"
