"""The commands on recordings, as a user types them: outputs, contracts, exit codes."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typed_commands import output_of, refusal_of, run

from foretouch.cli.commands import offline, sessions, studies
from foretouch.errors import ForetouchError, SettingError
from foretouch.identification import ESTIMATORS
from foretouch.models import HuntCrossley
from foretouch.recordings import read_recording, write_columns
from foretouch.session import SessionSettings
from foretouch.session.runners import warm_up
from foretouch.settings import DEFAULTS, KINDS, LAWS_HELP, SETTINGS

IDENTIFY_KEYS = {
    "model",
    "estimator",
    "parameters",
    "map",
    "standard_errors",
    "standard_errors_with_surface",
    "surface_m",
    "surface_error_m",
    "force_offset_N",
    "sensor_lag_s",
    "sensor_lag_error_s",
    "samples",
    "contact_samples",
    "residual_rms_N",
    "residual_percent",
    "status",
    "hint",
}
PARAMETERS = ["stiffness", "damping", "exponent", "switching"]
PREDICT_KEYS = {
    "delay_s",
    "samples",
    "scored_samples",
    "contact_force_rms_N",
    "prediction_rmse_N",
    "prediction_error_percent",
    "delayed_force_error_percent",
    "error_up_to_constant_percent",
    "within_jnd_percent",
    "phantom_force_rms_N",
    "largest_phantom_force_N",
    "within_one_deviation_percent",
    "within_two_deviations_percent",
    "missed_contact_percent",
    "force_zero_N",
    "force_zero_from",
    "largest_update_jump_N",
    "largest_update_jump_N_per_s",
    "largest_update_jump_at_s",
    "time_to_ten_percent_s",
    "status",
    "remarks",
}


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> Path:
    time = np.arange(0.0, 5.0, 1e-3)
    t = np.maximum(time - 1.0, 0.0)
    depth = 0.01 * (np.sin(2 * np.pi * 0.8 * t) * (0.7 + 0.3 * np.sin(2 * np.pi * 0.31 * t)) - 0.05)
    velocity = np.gradient(depth, time)
    law = HuntCrossley(3000.0, 300.0, 1.4)
    force = np.array([law.advance((), x, v, 1e-3)[1] for x, v in zip(depth, velocity, strict=True)])
    path = tmp_path_factory.mktemp("press") / "press.csv"
    write_columns(path, {"time_s": time, "position_m": depth + 0.01, "force_N": force + 0.3})
    return path


def test_identify_keeps_its_contract(press: Path) -> None:
    content = output_of("identify", press)
    assert content.keys() == IDENTIFY_KEYS
    assert list(content["parameters"]) == PARAMETERS
    assert sum(content["map"]["shares"].values()) == pytest.approx(1.0, abs=1e-3)
    assert content["status"] == "ok"
    assert content["hint"] is None
    assert content["samples"] == 5000
    assert content["force_offset_N"] == pytest.approx(0.3, abs=0.01)
    assert content["surface_m"] == pytest.approx(0.01, abs=1.5e-3)


def test_a_law_that_does_not_describe_the_recording_is_said_to(press: Path) -> None:
    """Its surface is said to be where the probe is almost deepest."""
    arguments = ("identify", press, "--surface", 0.018, "--model", "kelvin-voigt")
    content = output_of(*arguments)
    assert content["residual_percent"] > 50.0
    output = f"its residual is {content['residual_percent']:.0f} % of the force in contact; check the signs of force"
    assert output in content["hint"]
    assert run(*arguments).stdout.splitlines()[-1].strip() == content["hint"]


def test_a_force_that_falls_with_depth_has_a_status_and_a_hint(press: Path) -> None:
    content = output_of("identify", press, "--flip")
    assert content["status"] == "falls_with_depth"
    assert "give --flip-force if forces are negative under load, --flip if positions shrink" in content["hint"]
    assert run("identify", press, "--flip").stdout.splitlines()[-1].strip() == content["hint"]


@pytest.mark.long
def test_forces_that_are_negative_under_load_are_turned_round(press: Path, tmp_path: Path) -> None:
    recording = read_recording(press)
    turned = tmp_path / "turned.csv"
    columns = {"time_s": recording.time, "position_m": recording.position}
    write_columns(turned, columns | {"force_N": -recording.force})
    arguments = ("--model", "kelvin-voigt")
    assert output_of("identify", turned, "--flip-force", *arguments) == output_of("identify", press, *arguments)
    results = []
    for given in ((turned, "--flip-force"), (press,)):
        row = output_of("compare", *given, "--models", "kelvin-voigt", "--estimators", "rls")["results"][0]
        results.append([value for name, value in row.items() if name.endswith("percent")])
    assert results[0] == results[1] != []


@pytest.mark.long
def test_a_law_says_whether_its_errors_hold_that_of_the_surface(press: Path) -> None:
    arguments = ("identify", press, "--model", "kelvin-voigt", "--estimator")
    alone, both = (output_of(*arguments, name) for name in ("rls", "offline"))
    assert alone["standard_errors_with_surface"] is None
    assert both["standard_errors_with_surface"]["stiffness"] > both["standard_errors"]["stiffness"]
    assert "(each ± takes the surface for right: see surface)" in run(*arguments, "rls").stdout
    assert "(each ± holds that of the surface too)" in run(*arguments, "offline").stdout


def test_a_law_that_plays_no_part_in_the_force_is_said_to(press: Path) -> None:
    """Whose share of the contact map's force is 0 % as it is printed; a law alone is the force."""
    output = "(the law's weight in the force is 0 %: these numbers play no part in it)"
    text = run("identify", press).stdout
    assert "law 0 %" in text
    assert output in text
    assert output not in run("identify", press, "--model", "kelvin-voigt").stdout


def test_the_help_names_every_law() -> None:
    assert [law for law in ESTIMATORS if law not in LAWS_HELP] == []


def test_a_map_is_told_in_a_few_numbers(press: Path) -> None:
    content = output_of("identify", press, "--surface", 0.01)["map"]
    assert content["depth_visited_m"] == pytest.approx(0.0091, abs=5e-4)
    assert content["speed_visited_m_per_s"] == pytest.approx(0.05, rel=0.3)
    assert 0.0 < content["standard_deviation_N"] < 0.5
    columns = (content[name] for name in ("depths_m", "forces_N", "local_stiffness_N_per_m"))
    places = list(zip(*columns, strict=True))
    assert len(places) == 3
    for depth, force, stiffness in places:
        assert force == pytest.approx(3000.0 * depth**1.4, rel=0.1)
        assert stiffness == pytest.approx(1.4 * 3000.0 * depth**0.4, rel=0.15)
    other = output_of("identify", press, "--model", "continuous-switching")
    assert other["map"] is None
    assert other["estimator"] == "fprls"


def test_identify_writes_the_parameters_at_every_sample(press: Path, tmp_path: Path) -> None:
    given = ("--surface", 0.01, "--force-offset", 0.5)  # nothing is learnt again from there
    content = output_of("identify", press, *given, "--out", tmp_path / "p.csv")
    rows = list(csv.DictReader((tmp_path / "p.csv").read_text().splitlines()))
    assert len(rows) == 5000
    assert rows[0].keys() == {"time_s", "in_contact", *PARAMETERS}
    for name, value in content["parameters"].items():
        written = float(rows[-1][name])
        assert np.isnan(written) if value is None else written == value


PAIRS = [(model, name) for model in ESTIMATORS for name in ESTIMATORS[model]]


@pytest.mark.parametrize(
    ("model", "estimator"),
    [pytest.param(*pair, marks=pytest.mark.long) if pair[1] == "offline" else pair for pair in PAIRS],
)
@pytest.mark.first
def test_identify_takes_every_model_and_estimator(press: Path, model: str, estimator: str) -> None:
    content = output_of("identify", press, "--model", model, "--estimator", estimator)
    assert (content["model"], content["estimator"], content["status"]) == (model, estimator, "ok")
    errors = content["standard_errors"]
    assert errors is None or errors.keys() == content["parameters"].keys()


def test_undetermined_is_printed_so(tmp_path: Path) -> None:
    """A press without damping: nothing tells damping, exponent and switching apart."""
    time = np.arange(0.0, 6.0, 1e-3)
    depth = 0.01 * np.sin(2 * np.pi * 0.5 * np.maximum(time - 1.0, 0.0))
    force = 3000.0 * np.maximum(depth, 0.0) ** 1.4 + np.random.default_rng(0).normal(0.0, 0.02, time.size)
    path = tmp_path / "spring.csv"
    write_columns(path, {"time_s": time, "position_m": depth, "force_N": force})
    result = run("identify", path, "--model", "continuous-switching", "--estimator", "rls", "--surface", 0)
    assert result.exit_code == 0
    parameters = next(line for line in result.stdout.splitlines() if line.split()[0] == "parameters")
    assert "switching undetermined" in parameters
    assert "stiffness undetermined" not in parameters
    assert "None" not in result.stdout


@pytest.mark.parametrize("estimator", ["exact", "rls", "fprls"])
@pytest.mark.first
def test_what_is_undetermined_has_no_standard_error(tmp_path: Path, estimator: str) -> None:
    """A slow press under much noise: hardly anything of damping and exponents is told by it."""
    time = np.arange(0.0, 6.0, 1e-3)
    depth = 0.01 * np.sin(2 * np.pi * 0.5 * np.maximum(time - 1.0, 0.0))
    force = 900.0 * np.maximum(depth, 0.0) + np.random.default_rng(0).normal(0.0, 0.3, time.size)
    path = tmp_path / "noisy.csv"
    write_columns(path, {"time_s": time, "position_m": depth, "force_N": force})
    arguments = ("identify", path, "--model", "continuous-switching", "--estimator", estimator, "--surface", 0)
    content = output_of(*arguments)
    undetermined = [name for name, value in content["parameters"].items() if value is None]
    assert undetermined
    errors = content["standard_errors"]
    assert errors is None or all(errors[name] is None for name in undetermined)
    lines = run(*arguments).stdout.splitlines()
    assert not any(line.split()[0] in ("standard_errors", "surface_error_m", "sensor_lag_error_s") for line in lines)
    assert not any("None" in line for line in lines)


def test_predict_keeps_its_contract(press: Path, tmp_path: Path) -> None:
    out = tmp_path / "forces.csv"
    content = output_of("predict", press, "--delay", 0.3, "--out", out, "--surface", 0.01)
    assert content.keys() == PREDICT_KEYS
    assert content["status"] == "ok"
    assert content["delay_s"] == 0.3
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert list(rows[0]) == ["time_s", "measured_force_N", "predicted_force_N", "delayed_force_N", "in_contact"]
    assert len(rows) == content["samples"] == 5000
    measured = np.array([float(row["measured_force_N"]) for row in rows])
    delayed = np.array([float(row["delayed_force_N"]) for row in rows])
    np.testing.assert_allclose(delayed[300:], measured[:-300], atol=1e-12)
    assert {row["in_contact"] for row in rows} == {"0", "1"}


def test_a_delay_of_zero_leaves_no_delayed_error(press: Path) -> None:
    assert output_of("predict", press, "--delay", 0)["delayed_force_error_percent"] == pytest.approx(0.0)


def test_units_and_direction_change_nothing_but_the_numbers_in_the_file(press: Path, tmp_path: Path) -> None:
    table = np.genfromtxt(press, delimiter=",", names=True)
    path = tmp_path / "other.csv"
    columns = {"time_s": table["time_s"], "position_m": -1e3 * table["position_m"], "force_N": 1e3 * table["force_N"]}
    write_columns(path, columns)
    units = ("--position-unit", "mm", "--force-unit", "mN", "--flip")
    plain, other = (output_of("identify", *arguments) for arguments in ((press,), (path, *units)))
    for name in ("depths_m", "forces_N", "local_stiffness_N_per_m"):
        assert other["map"][name] == pytest.approx(plain["map"][name], rel=1e-3)
    for name, value in plain["parameters"].items():
        assert (other["parameters"][name] is None) == (value is None)
    assert other["contact_samples"] == plain["contact_samples"]


def test_a_recording_that_never_touches(tmp_path: Path) -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    random = np.random.default_rng(0)
    path = tmp_path / "air.csv"
    write_columns(
        path,
        {"time_s": time, "position_m": 0.01 * np.sin(time), "force_N": 0.2 + random.normal(0, 1e-3, time.size)},
    )
    content = output_of("predict", path)
    assert content["status"] == "no_contact"
    assert content["prediction_error_percent"] is None
    assert "samples in contact, at least 50 are needed" in refusal_of("identify", path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s,position_m\n0,0\n1,0\n", "press.csv, row 1: column force_N missing"),
        ("time_s,position_m,force_N\n0,0,1\n1,0,nan\n", "press.csv, row 3: force is nan"),
        ("time_s,position_m,force_N\n0,0,1\n1,inf,1\n", "press.csv, row 3: position is inf"),
        ("time_s,position_m,force_N\n1,0,1\n0,0,1\n", "press.csv, row 3: time 0 s does not come after the row before"),
        ("time_s,position_m,force_N\n0,0,1\n1,12.5,1\n", "press.csv, row 3: position 12.5 m is beyond 1 m"),
    ],
)
def test_a_bad_recording_is_refused_by_file_row_and_rule(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "press.csv").write_text(text)
    for command in ("identify", "predict"):
        assert message in refusal_of(command, tmp_path / "press.csv")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--delay", -0.1), "delay = -0.1: must be finite and at least 0"),
        (("--delay", 50), "delay = 50.0: the recording is 5 s long, and nothing would arrive before it ends"),
        (("--model", "jelly"), "unknown model 'jelly': choose one of contact-map"),
        (("--estimator", "guess"), "unknown estimator for contact-map 'guess': choose one of "),
        (("--surface", "deep"), "surface = 'deep': must be auto or a number"),
        (("--force-offset", "nan"), "force-offset = 'nan': must be auto or a number"),
        (("--position-unit", "miles"), "miles"),
        (("--score-from", 2, "--score-to", 1), "score_to = 1.0: must be later than score_from = 2 s"),
        (("--contact-floor", 0), "contact_floor = 0.0: must be above 0 N"),
    ],
)
def test_bad_options_are_refused(press: Path, options: tuple[object, ...], message: str) -> None:
    assert message in refusal_of("predict", press, *options)


def test_nothing_is_left_half_written(press: Path, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("time_s,position_m,force_N\n0,0,1\n1,0,nan\n")
    refusal_of("predict", tmp_path / "bad.csv", "--out", tmp_path / "out.csv")
    refusal_of("predict", press, "--out", tmp_path / "missing" / "out.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.csv"]
    before = press.read_bytes()
    for command in ("identify", "predict"):
        assert "is the recording itself" in refusal_of(command, press, "--out", press)
    assert press.read_bytes() == before


def test_a_refusal_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "foretouch", "predict", str(tmp_path / "no.csv")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr == f"foretouch: {tmp_path / 'no.csv'}: no such file\n"


@pytest.mark.parametrize(
    "command",
    [
        ("predict", "no.csv"),
        ("predict", "no.mcap"),
        ("predict", "bad.csv"),
        ("identify", "bad.csv"),
        ("identify", "press.csv", "--surface", "deep"),
        ("predict", "press.csv", "--sensor-lag", "9"),
        ("compare", "press.csv", "--models", "jelly"),
        ("reproduce", "--only", "fig99"),
        ("simulate", "--scene", "no.stl"),
        ("simulate", "--calibration", "no.toml"),
        ("leader", "--scene", "no.stl", "--connect", "tcp/127.0.0.1:1"),
    ],
    ids=" ".join,
)
def test_bad_input_is_refused_before_anything_is_compiled(
    command: tuple[str, ...], press: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compiled(*_: object, **__: object) -> bool:
        pytest.fail("compiled")

    for module in (offline, studies, sessions):
        monkeypatch.setattr(module, "compile_first", compiled)
    monkeypatch.setattr(warm_up, "compile_all", compiled)
    (tmp_path / "bad.csv").write_text("time_s,position_m\n0,0\n1,0\n")
    (tmp_path / "press.csv").write_bytes(press.read_bytes())
    refusal_of(*(tmp_path / word if Path(word).suffix in (".csv", ".mcap") else word for word in command))


def test_session_options_are_the_fields_and_defaults_of_the_settings() -> None:
    assert SessionSettings(**DEFAULTS) == SessionSettings()
    assert SETTINGS.keys() == SessionSettings().as_text().keys()
    for name, declared in SETTINGS.items():
        assert f"    {name}: {declared.sentence}" in str(SessionSettings.__doc__)
        for rule, bound in declared.bounds.items():
            beyond = bound + 1.0 if rule == "at_most" else bound - 1.0
            with pytest.raises(SettingError, match=rf"^{name} = .*{bound:g}"):
                SessionSettings(**{name: float(beyond) if KINDS[name] != "int" else int(beyond)})
    assert SessionSettings().estimator == "bank"
    assert SessionSettings(model="continuous-switching").estimator == "fprls"


@pytest.mark.long
def test_every_measured_press_is_predicted(measured: Any) -> None:
    for name in ("tue/a-foam", "tue/a-spring", "tue/a-rigid"):
        content = output_of("predict", measured(name), "--delay", 0.3)
        assert content["contact_force_rms_N"] > 1.0
        assert content["prediction_error_percent"] > 0.0
        assert 70.0 < content["delayed_force_error_percent"] < 110.0
        assert content["status"] == ("offset_unobservable" if "spring" in name else "ok")
    assert output_of("predict", measured("tue/a-free-motion"))["status"] == "no_contact"
    skin = output_of("predict", measured("aurora/400-mN"), "--delay", 0.02, "--score-from", 0.5, "--score-to", 1.6)
    assert skin["status"] == "ok"


@pytest.mark.long
def test_a_measured_recording_is_named_instead_of_a_file(measured: Callable[[str], Path], tmp_path: Path) -> None:
    name, law = "tue/b-foam", ("--model", "kelvin-voigt", "--estimator", "rls")
    for command in ("identify", "predict"):
        assert output_of(command, "--dataset", name, *law) == output_of(command, measured(name), *law)
    output = run("predict", "--dataset", name, *law, "--report", tmp_path / "page")
    assert output.stdout.startswith(f"{name}: kelvin-voigt by rls")
    assert name in (tmp_path / "page" / "index.html").read_text()
    matches = output_of(
        "compare", "--dataset", name, "--dataset", "tue/a-rigid", "--models", "kelvin-voigt", "--estimators", "rls",
        "--jobs", 1,
    )  # fmt: skip
    assert [row["recording"] for row in matches["results"]] == [name, "tue/a-rigid"]


@pytest.mark.parametrize("command", ["identify", "predict"])
def test_one_recording_is_given_and_no_more(command: str) -> None:
    for arguments, output in (
        ((), "RECORDING = 'nothing': give a file, or --dataset with a name of `foretouch datasets list`"),
        (("press.csv", "--dataset", "tue/b-foam"), "dataset = 'tue/b-foam': press.csv is given too: give one of them"),
        (("--dataset", "foam"), "unknown dataset 'foam': choose one of aurora/100-mN, "),
    ):
        refusal = run(command, *arguments).exception
        assert isinstance(refusal, ForetouchError)
        assert output in str(refusal)


def test_the_lag_of_a_filtered_sensor_is_found_and_can_be_waited_for(measured: Callable[[str], Path]) -> None:
    """The logged force of this spring went through a low-pass near 50 Hz, which is about 3 ms late."""
    logged = ("identify", measured("tue/d-spring"), "--force-channel", "logged", "--json")
    result = json.loads(run(*logged).stdout)
    assert result["sensor_lag_s"] == pytest.approx(0.003, abs=0.001)
    assert result["sensor_lag_error_s"] < 0.001
    assert json.loads(run(*logged, "--sensor-lag", 0.003).stdout)["sensor_lag_s"] < 0.001
    refused = run(*logged, "--sensor-lag", 0.9)
    assert isinstance(refused.exception, ForetouchError)
