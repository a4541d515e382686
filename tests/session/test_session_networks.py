"""Sessions over measured networks: finite, within their certificate, and nothing old is obeyed after a stall."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running import Running

from foretouch.devices import Device
from foretouch.link import NETWORK_NAMES, PUBLISHED_NETWORKS, FaultStage, network_trace
from foretouch.messages import SessionLog, Status
from foretouch.recordings import read_session
from foretouch.report import pair, session_figures
from foretouch.report.scene.pose import scene_rows
from foretouch.session import SessionSettings, recorded_settings, simulate
from foretouch.session.runners.live import fault_texts
from foretouch.settings import PAPER_DELAYS

MS = 1_000_000
BEGINS = {"5g-rural": 17.0, "low-orbit": 14.0, "5g-rural-standing": 13.0}
"""Where a session of some seconds meets the stalls of a network."""


def stale_commands(settings: SessionSettings, ticks: int) -> int:
    """Commands that arrive within so many ticks, later than the shortest way of any by more than the allowance."""
    stage: FaultStage[int] = FaultStage(settings.command_faults)
    least, stale = math.inf, 0
    for tick in range(ticks):
        for sent in stage.pop_due(tick * MS):
            least = min(least, tick - sent)
            stale += tick - sent > least + 1e3 * settings.queueing_allowance
        stage.push(tick * MS, tick)
    return stale


def require_sound(log: SessionLog) -> None:
    """Everything finite, nothing beyond its bound of energy, and no oscillation."""
    figures = session_figures(log)
    assert figures["stable"]
    for name in ("rendered_force", "predicted_force", "hand_position"):
        assert np.isfinite(log.leader[name]).all()
    moved = log.follower["desired_position"]
    assert np.isfinite(moved[log.follower["command_sequence"] > 0]).all()


@pytest.mark.parametrize("name", NETWORK_NAMES)
@pytest.mark.first
def test_a_session_over_each_network_is_sound(name: str, request: pytest.FixtureRequest) -> None:
    if name in PUBLISHED_NETWORKS:
        request.getfixturevalue("measured_network")(name)
    settings = SessionSettings(network=name, network_start=BEGINS.get(name, 0.0), grip="normal", seed=3)
    log = simulate(settings, duration=8.0).log
    require_sound(log)
    assert log.settings["network"] == name
    assert log.counts["commands_stale"] == stale_commands(settings, 8000)


class There(Device):
    """A hand that goes far only while nobody can hear it, and is back before that ends."""

    name, closed_loop = "there", False

    def read(self, now_ns: int) -> float:
        time = now_ns * 1e-9
        return 0.0 if 3.1 < time < 4.4 else 0.005 * math.sin(2.0 * math.pi * 0.5 * time) - 0.012

    def render(self, force: float) -> float:
        return force


def test_what_was_meant_during_a_stall_is_not_done_after_it(tmp_path: Path) -> None:
    """A stall of 2 s, in which the hand goes far away and comes back: no command of then is obeyed."""
    path = tmp_path / "stall.csv"
    held = (max(5.0 - 0.05 * n, 0.0) if 0.05 * n >= 3.0 else 0.0 for n in range(200))
    rows = (f"{0.05 * n:.2f},{0.02 + late:.3f}" for n, late in enumerate(held))
    path.write_text("\n".join(("time_s,one_way_s", *rows)))
    settings = SessionSettings(network=str(path), first_touch="follow")
    log = simulate(settings, duration=8.0, operator=There()).log
    time = log.follower["time_ns"] * 1e-9
    silent = (time > 3.1) & (time < 5.0)
    assert (log.follower["status"][silent] != Status.FOLLOWING).all()
    assert log.follower["position"][time > 2.5].max() < -0.005  # where the hand was went unheard
    assert log.counts["commands_stale"] > 1400
    assert (log.follower["status"][time > 7.5] == Status.FOLLOWING).all()


def test_a_network_has_delays_of_its_own() -> None:
    plain, over = SessionSettings(), SessionSettings(network="geostationary")
    assert {name: getattr(plain, name) for name in PAPER_DELAYS} == PAPER_DELAYS
    assert (over.position_delay, over.force_delay) == (0.0, 0.0)
    both = SessionSettings(network="geostationary", position_delay=0.1, network_start=7.0)
    assert both.command_faults.delay == 0.1
    assert both.return_faults.network_start == 7.0
    again, notes = recorded_settings(over.as_text())
    assert (again.as_text(), notes) == (over.as_text(), ())


def test_a_replay_over_another_network_leaves_the_recorded_delays_out() -> None:
    recorded = SessionSettings(position_delay=0.2, jitter=0.01).as_text()
    again, _ = recorded_settings(recorded, {"network": "low-orbit"})
    assert (again.network, again.position_delay, again.jitter) == ("low-orbit", 0.0, 0.01)
    again, _ = recorded_settings(recorded, {"network": "low-orbit", "position_delay": 0.1})
    assert again.position_delay == 0.1


@pytest.mark.long
def test_a_session_repeats_bit_by_bit_and_the_start_counts() -> None:
    def run(**more: Any) -> Any:
        return simulate(SessionSettings(network="low-orbit", loss=0.01, seed=2, **more), duration=2.0)

    assert run() == run()
    assert run() != run(network_start=14.0)
    assert network_trace("low-orbit") is network_trace("low-orbit")


@pytest.mark.long
def test_both_sides_of_a_scene_over_a_network_have_one_clock() -> None:
    """The shortest way of a command is the network's, and no difference of two clocks."""
    settings = SessionSettings(scene="plane", network="geostationary", fusion="none", displacement=0.0, turn=0.0)
    log = simulate(settings, duration=3.0, say=lambda _: None).log
    rows = scene_rows(log, pair(log))
    np.testing.assert_allclose(rows.leader_time, rows.follower_time, atol=1e-9)


def test_a_side_says_over_which_network_it_hears() -> None:
    stage: FaultStage[Any] = FaultStage(SessionSettings(network="low-orbit").return_faults)
    assert fault_texts(stage, "force_delay", 0, "return_")["return_network"] == "low-orbit"


@pytest.mark.live
@pytest.mark.long
def test_a_session_in_real_time_runs_over_a_network(tmp_path: Path) -> None:
    """Its stalls come where they are in the trace: some 15 s minus the start after the first message."""
    pytest.importorskip("zenoh")
    recording = tmp_path / "session.mcap"
    options = ["--headless", "--operator", "scripted", "--grip", "normal", "--recording", recording, "--json"]
    with Running("teleop", *options, "--network", "low-orbit", "--network-start", "12", "--duration", "6") as session:
        code, out, err = session.wait(120.0)
    assert code == 0, err
    report = json.loads(out)
    assert report["stable"]
    assert report["settings"]["network"] == report["settings"]["return_network"] == "low-orbit"
    held = report["safety"]["statuses"]["holding"]
    assert held["times"] >= 1
    times = read_session(recording).leader["time_ns"]
    assert np.ptp(times) > 4.0e9
