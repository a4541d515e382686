import importlib
import inspect
import json
import re
import shlex
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner, Result

import foretouch.report
from foretouch.cli import main
from foretouch.cli.app import app
from foretouch.errors import InputError
from foretouch.messages import SessionLog
from foretouch.recordings import read_session
from foretouch.sweep import Outcome, Plan, draw_case, replay_session, run_case, run_sweep
from foretouch.sweep.outcome import digest, log_of, measure
from foretouch.sweep.sweep import FILE_NAME, SHOWING, Store, read_store

PLAN = Plan(12, 2, 4.0)


def run(*words: str) -> Result:
    return CliRunner().invoke(app, words)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short sweep with its page."""
    path = tmp_path_factory.mktemp("sweep")
    result = run("sweep", "--quick", "--out", str(path), "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == bool(content["objections"]), result.output
    assert content["ours"]["sessions"] == 12
    assert content["delayed"]["sessions"] == content["delayed-tdpa"]["sessions"] == content["compared"]["sessions"] == 2
    return path


@pytest.fixture(scope="module")
def one(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of one session."""
    path = tmp_path_factory.mktemp("one")
    run_sweep(path, Plan(1, 0, 4.0), processes=1)
    return path


@pytest.fixture(scope="module")
def rows(folder: Path) -> dict[tuple[int, str], Outcome]:
    return read_store(folder / FILE_NAME)[1]


@pytest.mark.long
def test_every_session_ran_and_was_measured(rows: dict[tuple[int, str], Outcome]) -> None:
    assert len(rows) == 16
    for row in rows.values():
        assert not row.error
        assert row.digest
        assert row.elapsed_s > 0.0
        assert row.largest_hand_force_N is not None
        assert 0.0 <= row.largest_hand_force_N <= 10.0
        case = draw_case(row.number, duration=4.0)
        assert (row.duration_s, row.round_trip_s, row.options) == (case.duration, case.round_trip, case.options)


@pytest.mark.long
def test_ours_are_stable_and_keep_their_bounds(rows: dict[tuple[int, str], Outcome]) -> None:
    ours = [row for row in rows.values() if row.baseline == "none"]
    for row in ours:
        assert not row.objections, row.command
        assert row.stable
    felt = [row.error_percent for row in ours if row.error_percent is not None]
    assert felt
    assert float(np.median(felt)) < 50.0


@pytest.mark.long
def test_what_is_there_is_not_run_again(folder: Path, tmp_path: Path) -> None:
    lines = (folder / FILE_NAME).read_bytes().splitlines(keepends=True)
    other = tmp_path / FILE_NAME
    other.write_bytes(b"".join(lines[:-2]) + lines[-1][:40])  # ended in the middle of a line
    reports: list[tuple[int, int]] = []
    again = run_sweep(tmp_path, PLAN, processes=1, progress=lambda done, total, _: reports.append((done, total)))
    assert reports == [(15, 16), (16, 16)]
    stored = read_store(folder / FILE_NAME)[1]
    assert [(row.number, row.baseline) for row in again] == [(case.number, case.baseline) for case in PLAN.cases()]
    assert all(row.same_as(stored[row.number, row.baseline]) for row in again)
    assert len(other.read_bytes().splitlines()) == 17


@pytest.mark.long
def test_a_larger_sweep_goes_on_from_a_smaller(folder: Path) -> None:
    reports: list[int] = []
    run_sweep(folder, Plan(3, 0, 4.0), processes=1, progress=lambda done, *_: reports.append(done))
    assert reports == []


@pytest.mark.long
def test_any_session_replays_bit_identical(folder: Path, rows: dict[tuple[int, str], Outcome]) -> None:
    compared = next(number for number, baseline in rows if baseline == "delayed")
    for number, baseline in ((1, "none"), (compared, "delayed")):
        result = run("sweep", "--out", str(folder), "--replay", str(number), "--baseline", baseline, "--json")
        assert result.exit_code == 0, result.output
        content = json.loads(result.stdout)
        assert content["identical"] is True
        assert content["same_code"] is True
        assert content["differing"] == []
        assert content["command"] == rows[number, baseline].command
        assert content["again"]["digest"] == rows[number, baseline].digest


@pytest.mark.long
def test_its_command_is_the_same_session_too(folder: Path, tmp_path: Path) -> None:
    row = read_store(folder / FILE_NAME)[1][2, "none"]
    path = tmp_path / "again.mcap"
    result = run(*shlex.split(row.command)[1:], "--recording", str(path), "--json")
    assert result.exit_code == 0, result.output
    recorded, here = read_session(path), log_of(draw_case(2, duration=4.0))[0]
    for name in ("rendered_force", "hand_position", "energy", "position"):
        np.testing.assert_array_equal(recorded.leader[name], here.leader[name])
    np.testing.assert_array_equal(recorded.follower["exact_force"], here.follower["exact_force"])
    assert digest(here) == row.digest


@pytest.mark.long
def test_a_replay_that_differs_says_where(folder: Path, tmp_path: Path) -> None:
    header, stored = read_store(folder / FILE_NAME)
    store = Store(tmp_path, Plan(seed=header.seed, duration=header.duration_s))
    store.add(msgspec.structs.replace(stored[3, "none"], largest_hand_force_N=1.0))
    replayed = replay_session(tmp_path, 3)
    assert not replayed.identical
    assert replayed.differing == ["largest_hand_force_N"]
    assert "session 3: differs in largest_hand_force_N" in replayed.sentence
    assert run("sweep", "--out", str(tmp_path), "--replay", "3").exit_code == 1


@pytest.mark.long
def test_the_digest_sees_one_bit(folder: Path) -> None:
    log = log_of(draw_case(4, duration=4.0))[0]
    leader = log.leader.copy()
    leader["compute_ns"] += 1
    assert digest(SessionLog(leader, log.follower, log.models)) == digest(log)
    leader["rendered_force"][-1] = np.nextafter(leader["rendered_force"][-1], 1.0)
    assert digest(SessionLog(leader, log.follower, log.models)) != digest(log)


def test_a_session_that_fails_is_a_row_and_has_a_sentence() -> None:
    case = draw_case(5, duration=4.0)
    row = run_case(type(case)(case.number, 4.0, case.network, case.options | {"material": "nothing"}))
    assert row.objections == [f"failed: {row.error}"]
    assert "unknown material 'nothing'" in row.error


def test_a_broken_bound_a_large_jump_and_an_oscillating_hand_are_found() -> None:
    case = draw_case(2, duration=4.0)
    log, settings = log_of(case)[0], case.settings()
    assert run_case(case).objections == []

    def objections(name: str, change: object) -> list[str]:
        leader = log.leader.copy()
        leader[name] = change
        figures = measure(replace(log, leader=leader), settings)
        return Outcome(
            number=0, baseline="none", command="", duration_s=4.0, network="", round_trip_s=0.0, options={}, **figures
        ).objections

    account = "its account of energy is not the sum of its forces and positions"
    assert objections("energy", log.leader["energy"] - 1.0) == [account]
    assert objections("update_step", 0.2) == ["a model changes the force by 0.2 N in one tick"]
    time = log.leader["time_ns"] * 1e-9
    left = objections("hand_position", log.leader["hand_position"] - 0.1 * time)
    assert left[0].startswith("gives out")
    shaken = log.leader["exact_hand_position"] + 1e-3 * np.sin(2.0 * np.pi * 8.0 * time)
    assert objections("exact_hand_position", shaken) == ["the hand oscillates"]
    assert "a force is not finite" in objections("rendered_force", np.nan)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda lines: [lines[0].replace(b'"seed":0', b'"seed":7'), *lines[1:]], "made with --seed 7"),
        (lambda lines: [lines[0].replace(b'"duration_s":4', b'"duration_s":5'), *lines[1:]], "--duration 5"),
        (lambda lines: [lines[0].replace(b'"code":"', b'"code":"0'), *lines[1:]], "made by other code"),
        (lambda lines: [b"something else\n", *lines[1:]], "is no line of a sweep"),
        (lambda lines: [*lines[:2], b"{}\n"], "line 3: is no line of a sweep"),
    ],
)
def test_rows_of_another_sweep_are_refused_with_one_line(one: Path, tmp_path: Path, change: object, text: str) -> None:
    lines = (one / FILE_NAME).read_bytes().splitlines(keepends=True)
    (tmp_path / FILE_NAME).write_bytes(b"".join(change(lines)))  # type: ignore[operator]
    with pytest.raises(InputError, match=text) as caught:
        run_sweep(tmp_path, PLAN)
    assert "\n" not in str(caught.value)


def reached(module: str, room: str) -> set[str]:
    """Names of the modules of a room that one of them is made of."""
    text = inspect.getsource(importlib.import_module(module))
    imported = re.findall(rf"^from (foretouch\.{room}\.[\w.]+) import", text, re.M)
    return {module}.union(*(reached(name, room) for name in imported))


def test_rows_are_stale_by_what_made_them_and_by_nothing_that_only_shows_them() -> None:
    asked = (foretouch.report.hand_figures, foretouch.report.pair, foretouch.report.update_jumps)
    roots = {function.__module__ for function in asked} | {"foretouch.report.session"}  # that for its contact floor
    made = set().union(*(reached(root, "report") for root in roots))
    made |= reached("foretouch.sweep.outcome", "sweep") | reached("foretouch.sweep.sweep", "sweep")
    source = Path(foretouch.report.__file__).parents[1]
    for room in ("report", "sweep"):
        for path in (source / room).rglob("*.py"):
            name = path.relative_to(source).as_posix()
            module = ".".join(("foretouch", *Path(name).with_suffix("").parts))
            if path.stem != "__init__" and (room == "report" or module in made):
                assert (module in made) != name.startswith(SHOWING), name


def test_a_replay_of_nothing_is_refused(
    one: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for out, number, text in ((tmp_path, 0, "there is no sweep"), (one, 99, "has no session 99")):
        monkeypatch.setattr("sys.argv", ["foretouch", "sweep", "--out", str(out), "--replay", str(number)])
        with pytest.raises(SystemExit) as ended:
            main()
        assert ended.value.code == 2
        error = capsys.readouterr().err
        assert text in error
        assert len(error.splitlines()) == 1


@pytest.mark.long
def test_a_sweep_with_an_arm_is_a_folder_of_its_own_and_runs_again(tmp_path: Path) -> None:
    pytest.importorskip("mink")
    row = run_sweep(tmp_path, Plan(1, 0, 2.0, robot="fr3"), processes=1)[0]
    assert row.error == ""
    assert row.options["robot"] == "fr3"
    assert replay_session(tmp_path, 0).identical
    with pytest.raises(InputError, match=r"was made with --seed 0 --duration 2 --robot fr3; give another --out"):
        run_sweep(tmp_path, Plan(1, 0, 2.0), processes=1)
    with pytest.raises(InputError, match=r"nowhere\.xml: no such file"):
        run_sweep(tmp_path / "other", Plan(1, 0, 2.0, robot="nowhere.xml"), processes=1)
    assert not (tmp_path / "other").exists()


def test_a_folder_from_before_there_were_arms_is_one_of_the_plain_robot(one: Path) -> None:
    lines = (one / FILE_NAME).read_text().splitlines()
    assert '"robot":"simulated"' in lines[0]
    (one / "older").mkdir()
    older = one / "older" / FILE_NAME
    older.write_text("\n".join([lines[0].replace(',"robot":"simulated"', ""), *lines[1:]]) + "\n")
    assert Store(one / "older", Plan(duration=4.0)).rows.keys() == {(0, "none")}
