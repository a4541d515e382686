"""A link is measured as a trace: over real links on loopback, behind networks whose delays are known."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from foretouch.doctor import Verdict
from foretouch.doctor.felt import check_network, judge_felt
from foretouch.doctor.measuring import COMMAND, QUESTION, Measured, measure
from foretouch.doctor.network import ASKS, DOCTOR_CHANNELS, Answerer, filling
from foretouch.errors import LinkError
from foretouch.link import Faults, ZenohLink, free_endpoint, network_trace, read_trace
from foretouch.messages import Hello, encode
from foretouch.report import network_figures


def never() -> bool:
    return False


def measured_over(faults: Faults | None, seconds: float, **more: Any) -> Measured:
    """A measurement against an answerer in this process, behind a network with faults."""
    pytest.importorskip("zenoh")
    endpoint, ended = free_endpoint(), threading.Event()
    answerer = Answerer(lambda watch: ZenohLink(listen=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch), faults)
    thread = threading.Thread(target=answerer.run, args=(ended.is_set,))
    thread.start()
    options: dict[str, Any] = {"should_stop": never, "progress": lambda now: None} | more
    try:
        return measure(
            lambda watch: ZenohLink(connect=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch), seconds, **options
        )
    finally:
        ended.set()
        thread.join()
        answerer.close()


def written(measured: Measured, path: Path) -> Path:
    path.write_text("\n".join(measured.lines("of a test")) + "\n")
    return path


def test_a_question_is_as_large_as_a_command() -> None:
    texts = {ASKS: "0123456789abcdef/12345", **filling(COMMAND - QUESTION)}
    assert len(encode(Hello.of("doctor", 12345, 10**15, texts))) == pytest.approx(COMMAND, abs=12)


def test_what_is_lost_is_as_late_as_the_next_that_came(tmp_path: Path) -> None:
    sent = np.arange(0.0, 5.0, 0.001)
    answered = sent + 0.02
    answered[1000:3500] = np.nan
    answered[-5:] = np.nan
    measured = Measured(sent, answered)
    assert measured.lost == 2505
    trace = read_trace(written(measured, tmp_path / "lost.csv"))  # a gap would be refused
    assert trace.time.size == 4995
    assert trace.longest_stall == pytest.approx(2.5, abs=0.02)
    assert trace.measured[1000] == pytest.approx(2.52, abs=1e-6)


@pytest.mark.network
@pytest.mark.long
def test_a_delay_is_measured_at_the_rate_of_a_session(tmp_path: Path) -> None:
    seen: list[float] = []
    measured = measured_over(Faults(delay=0.05), 2.0, progress=seen.append)
    assert measured.sent.size > 1500  # a busy machine misses ticks
    assert measured.lost == 0
    trace = read_trace(written(measured, tmp_path / "link.csv"))
    assert np.median(trace.measured) == pytest.approx(0.05, abs=0.02)
    assert trace.measured.min() >= 0.05
    assert seen[0] == 1.0


@pytest.mark.network
@pytest.mark.long
def test_a_stalling_network_is_found_again_in_its_trace(tmp_path: Path) -> None:
    """What is measured over a network is nearly that network: here one way of it is of a known trace."""
    path = tmp_path / "known.csv"
    late = (0.02 + max(2.5 - 0.02 * n, 0.0) * (n >= 80) for n in range(300))
    path.write_text("time_s,one_way_s\n" + "\n".join(f"{0.02 * n:.2f},{one:.3f}" for n, one in enumerate(late)))
    measured = measured_over(Faults(network=str(path)), 5.0)
    trace = read_trace(written(measured, tmp_path / "link.csv"))
    assert trace.longest_stall == pytest.approx(network_trace(str(path)).longest_stall, abs=0.1)


@pytest.mark.network
def test_it_ends_early_and_keeps_what_it_has() -> None:
    asked = iter(range(10**6))
    assert 100 < measured_over(None, 60.0, should_stop=lambda: next(asked) > 400).sent.size <= 401


@pytest.mark.network
def test_nobody_there_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("zenoh")
    monkeypatch.setattr("foretouch.doctor.measuring.MEETING", 0.3)
    endpoint = free_endpoint()
    with pytest.raises(LinkError, match="run `foretouch network answer` on the other machine"):
        measure(
            lambda watch: ZenohLink(connect=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch),
            1.0,
            should_stop=never,
            progress=lambda now: None,
        )


@pytest.mark.network
def test_a_session_that_runs_there_is_not_disturbed() -> None:
    pytest.importorskip("zenoh")
    endpoint, ended = free_endpoint(), threading.Event()
    with ZenohLink(listen=[endpoint]) as follower:

        def greet() -> None:
            while not ended.wait(0.1):
                follower.publish(Hello.of("follower", 1, 1, {}))

        thread = threading.Thread(target=greet)
        thread.start()
        try:
            with pytest.raises(LinkError, match=r"a session runs there \(follower\)"):
                measure(
                    lambda watch: ZenohLink(connect=[endpoint], subscribe=DOCTOR_CHANNELS, watch=watch),
                    1.0,
                    should_stop=never,
                    progress=lambda now: None,
                )
        finally:
            ended.set()
            thread.join()


FELT: dict[str, Any] = {
    "stable": True,
    "duration_s": 40.0,
    "prediction_error_percent": 4.0,
    "within_jnd_percent": 90.0,
    "away_samples": 100,
    "samples": 40_000,
}


@pytest.mark.parametrize(
    ("report", "network", "verdict"),
    [
        ({}, {"stalls_that_hold": 0}, Verdict.GOOD),
        ({}, {}, Verdict.WARNING),
        ({}, {"stale_percent": 2.0}, Verdict.BAD),
        ({"within_jnd_percent": 40.0}, {}, Verdict.BAD),
        ({"stable": False}, {}, Verdict.BAD),
        ({"within_jnd_percent": None, "prediction_error_percent": None}, {}, Verdict.BAD),
    ],
)
def test_what_a_session_over_it_says(report: dict[str, Any], network: dict[str, Any], verdict: Verdict) -> None:
    figures = network_figures(network_trace("low-orbit")) | network
    finding = judge_felt("network low-orbit", figures, FELT | report, "foretouch network show low-orbit")
    assert finding.verdict is verdict
    assert bool(finding.mend) == (verdict is not Verdict.GOOD)
    assert "e+" not in finding.summary


def test_a_network_that_is_none_is_bad(tmp_path: Path) -> None:
    finding = check_network(str(tmp_path / "nowhere.csv"))
    assert finding.verdict is Verdict.BAD
    assert "there is no such file" in finding.summary


@pytest.mark.long
def test_the_doctor_simulates_a_session_over_a_network() -> None:
    finding = check_network("low-orbit")
    assert finding.verdict is Verdict.WARNING
    assert 0.0 < finding.figures["prediction_error_percent"] < 15.0
    assert 0.0 <= finding.figures["beyond_jnd_percent"] < 30.0
