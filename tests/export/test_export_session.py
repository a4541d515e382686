"""Leader and follower in C: the bits of whole simulated sessions, and of ticks in which anything comes."""

from __future__ import annotations

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from packages import NATIVE, build
from session_log import Log, differing, read_given, watched

from foretouch.session import SessionSettings, simulate
from foretouch.session.runners.warm_up import warm_up_once

SOURCE = Path(__file__).parent / "session_ticks.c"
SESSIONS: dict[str, dict[str, Any]] = {
    "hunt-crossley": {},
    "foam, normal grip": {"material": "foam", "grip": "normal"},
    "kelvin-voigt, stiff grip, guarded": {"material": "kelvin-voigt", "grip": "stiff", "first_touch": "guarded"},
    "jitter, loss and outages": {"grip": "normal", "jitter": 0.05, "loss": 0.2, "outage": 1.0},
    "one second each way": {"position_delay": 1.0, "force_delay": 1.0, "grip": "soft"},
    "clutch": {"grip": "normal", "clutch": "2:3,5:6"},
    "sensor that fails": {"sensor_fault": "stuck:4:6"},
    "another seed and frames": {"seed": 7, "leader_frame": "0.1,-1", "position_scale": 2.0, "grip": "normal"},
    "no delay": {"position_delay": 0.0, "force_delay": 0.0, "material": "foam"},
}
"""The golden sessions: settings beside the defaults."""


def logged(name: str, seconds: float) -> Log:
    log, settings = Log(), replace(SessionSettings(), **SESSIONS[name])
    warm_up_once(settings)  # which runs the steps, too
    with watched(log):
        simulate(settings, duration=seconds, say=lambda _: None)
    return log


def given_by(command: list[object], log: Log) -> list[tuple[Any, ...]]:
    done = subprocess.run(list(map(str, command)), input=bytes(log.taken), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return read_given(done.stdout, log)


@pytest.fixture(scope="module")
def program(package: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(package, tmp_path_factory.mktemp("session"), "gcc", "-std=c11", "-O2", source=SOURCE)


@NATIVE
@pytest.mark.parametrize("name", ["foam, normal grip", "jitter, loss and outages"])
def test_a_session_of_c_gives_the_bits_of_python(program: Path, name: str) -> None:
    log = logged(name, 5.0)
    assert differing(given_by([program], log), log.given) == 0


@NATIVE
@pytest.mark.long
@pytest.mark.parametrize("name", SESSIONS)
def test_every_golden_session_of_c_gives_the_bits_of_python(program: Path, name: str) -> None:
    log = logged(name, 20.0)
    assert differing(given_by([program], log), log.given) == 0
