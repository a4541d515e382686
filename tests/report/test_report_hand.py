"""Hand, guard and stability in the report of a session: constructed ones, and simulated ones with a hand."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_sessions import make_session

from foretouch.messages import SessionLog
from foretouch.rendering.limits import OWED, UNPAID
from foretouch.report import free_hand, oscillation, pair, render_text, session_figures, write_page
from foretouch.report.sections.forces import scoring_findings
from foretouch.report.sections.hand import apart, withheld_figures
from foretouch.report.writing import pages
from foretouch.robot import make_robot
from foretouch.session import SessionSettings, make_operator, simulate


def simulated(duration: float, **chosen: Any) -> SessionLog:
    settings = SessionSettings(material="hunt-crossley", **chosen)
    robot = make_robot(settings.material, seed=0)
    material = robot.material
    operator = make_operator(settings, surface=material.surface, press_depth=material.press_depth, say=print)
    return simulate(settings, duration=duration, operator=operator, robot=robot).log


@pytest.fixture(scope="module")
def ours() -> SessionLog:
    return simulated(6.0, grip="soft", position_scale=0.8, force_scale=0.5)


@pytest.fixture(scope="module")
def delayed() -> SessionLog:
    return simulated(6.0, grip="soft", baseline="delayed")


@pytest.fixture(scope="module")
def our_report(ours: SessionLog) -> dict[str, Any]:
    return session_figures(ours)


@pytest.fixture(scope="module")
def delayed_report(delayed: SessionLog) -> dict[str, Any]:
    return session_figures(delayed)


def guarded(log: SessionLog, start: int, end: int) -> SessionLog:
    """The same with these rows of the follower held back by 2 mm."""
    follower = log.follower.copy()
    follower["guarded"][start:end] = True
    follower["desired_position"][start:end] -= 2e-3
    return replace(log, follower=follower)


@pytest.mark.long
def test_a_session_with_a_hand_is_stable(ours: SessionLog, our_report: dict[str, Any]) -> None:
    report = our_report
    hand = report["hand"]
    assert report["stable"] is True
    assert report["loop"].startswith("closed loop: a hand with a soft grip holds a device of 0.1 kg, 2 N s/m")
    assert -report["energy_bound_J"] <= report["net_energy_J"] <= 0.0
    assert report["energy_margin_J"] >= 0.0
    assert report["largest_update_jump_N"] == np.abs(ours.leader["update_step"]).max() <= 0.1
    assert report["largest_model_jump_N"] == np.abs(ours.leader["model_jump"]).max()
    assert report["guarded_contacts"] >= 1
    assert report["guarded_s"] == pytest.approx(1e-3 * ours.follower["guarded"].sum())
    assert hand["peak_force_hand_N"] == ours.leader["rendered_force"].max()
    assert hand["peak_force_robot_N"] == ours.follower["exact_force"].max()
    held = ours.follower["exact_force"][ours.follower["guarded"]]
    assert hand["peak_force_guarded_N"] == held.max() <= hand["peak_force_robot_N"]
    assert hand["oscillation"]["free_swings"] >= 2
    assert hand["energy_agrees"] is True
    assert 0.0 <= hand["largest_energy_cut_N"] <= report["largest_rendered_jump_N"]
    assert hand["oscillation"]["extra_swings"] <= 2
    assert hand["given_way_mm"] > 5.0 * hand["given_way_in_air_mm"]
    json.dumps(report, allow_nan=False)
    text = render_text(report)
    assert "and the hand did not oscillate." in text
    assert re.search(rf"guarded, .* s in all, at most {held.max():.2f} N; lost", text)
    assert "where the robot touched nothing" not in text


@pytest.mark.long
def test_an_account_that_is_not_true_is_said(
    ours: SessionLog, delayed: SessionLog, delayed_report: dict[str, Any]
) -> None:
    leader = delayed.leader.copy()
    leader["energy"] = np.maximum(leader["energy"], -leader["energy_bound"])
    report = session_figures(replace(delayed, leader=leader))
    assert report["net_energy_J"] == pytest.approx(delayed_report["net_energy_J"])
    assert "more than the energy account allows, and the leader's account of energy is not what" in render_text(report)
    leader = ours.leader.copy()
    leader["energy"] += 1e-6 * (leader["energy"] > 0.0)
    report = session_figures(replace(ours, leader=leader))
    assert report["stable"] is False
    text = "Unstable: the leader's account of energy is not what its forces and positions add up to."
    assert text in render_text(report)


@pytest.mark.long
def test_where_nothing_was_touched() -> None:
    """A heavy device without damping swings in the hand by itself: that is no oscillation of the coupling."""
    heavy = {"device_mass": 10.0, "device_damping": 0.1, "device_friction": 0.0, "grip": "soft"}
    log = simulated(10.0, clutch="0.5:10", **heavy)
    report = session_figures(log)
    swings = report["hand"]["oscillation"]
    assert report["stable"] is True
    assert swings["swings"] <= swings["free_swings"]
    assert oscillation(log.leader)["oscillates"]  # as it does against what the hand means
    np.testing.assert_allclose(free_hand(log), log.leader["exact_hand_position"], atol=1e-9)
    text = render_text(report)
    assert "Stable, but nothing was touched." in text
    assert "no contact at the hand: nothing to account for" in text
    assert "-0.00" not in text
    never = replace(log, leader=log.leader.copy())
    never.leader["engaged"] = False
    assert "Stable, but hand and robot were never coupled, and nothing was touched." in render_text(
        session_figures(never)
    )


def test_a_hand_that_nobody_knows_is_compared_with_what_it_means(ours: SessionLog) -> None:
    for settings in ({}, ours.settings | {"grip": "none"}, ours.settings | {"device_mass": "-1"}):
        assert free_hand(replace(ours, settings=settings)) is None


def test_guarded_contact_is_reported_with_its_fraction(ours: SessionLog, our_report: dict[str, Any]) -> None:
    everything = guarded(ours, 0, ours.follower.size)
    report = session_figures(everything)
    assert report["hand"]["guarded_contact_percent"] == 100.0
    assert "The guard held the robot back in 100 % of the contact time" in render_text(report)
    never = guarded(ours, 0, 0)
    never.follower["guarded"] = False
    assert "The guard held" not in render_text(session_figures(never))
    percent = f"{our_report['hand']['guarded_contact_percent']:.3g} % of the contact time: the hand felt nothing then"
    assert f"The guard held the robot back in {percent}" in render_text(our_report)


def test_a_force_where_the_robot_touched_nothing(ours: SessionLog, our_report: dict[str, Any]) -> None:
    """For 60 commands in a row, in free air; neither for 40, nor while the robot was held back."""
    rows = pair(ours)
    free = ~(rows.follower["in_contact"] | rows.follower["guarded"])
    start = next(int(row) for row in np.flatnonzero(free) if free[row : row + 200].all())
    ticks = np.flatnonzero(np.isin(ours.leader["sequence"], rows.leader["sequence"][start + 50 : start + 110]))
    assert ticks.size == 60
    assert our_report["hand"]["largest_phantom_N"] == 0.0

    def felt(count: int, force: float) -> SessionLog:
        leader = ours.leader.copy()
        leader["rendered_force"][ticks[:count]] = force
        return replace(ours, leader=leader)

    report = session_figures(felt(60, 1.5))
    assert report["hand"]["largest_phantom_N"] == 1.5
    assert "The hand felt up to 1.50 N where the robot touched nothing." in render_text(report)
    for quiet in (felt(40, 1.5), felt(60, 0.2), guarded(felt(60, 1.5), 0, ours.follower.size)):
        assert session_figures(quiet)["hand"]["largest_phantom_N"] == 0.0


@pytest.fixture
def not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each figure the page has its caption alone: a drawing takes longer than all else."""
    monkeypatch.setattr(pages, "embedded", lambda figure, caption: caption)


@pytest.mark.usefixtures("not_drawn")
def test_a_delayed_force_is_unstable_and_is_said_first(
    delayed: SessionLog, tmp_path: Path, delayed_report: dict[str, Any]
) -> None:
    report = delayed_report
    assert report["stable"] is False
    assert report["hand"]["certificate_holds"] is False
    assert report["hand"]["oscillation"]["oscillates"] is True
    assert report["net_energy_J"] < -10.0 * report["energy_bound_J"] < 0.0
    assert report["net_energy_exact_J"] == pytest.approx(report["net_energy_J"], rel=0.01)
    text = render_text(report)
    assert text.index("Baseline delayed: the delayed force was rendered") < text.index("Unstable: the hand was given")
    assert text.index("Unstable: ") < text.index("Forces at equal command")
    assert "than the delayed force" not in text  # it is the delayed force
    assert "An operator could feel the delayed force's error in " in text
    written = write_page(tmp_path, delayed, report).read_text()
    sentences = re.findall(r'<p class="bad">([^<]+)</p>', written)
    assert sentences[0].startswith("Baseline delayed")
    assert sentences[1].startswith("Unstable: ")


def test_of_a_baseline_nothing_is_said_that_nobody_computed(delayed: SessionLog) -> None:
    """Neither what models did, nor what a ceiling cut, nor what the device could not carry: there are none."""
    assert np.isnan(delayed.leader["rendered_share"]).all()
    old = replace(delayed, leader=delayed.leader.copy())
    old.leader["rendered_share"] = 1.0
    for log in (delayed, old):
        report = session_figures(log)
        assert {report[name] for name in report if "update_jump" in name or "model_jump" in name} == {None}
        for name in ("device_bound_percent", "smallest_rendered_share", "largest_energy_cut_N"):
            assert report["hand"][name] is None
        text = render_text(report)
        for line in ("  updates ", "  ceiling ", "  device ", "before mediation"):
            assert line not in text
        assert "  hand  " in text
        assert "delayed (what was rendered)" in text
        json.dumps(report, allow_nan=False)


def test_a_controller_does_not_render_the_delayed_force_itself(delayed: SessionLog) -> None:
    report = session_figures(replace(delayed, settings=delayed.settings | {"baseline": "delayed-tdpa"}))
    text = render_text(report)
    assert "the delayed force was rendered, as far as a passivity controller let it" in text
    assert "delayed (before the controller)" in text
    assert "what was rendered" not in text


@pytest.mark.long
def test_a_delayed_force_in_an_open_loop_is_given_to_nobody() -> None:
    """It would give out energy along this motion; but no hand holds what could be unstable."""
    report = session_figures(simulated(4.0, baseline="delayed"))
    assert report["hand"]["certificate_holds"] is False
    assert report["stable"] is None
    text = render_text(report)
    assert "the hand was given" not in text
    assert "Unstable" not in text
    assert "not known: no hand holds the device that the delayed force would move" in text


@pytest.mark.long
def test_the_page_shows_hand_and_energy(ours: SessionLog, tmp_path: Path, our_report: dict[str, Any]) -> None:
    text = write_page(tmp_path, ours, our_report).read_text()
    assert "The hand: what it meant" in text
    assert "Energy account of the session" in text


@pytest.mark.usefixtures("not_drawn")
def test_the_page_of_an_open_loop_shows_neither(tmp_path: Path) -> None:
    open_loop = make_session(2.5)
    text = write_page(tmp_path, open_loop, session_figures(open_loop)).read_text()
    assert "True, predicted" in text
    assert "The hand: what it meant" not in text
    assert "Energy account of the session" not in text


def test_the_rendered_force_is_scored_in_the_robots_newtons(ours: SessionLog) -> None:
    report = session_figures(ours)
    assert report["rendered_error_percent"] < 25.0
    scaled = replace(ours, settings=ours.settings | {"force_scale": "1"})
    assert session_figures(scaled)["rendered_error_percent"] > 40.0


def test_a_force_that_is_no_number_is_not_stable(ours: SessionLog) -> None:
    leader = ours.leader.copy()
    leader["rendered_force"][-1] = np.nan
    report = session_figures(replace(ours, leader=leader))
    assert report["stable"] is False
    assert "a force was not a finite number" in render_text(report)


def test_old_sessions_kept_no_account() -> None:
    report = session_figures(make_session(2.5))
    assert report["stable"] is None
    assert report["net_energy_J"] is None
    assert "not known: no account of energy was kept" in render_text(report)
    json.dumps(report, allow_nan=False)


def test_guarded_rows_are_counted_and_not_scored() -> None:
    log = make_session(4.0)
    leader = log.leader.copy()
    leader["predicted_force"][2000:2200] = 50.0
    wrong = replace(log, leader=leader)
    assert session_figures(wrong)["prediction_error_percent"] > 100.0
    report = session_figures(guarded(wrong, 2080, 2280))
    assert report["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["guarded_samples"] == 200
    assert report["scored_samples"] < session_figures(log)["scored_samples"]


def test_rows_without_a_hand_on_the_handle_are_not_scored() -> None:
    log = make_session(4.0)
    leader = log.leader.copy()
    leader["predicted_force"][2000:2200] = 50.0
    leader["engaged"][2000:2200] = False
    leader["position"][:50] = np.nan
    leader["engaged"][:50] = False
    report = session_figures(replace(log, leader=leader))
    assert report["prediction_error_percent"] == pytest.approx(0.0, abs=0.01)
    assert report["engaged_percent"] == pytest.approx(100.0 * (1.0 - 250 / 4000))
    assert report["tracking_error"]["max_mm"] == pytest.approx(0.0, abs=1e-9)


def test_what_the_guard_took_away() -> None:
    log = make_session(4.0)
    touching = np.flatnonzero(log.follower["in_contact"])
    start = int(touching[touching > 1500][0])
    free = int(np.flatnonzero(~log.follower["in_contact"][start:])[0]) + start
    begun = guarded(log, start - 40, free - 30)  # held back in the air already
    flicker = guarded(begun, free - 10, free)  # lets go for a moment
    report = session_figures(flicker)
    assert report["guarded_contacts"] == 1
    assert report["guarded_s"] == pytest.approx(1e-3 * (free - start + 40 - 20))
    assert report["hand"]["depth_lost_mm"] == pytest.approx(2.0)
    assert report["hand"]["time_lost_s"] == pytest.approx(1e-3 * (free - start))
    air = session_figures(guarded(log, start - 40, start))
    assert air["guarded_contacts"] == 0
    assert air["guarded_s"] == pytest.approx(0.04)
    assert session_figures(log)["hand"]["peak_force_guarded_N"] is None
    assert air["hand"]["depth_lost_mm"] == air["hand"]["time_lost_s"] == 0.0


def test_how_far_the_proxy_is_from_the_hand() -> None:
    """Only what went away since hand and proxy were coupled, in the follower's lengths, anew after each clutch."""
    log = make_session(1.0)
    leader = log.leader.copy()
    leader["hand_position"] = (leader["position"] + 0.02) / 2.0
    leader["position"][300:] -= 3e-3
    leader["engaged"][600:650] = False
    distances = apart(replace(log, leader=leader, settings=log.settings | {"position_scale": "2"}))
    np.testing.assert_allclose(distances[:300], 0.0, atol=1e-12)
    np.testing.assert_allclose(distances[300:600], 3e-3, atol=1e-12)
    assert np.isnan(distances[600:650]).all()
    np.testing.assert_allclose(distances[650:], 0.0, atol=1e-12)


def test_share_that_the_device_could_carry(ours: SessionLog) -> None:
    leader = ours.leader.copy()
    felt = np.flatnonzero(0.5 * leader["predicted_force"] * leader["engaged"] > 0.05)
    leader["rendered_share"] = 1.0
    leader["rendered_force"] = 0.0  # so little is carried that nothing is felt
    leader["rendered_share"][felt[: felt.size // 4]] = 0.5
    hand = session_figures(replace(ours, leader=leader))["hand"]
    assert hand["device_bound_percent"] == pytest.approx(25.0, abs=0.1)
    assert hand["smallest_rendered_share"] == 0.5
    text = render_text(session_figures(replace(ours, leader=leader)))
    assert "% of contact the device could not carry the model: it felt softer, down to 50.0 % of its stiffness." in text


def without_force(log: SessionLog, begin: int, end: int, energy: float = -1e-3, **settings: str) -> SessionLog:
    """The same with a hand that is given nothing in these ticks."""
    leader = log.leader.copy()
    leader["rendered_force"] = leader["predicted_force"]
    leader["hand_position"] = leader["position"]
    leader["energy"][begin:end], leader["rendered_force"][begin:end] = energy, 0.0
    return replace(log, leader=leader, settings=log.settings | {"grip": "normal"} | settings)


def test_withheld_force_is_reported_with_fraction_segment_and_reason() -> None:
    log = without_force(make_session(), 500, 3500)
    report = session_figures(log)
    hand, felt = report["hand"], np.flatnonzero(log.leader["predicted_force"] >= 0.5)
    inside = felt[(felt >= 500) & (felt < 3500)]
    assert hand["withheld_percent"] == pytest.approx(100.0 * inside.size / felt.size)
    assert hand["longest_withheld_s"] == pytest.approx(1e-3 * (inside[-1] - inside[0]))
    assert hand["longest_withheld_at_s"] == pytest.approx(1e-3 * inside[0])
    assert hand["withheld_because"] == OWED
    text = render_text(report)
    assert "% of contact the force was withheld: the hand was given less than half of the model's. At longest" in text
    assert OWED in text
    assert "  withheld   in " in text


def test_what_is_not_paid_for_has_another_reason() -> None:
    log = without_force(make_session(), 500, 3500, energy=1e-6)
    assert withheld_figures(log.leader, 1.0)["withheld_because"] == UNPAID


def test_a_short_cut_is_not_withheld() -> None:
    log = make_session()
    first = int(np.flatnonzero(log.leader["predicted_force"] >= 0.5)[0])
    report = session_figures(without_force(log, first, first + 400))
    assert report["hand"]["withheld_percent"] == 0.0
    assert report["hand"]["longest_withheld_s"] is None
    assert "was withheld" not in render_text(report)


@pytest.mark.parametrize("settings", [{"grip": "none"}, {"baseline": "delayed"}])
def test_where_no_hand_feels_a_model_nothing_is_withheld(settings: dict[str, str]) -> None:
    assert session_figures(without_force(make_session(), 500, 3500, **settings))["hand"]["withheld_percent"] is None


@pytest.mark.parametrize(("rendered", "listed"), [(76.4, True), (63.9, False), (12.0, False)])
def test_a_rendered_force_that_is_worse_than_the_delayed_one_is_said_to_be(rendered: float, listed: bool) -> None:
    figures: dict[str, Any] = {
        "status": "ok",
        "prediction_error_percent": 4.5,
        "rendered_error_percent": rendered,
        "delayed_force_error_percent": 63.8,
        "rendered_within_jnd_percent": 68.0,
        "within_jnd_percent": 92.0,
        "missed_contact_percent": 0.0,
    }
    findings = [finding for finding in scoring_findings(figures) if "rendered force is worse" in finding.text]
    assert len(findings) == listed
    assert not any(finding.good for finding in findings)
