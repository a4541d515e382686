"""Whole sessions over a thin link, in simulated time: as safe as without a budget, and hardly worse to feel."""

from __future__ import annotations

import sys
from collections import deque
from typing import Any

import numpy as np
import pytest
from thin_serial import most_in_a_second
from thin_ticks import MS

from foretouch.link import FaultStage
from foretouch.messages import FollowerPacket, LeaderPacket, Message, SessionLog, Status, encode
from foretouch.report import session_figures
from foretouch.session import SessionSettings, recorded_settings, simulate
from foretouch.session.thin import FollowerEnd
from foretouch.session.thin.lines.stream import JUMP, POSITION, REACH

BUDGET = 2000.0
MATERIALS = ("foam", "hunt-crossley", "kelvin-voigt", "bone")

Kept = list[tuple[int, Message]]


def tell(line: str) -> None:
    """What was measured, for who asks for it with -s."""
    sys.stdout.write(f"{line}\n")


def run(duration: float = 6.0, **changes: Any) -> tuple[SessionLog, Kept]:
    """The log of a session, and all that was said in it with its time [ns]."""
    kept: Kept = []
    settings = SessionSettings(**({"budget": BUDGET, "seed": 1} | changes))
    done = simulate(settings, duration=duration, record=lambda message, now_ns: kept.append((now_ns, message)))
    return done.log, kept


def require_safe(log: SessionLog) -> None:
    for leader in (log.leader, log.leader_space):
        if leader is not None and "energy" in (leader.dtype.names or ()):
            assert (leader["energy"] >= -leader["energy_bound"] - 1e-12).all()
    force = log.follower["exact_force"]
    assert np.nanmax(force) <= SessionSettings.force_ceiling
    assert log.counts["models_refused"] == 0
    assert log.counts["step_failures"] == 0
    assert session_figures(log)["stable"]


def require_within_budget(kept: Kept) -> None:
    for kind in (LeaderPacket, FollowerPacket):
        sent = [(now_ns, len(encode(message))) for now_ns, message in kept if type(message) is kind]
        assert sent
        assert most_in_a_second(sent) <= BUDGET + max(size for _, size in sent)


def errors_of_commands(log: SessionLog, kept: Kept) -> np.ndarray[Any, Any]:
    """Of the positions that come out at the follower, to those that went in with their number [m].

    Those of the 30 ticks after a step are left out, as at the coupling of a hand: it is smoothed.
    """
    settings, _ = recorded_settings(log.settings)
    space = bool(settings.scene)
    true = log.leader["position"][:, None]
    if space:
        true = np.column_stack([log.leader_space[f"place_{axis}"] for axis in "xyz"])
    steps = np.flatnonzero(np.abs(np.diff(true, axis=0)).max(axis=1) > JUMP * POSITION.bound)
    smoothed = {int(tick) + after for tick in steps for after in range(31)}
    packets = deque((now_ns, message) for now_ns, message in kept if isinstance(message, LeaderPacket))
    stage: FaultStage[Any] = FaultStage(settings.command_faults)
    end, wrong = FollowerEnd(BUDGET), []
    for now_ns in range(0, kept[-1][0] + MS, MS):
        for command in end.heard(stage.pop_due(now_ns), now_ns):
            told = command.place if space else (command.position,)
            if told and command.sequence <= len(true) and command.sequence not in smoothed:
                wrong.append(told - true[command.sequence - 1])
        while packets and packets[0][0] == now_ns:
            stage.push(now_ns, packets.popleft()[1])
    found = np.array(wrong)
    return found[np.isfinite(found).all(axis=1)]


@pytest.mark.parametrize("grip", ["none", "normal"])
@pytest.mark.first
def test_sessions_are_safe_within_the_budget_and_true_to_the_hand(grip: str) -> None:
    rms = []
    for material in MATERIALS:
        log, kept = run(material=material, grip=grip)
        require_safe(log)
        require_within_budget(kept)
        wrong = errors_of_commands(log, kept)
        assert len(wrong) > 5000
        rms.append(float(np.sqrt(np.mean(wrong**2))))
        assert np.quantile(np.abs(wrong), 0.99) < 10.0 * POSITION.bound
    tell(f"grip {grip}: RMS error of commands {1e3 * np.array(rms)} mm, median {1e3 * np.median(rms):.3f} mm")
    assert np.median(rms) < 1e-4


@pytest.mark.long
def test_the_prediction_is_not_much_worse_than_without_a_budget() -> None:
    errors = []
    for material in MATERIALS:
        pair = [
            session_figures(run(10.0, material=material, grip="normal", budget=budget)[0])["prediction_error_percent"]
            for budget in (0.0, BUDGET)
        ]
        tell(f"{material}: error of the prediction {pair[0]:.1f} %, with a budget {pair[1]:.1f} %")
        errors.append(pair)
    without, within = np.median(errors, axis=0)
    assert within < 2.0 * without + 5.0


@pytest.mark.parametrize("first_touch", ["guarded", "follow"])
@pytest.mark.long
def test_a_session_in_space_is_safe_within_the_budget(first_touch: str) -> None:
    log, kept = run(scene="plane", grip="normal", first_touch=first_touch)
    require_safe(log)
    require_within_budget(kept)
    wrong = errors_of_commands(log, kept)
    tell(f"in space, {first_touch}: RMS error of commands {1e3 * np.sqrt(np.mean(wrong**2)):.3f} mm")
    assert np.sqrt(np.mean(wrong**2)) < 1e-4


@pytest.mark.parametrize("faults", [{"loss": 0.05, "jitter": 0.02}, {"loss": 0.3}, {"network": "low-orbit"}])
@pytest.mark.parametrize("scene", ["", pytest.param("plane", marks=pytest.mark.long)])
@pytest.mark.first
def test_a_bad_network_makes_no_session_unsafe(faults: dict[str, Any], scene: str) -> None:
    log, kept = run(grip="normal", scene=scene, **faults)
    require_safe(log)
    require_within_budget(kept)
    commanded = log.follower["command_sequence"]
    assert (np.diff(commanded) >= 0).all()
    assert commanded[-1] > 5000


@pytest.mark.parametrize("scene", ["", pytest.param("plane", marks=pytest.mark.long)])
def test_after_an_outage_the_robot_has_held_and_nothing_old_is_played(scene: str) -> None:
    """Outages of 2 s in either direction: held as without a budget, and then what is commanded then."""
    held, oldest = {}, {}
    for budget in (0.0, BUDGET):
        log, kept = run(11.0, budget=budget, outage=2.0, grip="normal", scene=scene, first_touch="follow")
        require_safe(log)
        follower = log.follower
        age = np.arange(1, len(follower) + 1) - follower["command_sequence"]  # of the command that is applied [ms]
        begun = follower["command_sequence"] > 0
        oldest[budget] = age[begun & (follower["status"] == Status.FOLLOWING)].max()
        held[budget] = np.flatnonzero(begun & (age > 1000) & (follower["status"] != Status.FOLLOWING))
        assert (np.diff(follower["command_sequence"]) >= 0).all()
        assert max(np.diff(follower["command_sequence"])) > 1000  # those of the outage are left out
    wrong = errors_of_commands(log, kept)
    tell(f"scene {scene!r}: largest error of a command {1e3 * np.abs(wrong).max():.2f} mm")
    tell(f"ticks held {[len(one) for one in held.values()]}, oldest command that was followed {oldest} ms")
    assert oldest[BUDGET] <= oldest[0.0] + REACH
    assert len(held[BUDGET]) == pytest.approx(len(held[0.0]), abs=2 * REACH)
    assert np.abs(wrong).max() < 6e-3  # at its end a line goes on by 5 mm at most


@pytest.mark.long
def test_a_session_over_a_thin_link_repeats_bit_by_bit() -> None:
    def packets() -> list[Message]:
        return [
            one for _, one in run(3.0, grip="normal", loss=0.1)[1] if isinstance(one, (LeaderPacket, FollowerPacket))
        ]

    assert packets() == packets()
