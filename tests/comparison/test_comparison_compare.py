"""The comparison: every combination has its row, in parallel as in one process, with the reason where it failed."""

from __future__ import annotations

import json
import math
import os
import signal
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from foretouch import comparison
from foretouch.cli.app import app
from foretouch.comparison.cases import Case, load, simulate
from foretouch.comparison.combination import Combination, OnceLearnt, inseparable, measure, score_outside
from foretouch.comparison.parallel import run_all
from foretouch.errors import ForetouchError, InputError, SettingError, UnknownNameError
from foretouch.identification import (
    ESTIMATORS,
    ContactMap,
    Estimator,
    ExactKelvinVoigt,
    KelvinVoigtRLS,
    Learner,
    identify,
    make_estimator,
    predict,
)
from foretouch.models import HuntCrossley
from foretouch.quantities import Recording
from foretouch.recordings import read_recording, write_columns
from foretouch.report import Forces, delayed_force, forces_under_delay, score_prediction, time_to_accuracy

PAIR: dict[str, Any] = {"models": ("kelvin-voigt",), "estimators": ("rls",), "processes": 1}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Presses of a Hunt-Crossley material, and a recording that never touches anything."""
    made = tmp_path_factory.mktemp("recordings")
    time = np.arange(0.0, 4.0, 2e-3)
    random = np.random.default_rng(0)
    t = np.maximum(time - 1.0, 0.0)
    depth = 0.01 * (np.sin(2 * np.pi * 0.8 * t) * (0.7 + 0.3 * np.sin(2 * np.pi * 0.31 * t)) - 0.05)
    force = HuntCrossley(3000.0, 300.0, 1.4).force(depth, np.gradient(depth, time))
    noise = random.normal(0.0, 5e-3, time.size)
    for name, felt in (("press", force), ("air", np.zeros(time.size))):
        columns = {"time_s": time, "position_m": depth + 0.01, "force_N": felt + 0.3 + noise}
        write_columns(made / f"{name}.csv", columns)
    return made


def cases(folder: Path, *names: str) -> list[Case]:
    return [comparison.file_case(folder / f"{name}.csv") for name in names]


def test_every_law_is_compared_by_every_estimator_that_it_has() -> None:
    pairs = comparison.combinations()
    assert len(pairs) == sum(len(kinds) for kinds in ESTIMATORS.values()) == len(set(pairs))
    assert comparison.combinations(estimators=("offline",)) == [
        (model, "offline") for model in ESTIMATORS if "offline" in ESTIMATORS[model]
    ]
    assert comparison.combinations(("kelvin-voigt", "kelvin-voigt"), ("rls",)) == [("kelvin-voigt", "rls")]


def test_estimators_may_be_given_by_their_classes() -> None:
    pairs = comparison.combinations(estimators=[ExactKelvinVoigt, ContactMap])
    assert pairs == [("kelvin-voigt", "exact"), ("contact-map", "bank")]
    with pytest.raises(InputError, match="all classes, each of its own law, or all names"):
        comparison.combinations(estimators=[ExactKelvinVoigt, "rls"])
    with pytest.raises(InputError, match="all classes, each of its own law, or all names"):
        comparison.combinations(["kelvin-voigt"], [ExactKelvinVoigt])


@pytest.mark.long
def test_recordings_may_be_given_by_their_paths(folder: Path) -> None:
    path = folder / "press.csv"
    by_path = comparison.compare([path], estimators=[KelvinVoigtRLS], processes=1)
    by_case = comparison.compare([comparison.file_case(path)], models=["kelvin-voigt"], estimators=["rls"], processes=1)
    assert by_path == by_case
    assert by_path[0].status == "ok"


def test_names_that_are_not_there_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="unknown model 'jelly'"):
        comparison.combinations(("jelly",))
    with pytest.raises(UnknownNameError, match="unknown estimator for kelvin-voigt 'fprls'"):
        comparison.combinations(("kelvin-voigt",), ("fprls",))
    with pytest.raises(InputError, match="nothing to compare"):
        comparison.compare([])
    with pytest.raises(UnknownNameError):
        comparison.simulated_case("jelly")


@pytest.mark.parametrize(
    "setting",
    [
        {"delays": ()},
        {"delays": (-0.1,)},
        {"score_from": math.nan},
        {"score_from": 2.0, "score_to": 1.0},
        {"contact_floor": 0.0},
    ],
)
def test_scoring_out_of_range_is_refused(setting: dict[str, Any]) -> None:
    with pytest.raises(SettingError):
        comparison.Scoring(**setting)


def test_the_figures_are_those_of_identify_and_predict(folder: Path) -> None:
    (result,) = comparison.compare(cases(folder, "press"), **PAIR, scoring=comparison.Scoring((0.1, 0.3)))
    recording = read_recording(folder / "press.csv")
    fit = identify(recording, fresh(recording))
    assert result.status == "ok"
    assert result.residual_percent == 100.0 * fit.residual_rms / fit.contact_force_rms
    assert result.parameters == fit.parameters
    assert result.samples == 2000
    assert result.us_per_sample is not None
    assert 1.0 < result.us_per_sample < 5e3
    for prediction, delay in zip(result.predictions, (0.1, 0.3), strict=True):
        predicted = predict(recording, fresh(recording), delay=delay)
        expected = score_prediction(
            recording.time,
            recording.force,
            predicted.force,
            delayed_force(recording.time, recording.force, delay),
            contact_floor=recording.contact_floor,
            position=recording.position,
        )
        assert prediction.delay_s == delay
        assert prediction.prediction_error_percent == pytest.approx(expected.prediction_error_percent)
        assert prediction.largest_update_jump_N == np.abs(predicted.jump).max() > 0.0
        assert prediction.time_to_ten_percent_s == time_to_accuracy(
            recording.time, expected.measured_force, predicted.force, expected.in_contact
        )
        assert prediction.delayed_force_error_percent == pytest.approx(expected.delayed_force_error_percent)
        assert prediction.unforeseeable_percent is None


def fresh(recording: Any) -> Learner:
    return Learner(make_estimator("kelvin-voigt", "rls"), contact_floor=recording.contact_floor)


def test_a_combination_that_fails_stays_with_its_reason(folder: Path) -> None:
    (folder / "bad.csv").write_text("time_s,position_m,force_N\n0,0,1\n1,0,nan\n")
    results = comparison.compare(cases(folder, "air", "bad", "press"), **PAIR)
    assert [result.status for result in results] == ["failed", "failed", "ok"]
    assert "samples in contact, at least 50 are needed" in str(results[0].reason)
    assert "row 3" in str(results[1].reason)
    text = comparison.render_table(results)
    assert "failed: 0 samples in contact" in text
    assert "air.csv" in text
    json.dumps([result.as_row() for result in results], allow_nan=False)


def test_a_file_that_is_missing_or_is_none_fails_alone(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "text.csv").write_text("no numbers here")
    (tmp_path / "folder.csv").mkdir()
    files = (tmp_path / "no.csv", tmp_path / "folder.csv", tmp_path / "text.csv", folder / "press.csv")
    result = run(*files, "--models", "kelvin-voigt", "--estimators", "rls", "--estimators", "exact", "--json")
    assert result.exit_code == 0, result.exception
    rows = json.loads(result.stdout)["results"]
    assert [row["status"] for row in rows] == ["failed"] * 6 + ["ok"] * 2
    assert [rows[0]["reason"], rows[2]["reason"]] == ["no such file", "is no file"]
    results = comparison.compare(
        [comparison.file_case(file) for file in files[:2]], models=("kelvin-voigt",), processes=1
    )
    text = comparison.render_table(results)
    assert text.count("no such file") == text.count("is no file") == 1
    assert f"all {len(ESTIMATORS['kelvin-voigt'])} failed: no such file" in text
    assert run(files[0], "--models", "kelvin-voigt").exit_code == 1


def test_an_estimator_that_breaks_is_a_result(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = ESTIMATORS["kelvin-voigt"]["rls"]

    def broken(self: Any, sample: Any) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(kind, "update", broken)
    (result,) = comparison.compare(cases(folder, "press"), **PAIR)
    assert (result.status, result.reason) == ("failed", "ZeroDivisionError: by nothing")


@pytest.mark.long
def test_a_process_that_dies_takes_nothing_with_it_and_none_of_them_hears_ctrl_c_as_this_one_does() -> None:
    def deaf() -> bool:
        return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

    def work(job: int) -> tuple[int, bool]:
        if job == 2:
            os._exit(1)
        return 10 * job, deaf()

    assert deaf() is False
    shut_workers_down()  # those of another test began with another mask
    lost = dict(run_all(work, range(5), processes=2, lost=lambda job, reason: (-job, "died" in reason)))
    assert lost == {0: (0, True), 1: (10, True), 2: (-2, True), 3: (30, True), 4: (40, True)}
    assert deaf() is False


def shut_workers_down() -> None:
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown(wait=True)


@pytest.mark.long
def test_in_parallel_comes_out_what_comes_out_in_one_process(folder: Path) -> None:
    chosen = {"models": ("kelvin-voigt", "hunt-crossley"), "estimators": ("rls", "log-rls")}
    seen: list[tuple[int, int]] = []
    alone = comparison.compare(cases(folder, "press", "air"), **chosen, processes=1)
    beside = comparison.compare(
        cases(folder, "press", "air"),
        **chosen,
        processes=2,
        progress=lambda done, total, result: seen.append((done, total)),
    )
    assert [timeless(result) for result in alone] == [timeless(result) for result in beside]
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]


def timeless(result: comparison.Result) -> dict[str, Any]:
    return replace(result, us_per_sample=None).as_row()


def test_numbers_that_are_not_finite_are_none_in_json() -> None:
    result = comparison.Result("r", "m", "e", "ok", residual_percent=math.nan, parameters={"damping": math.inf})
    row = json.loads(json.dumps(result.as_row(), allow_nan=False))
    assert row["residual_percent"] is None
    assert row["parameters"] == {"damping": None}


def test_parameters_that_cannot_be_told_apart_are_named() -> None:
    parameters = {"stiffness": 100.0, "damping": 5.0, "exponent": 1.2, "switching": None, "b1": 1.0}
    errors = {"stiffness": 20.0, "damping": 6.0, "exponent": 0.4, "switching": None}
    sentences = inseparable(parameters, errors)
    assert [sentence.split()[0] for sentence in sentences] == ["damping", "exponent", "switching"]
    assert inseparable({"stiffness": 100.0}, None) == ()


# --- simulated --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def kelvin_voigt() -> comparison.Result:
    (result,) = comparison.compare([comparison.simulated_case("kelvin-voigt")], **PAIR)
    return result


def test_simulated_cases_of_a_seed_are_the_recordings_of_that_seed() -> None:
    chosen, others = comparison.simulated_cases(), comparison.simulated_cases(101)
    assert [case.name for case in others] == [case.name for case in chosen] == list(comparison.SIMULATED)
    tapping = next(case for case in others if case.name == "tapping")
    expected = comparison.simulate("tapping", seed=101).recording
    np.testing.assert_array_equal(load(tapping).recording.force, expected.force)
    assert not np.array_equal(load(comparison.simulated_case("tapping")).recording.force, expected.force)


def test_the_true_law_is_found_and_its_errors_are_small(kelvin_voigt: comparison.Result) -> None:
    assert kelvin_voigt.status == "ok"
    errors = {name: one.error for name, one in kelvin_voigt.parameter_errors.items()}
    assert errors.keys() == {"stiffness", "damping"}
    assert all(error is not None and abs(error) < 2.0 for error in errors.values())
    assert kelvin_voigt.parameter_errors["stiffness"].true == 6000.0
    assert kelvin_voigt.local_stiffness is not None
    assert kelvin_voigt.local_stiffness.true == pytest.approx(6000.0)
    assert abs(kelvin_voigt.local_stiffness.error_percent or 99.0) < 2.0
    (event,) = kelvin_voigt.convergence
    assert event.event_s > 1.0
    assert event.convergence_s is not None
    assert event.convergence_s < 0.3


def test_both_figures_are_given_with_and_without_what_cannot_be_told(kelvin_voigt: comparison.Result) -> None:
    (prediction,) = kelvin_voigt.predictions
    assert prediction.unforeseeable_percent is not None
    assert 2.0 < prediction.unforeseeable_percent < 30.0
    assert (prediction.foreseeable_prediction_error_percent or 99.0) < 3.0
    assert (prediction.foreseeable_delayed_force_error_percent or 0.0) > 30.0
    head = comparison.render_table([kelvin_voigt]).splitlines()[1]
    assert " ".join(head.split()) == "law estimator one step 0.3 s foreseeable us converged [s] dF/dx"


@pytest.mark.long
def test_long_delays_leave_convergence_as_it_is(kelvin_voigt: comparison.Result) -> None:
    job = Combination(
        comparison.simulated_case("kelvin-voigt"), "kelvin-voigt", "rls", comparison.Scoring((2.0,), score_from=4.0)
    )
    assert measure(job).convergence == kelvin_voigt.convergence


def test_samples_that_are_left_out_count_for_nothing() -> None:
    time = np.arange(0.0, 4.0, 1e-3)
    measured = np.where(time > 1.0, 2.0, 0.0) + 0.5
    predicted = np.where(time > 3.0, 20.0, np.where(time > 1.0, 2.1, 0.0))
    forces = Forces(time, time, measured, predicted, np.zeros(time.size), 0.05)
    window = {"score_from": 1.5, "score_to": None}
    assert score_outside(forces, time > 3.0, **window).prediction_error_percent == pytest.approx(5.0)
    assert score_outside(forces, time < 1.2, **window).scored_samples == 2500  # the window stays where it was
    assert (score_outside(forces, None, **window).prediction_error_percent or 0.0) > 500.0
    assert score_outside(forces, time >= 0.0, **window).status == "nothing_to_score"


def test_what_was_learnt_once_is_predicted_from_memory(folder: Path) -> None:
    recording = read_recording(folder / "press.csv")
    once = OnceLearnt(partial(make_estimator, "kelvin-voigt", "rls"), contact_floor=recording.contact_floor)
    for delay in (1.0, 0.0, 0.3):
        forces = forces_under_delay(recording, once.again(delay), delay)
        assert np.array_equal(forces.predicted, predict(recording, fresh(recording), delay=delay).force)
    assert len(once.memory) == len(recording)


@pytest.mark.long
def test_what_is_learnt_for_a_delay_is_learnt_anew_for_another_one() -> None:
    recording = simulate("tapping").recording
    recording = Recording(recording.time[:3000], recording.position[:3000], recording.force[:3000])
    learnings = 0

    def make() -> Estimator:
        nonlocal learnings
        learnings += 1
        return make_estimator("contact-map", "bank")

    once = OnceLearnt(make, contact_floor=recording.contact_floor)
    once.learn(recording)
    for delay in (0.05, 0.3, 0.5):
        forces = forces_under_delay(recording, once.again(delay), delay)
        alone = Learner(make_estimator("contact-map", "bank"), contact_floor=recording.contact_floor)
        assert np.array_equal(forces.predicted, predict(recording, alone, delay=delay).force)
    assert learnings == 3  # for 0.3 s at first, for 0.05 s, and for 0.3 s and all beyond


# --- the command ------------------------------------------------------------------------------------------------------


def run(*arguments: object) -> Any:
    """In this process: workers have tests of their own."""
    return CliRunner().invoke(app, ["compare", *map(str, arguments), *(("--jobs", "1") if arguments else ())])


def test_the_command_prints_a_table_and_writes_a_page(folder: Path, tmp_path: Path) -> None:
    options = ("--models", "kelvin-voigt", "--report", tmp_path / "page", "--delay", 0.1, "--delay", 0.3)
    result = run(folder / "press.csv", folder / "air.csv", *options)
    assert result.exit_code == 0, result.exception
    assert "All 2 recordings: median and worst" in result.stdout
    assert result.stderr.count(f" of {2 * len(ESTIMATORS['kelvin-voigt'])}  ") == 2 * len(ESTIMATORS["kelvin-voigt"])
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count("<figure>") == 5
    assert "failed" in page
    assert "samples in contact, at least 50 are needed" in page
    assert "http" not in page.replace("http://www.w3.org", "")


def test_the_command_prints_json(folder: Path) -> None:
    result = run(folder / "press.csv", "--models", "kelvin-voigt", "--estimators", "rls", "--json")
    assert result.exit_code == 0, result.exception
    (row,) = json.loads(result.stdout)["results"]
    assert row["recording"] == str(folder / "press.csv")
    assert row["predictions"][0]["delay_s"] == 0.3
    assert row["standard_errors"].keys() == row["parameters"].keys()


def test_the_command_fails_where_everything_failed(folder: Path) -> None:
    result = run(folder / "air.csv", "--models", "kelvin-voigt", "--estimators", "rls")
    assert result.exit_code == 1
    assert "failed" in result.stdout


def test_a_delay_as_long_as_the_recording_is_refused_once_for_all(folder: Path) -> None:
    result = run(folder / "press.csv", "--models", "kelvin-voigt", "--delay", 50)
    assert result.exit_code == 1
    assert f"all {len(ESTIMATORS['kelvin-voigt'])} failed: delay = 50.0: the recording is " in result.stdout


def test_the_command_without_recordings_is_refused() -> None:
    assert isinstance(run().exception, ForetouchError)


@pytest.mark.long
def test_a_session_is_predicted_on_the_leaders_motion(tmp_path: Path) -> None:
    session = tmp_path / "session.mcap"
    made = CliRunner().invoke(
        app, ["simulate", "--duration", "3", "--material", "kelvin-voigt", "--recording", str(session), "--json"]
    )
    assert made.exit_code == 0, made.exception
    predicted = CliRunner().invoke(
        app, ["predict", str(session), "--model", "kelvin-voigt", "--estimator", "rls", "--delay", "0.1", "--json"]
    )
    expected = json.loads(predicted.stdout)
    case = comparison.file_case(session)
    (result,) = comparison.compare([case], **PAIR, scoring=comparison.Scoring((0.1,)))
    assert result.predictions[0].prediction_error_percent == pytest.approx(expected["prediction_error_percent"])
    assert result.predictions[0].delayed_force_error_percent == pytest.approx(expected["delayed_force_error_percent"])
    assert load(case).log is not None
