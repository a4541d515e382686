"""Leader and follower in C: the bits of whole simulated sessions, and of ticks in which anything comes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from packages import NATIVE, Packages, build, needs
from session_log import SESSIONS, SOURCE, Log, differing, given_by, logged
from session_ticks import EPOCH, Player, clean, plain, random_ticks, randomly

from foretouch.export.beginnings import OWN, beginnings
from foretouch.messages import Status
from foretouch.session import SessionSettings


@pytest.fixture(scope="module")
def session() -> Log:
    return logged("foam, normal grip", 5.0)


@NATIVE
@pytest.mark.parametrize("compiler", ["gcc -std=c11 -O2", "clang -std=c11 -O1 -fsanitize=address,undefined"])
@pytest.mark.first
def test_a_session_of_c_gives_the_bits_of_python(package: Path, tmp_path: Path, session: Log, compiler: str) -> None:
    program = build(package, tmp_path, *compiler.split(), source=SOURCE)
    assert differing(given_by([program], session), session.given) == 0


@pytest.mark.long
def test_the_same_on_aarch64(packages: Packages, tmp_path: Path, session: Log) -> None:
    needs("qemu-aarch64")
    compiler = "aarch64-linux-gnu-gcc", "-std=c11", "-O2", "-static"
    program = build(packages["aarch64"], tmp_path, *compiler, source=SOURCE)
    given = given_by(["qemu-aarch64", program], session)
    assert differing(given, session.given) == 0


@NATIVE
@pytest.mark.long
@pytest.mark.parametrize("name", SESSIONS)
def test_every_golden_session_of_c_gives_the_bits_of_python(package: Path, tmp_path: Path, name: str) -> None:
    program, log = build(package, tmp_path, "gcc", "-std=c11", "-O2", source=SOURCE), logged(name, 20.0)
    assert differing(given_by([program], log), log.given) == 0


@NATIVE
@pytest.mark.parametrize("count", [50_000, pytest.param(1_000_000, marks=pytest.mark.long)])
@pytest.mark.long
def test_whatever_comes_the_bits_are_those_of_python(package: Path, tmp_path: Path, session: Log, count: int) -> None:
    strict = "clang", "-std=c11", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover"
    program, taken = build(package, tmp_path, *strict, source=SOURCE), random_ticks(session, count, seed=count)
    player = Player()
    assert np.array_equal(randomly([program], taken), plain(player.play(taken)))
    assert player.felt > 0.2  # it is no session in which nothing happens
    assert {Status.FOLLOWING, Status.HOLDING, Status.STOPPED, Status.SENSOR_FAULT} <= player.statuses


@NATIVE
@pytest.mark.parametrize("count", [2_000, pytest.param(20_000, marks=pytest.mark.long)])
@pytest.mark.long
def test_the_bits_of_interpreted_python(package: Path, tmp_path: Path, session: Log, count: int) -> None:
    program, taken = build(package, tmp_path, "gcc", "-std=c11", source=SOURCE), random_ticks(session, count, seed=5)
    surroundings = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, str(SOURCE.with_suffix(".py"))]
    done = subprocess.run(command, input=taken, capture_output=True, env=surroundings, check=True)
    assert np.array_equal(randomly([program], taken), plain(done.stdout))


@NATIVE
def test_what_the_init_functions_write_is_what_python_starts_with(package: Path, tmp_path: Path) -> None:
    program = build(package, tmp_path, "gcc", "-std=c11", source=SOURCE)
    begun = {one.name: one.record for one in beginnings(SessionSettings())}
    done = subprocess.run([program, "structs"], input=b"lf", capture_output=True, check=True)
    leader, follower = clean(begun["leader_init"]), clean(begun["follower_init"])
    leader["views"]["epoch"], follower["hearings"]["run"] = EPOCH, OWN
    assert done.stdout == leader.tobytes() + follower.tobytes()


def test_settings_are_in_what_the_structs_begin_with() -> None:
    settings = SessionSettings(first_touch="guarded", position_scale=2.0, robot="ur5e")
    begun, plain_ones = ({one.name: one.record for one in beginnings(given)} for given in (settings, SessionSettings()))
    for name, record in begun.items():
        assert (record.tobytes() == plain_ones[name].tobytes()) == name.startswith(
            ("safety", "slide", "hand", "delaying")
        )
    assert begun["follower_init"]["hearings"]["guards"].all()
    assert begun["leader_init"]["renderings"]["setup"]["position_scale"].item() == 2.0
