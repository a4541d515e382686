"""The lap in simulated time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import config

from foretouch.devices import Device
from foretouch.identification import ESTIMATORS, Learner, make_estimator
from foretouch.messages import SessionLog, encode
from foretouch.models import Predictor
from foretouch.recordings import SessionWriter, read_session
from foretouch.report import session_figures
from foretouch.robot import MATERIALS, make_robot
from foretouch.session import SessionSettings, SimulatedSession, replay, simulate
from foretouch.session.runners.warm_up import KERNELS, warm_up


def run(duration: float = 6.0, *, record: Path | None = None, **changes: Any) -> SimulatedSession:
    settings = SessionSettings(**changes)
    if record is None:
        return simulate(settings, duration=duration)
    with SessionWriter(record) as writer:
        session = simulate(settings, duration=duration, record=writer.write)
        writer.close(session.log.counts)
    return session


@pytest.fixture(scope="module")
def session() -> SimulatedSession:
    return run(6.5, material="hunt-crossley")


def without_timing(log: SessionLog) -> list[np.ndarray[Any, Any]]:
    tables = (log.leader, log.follower)
    return [table[name] for table in tables for name in table.dtype.names if name != "compute_ns"]


FAULTS = {"jitter": 0.01, "loss": 0.05, "outage": 0.3, "seed": 5}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedSession, Path]:
    path = tmp_path_factory.mktemp("recorded") / "a.mcap"
    session = run(2.0, record=path, **FAULTS)
    assert session.log.leader["predicted_force"].any()
    return session, path


def test_it_repeats_to_the_last_bit(recorded: tuple[SimulatedSession, Path], tmp_path: Path) -> None:
    first, path = recorded
    assert run(2.0, record=tmp_path / "b.mcap", **FAULTS) == first
    assert (tmp_path / "b.mcap").read_bytes() == path.read_bytes()


def test_the_recording_holds_the_session(recorded: tuple[SimulatedSession, Path]) -> None:
    log, path = recorded[0].log, recorded[1]
    read = read_session(path)
    for one, other in zip(without_timing(log), without_timing(read), strict=True):
        np.testing.assert_array_equal(one, other)
    assert list(map(encode, read.models)) == list(map(encode, log.models))  # no number is one, too
    assert read.settings == log.settings
    assert read.counts == log.counts


@pytest.mark.long
def test_its_columns_are_those_of_its_log(session: SimulatedSession) -> None:
    own, of_the_log = session.to_numpy(), session.log.to_numpy()
    for name in of_the_log.dtype.names:
        np.testing.assert_array_equal(own[name], of_the_log[name])
    assert len(session.to_pandas()) == session.log.rows().leader.size
    assert session.plot("predicted_force").axes


def test_commands_and_models_take_their_delays_and_models_come_fifty_times_a_second_or_at_once_on_change(
    session: SimulatedSession,
) -> None:
    log = session.log
    rows = log.rows()
    transit = rows.follower["time_ns"] - rows.leader["time_ns"]
    assert set(transit.tolist()) == {80_000_000}
    assert rows.never_applied == 80
    sent = {model.sequence: model.time_ns for model in log.models}
    arrived = np.unique(log.leader["model_sequence"], return_index=True)
    ages = [int(log.leader["time_ns"][i]) - sent[s] for s, i in zip(*map(np.ndarray.tolist, arrived), strict=True) if s]
    assert min(ages) == max(ages) == 300_000_000
    gaps = np.diff([model.time_ns for model in session.log.models])
    assert np.median(gaps) == 20_000_000
    assert gaps.max() == 20_000_000
    assert gaps.min() < 20_000_000


def test_predicting_the_recording_gives_the_session_s_own_figure(session: SimulatedSession) -> None:
    again = replay(session.log, Learner(make_estimator("contact-map", "bank")), delay=0.3)
    np.testing.assert_array_equal(again.predicted.force, session.log.leader["predicted_force"])
    np.testing.assert_array_equal(again.predicted.standard_deviation, session.log.leader["standard_deviation"])
    np.testing.assert_array_equal(again.predicted.jump, session.log.leader["model_jump"])
    late = session.log.leader["telemetry_sequence"] > 0
    np.testing.assert_array_equal(again.delayed[late], session.log.leader["delayed_force"][late])


@pytest.mark.parametrize(
    "material", [pytest.param(name, marks=[] if name in ("sponge", "bone") else pytest.mark.long) for name in MATERIALS]
)
@pytest.mark.first
def test_every_material_is_pressed_within_the_clamps(material: str) -> None:
    log = run(3.5, material=material, seed=3).log
    assert log.follower["in_contact"].any()
    assert np.isfinite(log.follower["force"]).all()
    assert np.isfinite(log.leader["predicted_force"]).all()
    assert log.leader["rendered_force"].min() >= 0.0
    assert log.leader["rendered_force"].max() <= 10.0
    assert np.diff(log.leader["rendered_force"]).max() <= 0.2 + 1e-9  # down, energy may ask for more
    assert log.follower["exact_force"].max() <= 1.1 * 15.0


def test_the_robot_follows_within_two_milliseconds_where_it_has_been_before_and_compensation_leaves_the_exact_force(
    session: SimulatedSession,
) -> None:
    tracking = session_figures(session.log, score_from=5.0)["tracking_error"]
    assert 0.0 < tracking["lag_ms"] <= 2.0
    assert tracking["rms_mm"] < 0.1
    follower = session.log.follower[1500:]
    error = follower["force"] - follower["exact_force"]
    assert abs(error.mean()) < 0.03
    assert error.std() < 0.06


@pytest.mark.long
def test_faults_are_counted() -> None:
    log = run(3.0, loss=0.1, jitter=0.005, seed=2).log
    lost = log.counts["commands_lost"] / log.counts["commands_sent"]
    assert 0.07 < lost < 0.13
    assert log.counts["commands_late"] > 0
    assert log.counts["telemetry_lost"] > 200
    assert session_figures(log)["messages"]["lost"] == sum(
        n for name, n in log.counts.items() if name.endswith("_lost")
    )


@pytest.mark.parametrize("jitter", [0.005, *(pytest.param(jitter, marks=pytest.mark.long) for jitter in (0.0, 0.0005))])
@pytest.mark.long
def test_the_network_s_jitter_does_not_shake_what_the_follower_feels(jitter: float) -> None:
    log = run(5.0, material="hunt-crossley", jitter=jitter, seed=1).log
    learnt = log.follower[log.follower["command_sequence"] > 0]
    air = learnt[learnt["exact_force"] == 0.0]
    assert air["sensor_force"].std() < 0.05
    assert log.models[-1].surface == pytest.approx(0.010, abs=1.5e-3)
    assert not air["in_contact"][:500].any()
    assert np.mean(learnt["in_contact"] == (learnt["exact_force"] > 0.0)) > 0.9


class Still(Device):
    name = "still"
    closed_loop = False

    def read(self, now_ns: int) -> float:
        return 0.0

    def render(self, force: float) -> float:
        return force


def test_a_still_hand_in_free_air_feels_nothing() -> None:
    robot = make_robot("foam-measured", seed=0, sensor_noise=0.005)
    log = simulate(SessionSettings(), duration=2.0, operator=Still(), robot=robot).log
    assert log.leader["rendered_force"].max() == 0.0
    assert not log.follower["in_contact"].any()
    report = session_figures(log, score_from=0.0)
    assert report["status"] == "no_contact"
    assert report["prediction_error_percent"] is None


NEW = """
import sys
import foretouch
from numba.core import event

made = []

class Noted(event.Listener):
    def on_start(self, event): pass
    def on_end(self, event): made.append(str(event.data["dispatcher"]))

settings = foretouch.SessionSettings(material="hunt-crossley", operator="scripted", **eval(sys.argv[1]))
foretouch.warm_up(settings)
event.register("numba:compile", Noted())
log = foretouch.simulate(settings, duration=4.6 if settings.scene else 2.5).log
if not settings.scene:
    press = foretouch.Recording(1e-9 * log.follower["time_ns"], log.follower["position"], log.follower["force"])
    foretouch.predict(press, foretouch.Learner(settings.make_estimator()), delay=0.1)
assert log.follower["force"].max() > 1.0, "nothing was touched"
print(len(made), made)
"""


@pytest.mark.parametrize(
    "options",
    [
        {"grip": "normal"},
        pytest.param({"scene": "phantom", "fusion": "contact"}, marks=pytest.mark.long),
        pytest.param({}, marks=pytest.mark.long),
        pytest.param({"model": "continuous-switching"}, marks=pytest.mark.long),
    ],
    ids=str,
)
@pytest.mark.long
def test_a_warm_session_compiles_nothing(options: dict[str, str]) -> None:
    if config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    done = subprocess.run([sys.executable, "-c", NEW, str(options)], capture_output=True, text=True, check=False)
    assert done.stdout == "0 []\n", done.stderr[-400:]


COLD = """
import sys
from foretouch.session.runners.warm_up import compile_all, compiled_share, is_compiled

said = []
assert not is_compiled()
assert compile_all(said.append)
assert is_compiled() and compiled_share() is None
assert compile_all(lambda share: 1 / 0)  # there is nothing left to say
assert said == sorted(said) and said[-1] == 1.0, said
assert said[len(said) // 2] < 0.8, said  # it is told five times a second: half of the time is half of the way
print(said[-2])
"""


@pytest.mark.long
def test_everything_is_compiled_once_in_an_empty_folder(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    both = [
        subprocess.Popen([sys.executable, "-c", COLD], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    shares = [float(process.communicate()[0]) for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert min(shares) > 0.9, f"KERNELS = {KERNELS} is no longer what is compiled"
    kept = sorted(path.name for path in tmp_path.rglob("*.nbc"))
    for options in ({}, {"grip": "normal"}, {"scene": "phantom", "fusion": "contact"}):
        done = subprocess.run(
            [sys.executable, "-c", NEW, str(options)], env=environment, capture_output=True, text=True
        )
        assert done.stdout == "0 []\n", done.stderr[-400:]
    assert sorted(path.name for path in tmp_path.rglob("*.nbc")) == kept


@pytest.mark.parametrize(
    ("model", "estimator"), [(model, name) for model in ESTIMATORS for name in ESTIMATORS[model] if name != "offline"]
)
@pytest.mark.first
def test_everything_is_run_once_before_a_loop_begins(
    model: str, estimator: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    forces: list[float] = []
    update = Predictor.update

    def noting(self: Predictor, time: float, position: float, velocity: float | None = None) -> float:
        forces.append(update(self, time, position, velocity))
        return forces[-1]

    monkeypatch.setattr(Predictor, "update", noting)
    warm_up(SessionSettings(model=model, estimator=estimator))
    assert forces[0] == 0.0
    assert max(forces) > 0.0
