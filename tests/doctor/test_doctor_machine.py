"""Checks of this machine, with real parts: certificates, ports, disks, an image that is drawn, loops that run."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from datetime import UTC, datetime, timedelta
from importlib import metadata
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import config

from foretouch.core import compiling
from foretouch.doctor import Finding, Verdict, examine, worst
from foretouch.doctor.hardware import check_cores, check_governor, check_graphics, check_real_time
from foretouch.doctor.loops import check_loops, run_loops
from foretouch.doctor.surroundings import (
    check_compiled,
    check_disk,
    check_extras,
    check_keys,
    check_packages,
    check_port,
    check_python,
    check_text,
    parts_of,
    satisfies,
)
from foretouch.errors import install_command
from foretouch.link import KeyFolder

NOW = datetime(2030, 1, 1, tzinfo=UTC)


@pytest.mark.parametrize(
    ("verdicts", "expected"),
    [
        ((), Verdict.GOOD),
        ((Verdict.GOOD, Verdict.UNKNOWN), Verdict.GOOD),
        ((Verdict.WARNING, Verdict.UNKNOWN), Verdict.WARNING),
        ((Verdict.WARNING, Verdict.BAD, Verdict.GOOD), Verdict.BAD),
    ],
)
def test_the_worst_counts(verdicts: tuple[Verdict, ...], expected: Verdict) -> None:
    assert worst([Finding("x", verdict, "y") for verdict in verdicts]) is expected


def test_python_and_packages_that_run_this_test_are_good() -> None:
    assert check_python().verdict is Verdict.GOOD
    assert check_packages().verdict is Verdict.GOOD
    assert check_packages().figures["needed"]["numpy"] == metadata.version("numpy")


def test_code_that_was_never_compiled_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kept"))
    finding = check_compiled()
    assert (finding.verdict, finding.mend) == (Verdict.WARNING, "foretouch warm-up")
    compiling.mark_complete()
    assert check_compiled().verdict is Verdict.GOOD
    (tmp_path / "kept").chmod(0o777)
    compiling._say_once.cache_clear()
    assert check_compiled().verdict is Verdict.WARNING
    assert "each start compiles" in check_compiled().summary


def test_a_package_that_is_missing_or_too_old_is_named_with_what_brings_it() -> None:
    finding = check_packages(["numpy>=2.0", "no-such-package-of-ours>=1", "scipy>=999"])
    assert finding.verdict is Verdict.BAD
    assert "no-such-package-of-ours is not installed" in finding.summary
    assert "needed is >=999" in finding.summary
    assert finding.mend.startswith("pip install")


def test_extras_that_no_session_needs_are_no_warning() -> None:
    lines = ['numpy>=2.0; extra == "sim"', 'no-such-package-of-ours; extra == "gamepad"', 'x; extra == "dev"']
    finding = check_extras(lines)
    assert finding.verdict is Verdict.GOOD
    assert finding.mend == install_command("gamepad")
    assert finding.figures["complete"] == ["sim"]
    needed = check_extras(["no-such-package-of-ours<2; extra == 'link'", *lines])
    assert needed.verdict is Verdict.WARNING
    assert needed.mend == install_command("link")
    assert "no-such-package-of-ours is not installed" in needed.summary


def test_an_extra_of_the_wrong_version_is_a_warning() -> None:
    finding = check_extras(["numpy>=999; extra == 'gamepad'"])
    assert finding.verdict is Verdict.WARNING
    assert f"numpy {metadata.version('numpy')} is installed, needed is >=999" in finding.summary


def test_own_requirements_are_told_apart() -> None:
    parts = parts_of(metadata.requires("foretouch") or [])
    assert parts["sim"].keys() == {"mujoco"}
    assert "numpy" in parts[""]
    assert set(metadata.metadata("foretouch").get_all("Provides-Extra") or ()) == set(parts) - {""}


@given(st.lists(st.integers(0, 99), min_size=1, max_size=4), st.lists(st.integers(0, 99), min_size=1, max_size=4))
def test_versions_are_compared_as_packaging_does(ours: list[int], theirs: list[int]) -> None:
    specifiers = pytest.importorskip("packaging.specifiers")
    version, other = (".".join(map(str, part)) for part in (ours, theirs))
    for sign in (">=", "<=", "==", "!=", ">", "<"):
        assert satisfies(version, sign + other) == specifiers.SpecifierSet(sign + other).contains(version)


def test_cores_and_their_load(tmp_path: Path) -> None:
    assert check_cores(load=0.1, cores=4, group=tmp_path).verdict is Verdict.GOOD
    assert check_cores(load=3.9, cores=4, group=tmp_path).verdict is Verdict.WARNING
    assert check_cores(load=0.0, cores=1, group=tmp_path).verdict is Verdict.WARNING
    (tmp_path / "cpu.max").write_text("150000 100000\n")
    bounded = check_cores(load=0.1, cores=64, group=tmp_path)
    assert bounded.verdict is Verdict.WARNING
    assert bounded.figures["quota"] == 1.5
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert check_cores(load=0.1, cores=64, group=tmp_path).figures["quota"] is None


def test_governors(tmp_path: Path) -> None:
    assert check_governor(tmp_path).verdict is Verdict.UNKNOWN
    for number, governor in enumerate(("performance", "performance")):
        folder = tmp_path / f"cpu{number}" / "cpufreq"
        folder.mkdir(parents=True)
        (folder / "scaling_governor").write_text(f"{governor}\n")
    assert check_governor(tmp_path).verdict is Verdict.GOOD
    (tmp_path / "cpu1" / "cpufreq" / "scaling_governor").write_text("powersave\n")
    slow = check_governor(tmp_path)
    assert slow.verdict is Verdict.WARNING
    assert "scaling_governor" in slow.mend


def test_real_time_is_good_where_slices_are_granted_and_else_wants_a_priority() -> None:
    assert check_real_time(1e-4, (0, 0)).verdict is Verdict.GOOD
    without = check_real_time(0.0, (0, 0))
    assert without.verdict is Verdict.WARNING
    assert "limits.d" in without.mend
    assert check_real_time(0.0, (20, 0)).mend.startswith("chrt --fifo")
    assert check_real_time(None, (0, 0)).verdict is Verdict.UNKNOWN
    assert "nice down to -10" in check_real_time(1e-4, (0, 30)).summary


def test_text_that_is_no_utf_8_is_told() -> None:
    assert check_text().figures.keys() >= {"output", "locale", "file_names"}
    script = "from foretouch.doctor.surroundings import check_text as c; f = c(); print(f.verdict, f.mend, f.summary)"
    plain = {"PATH": os.environ["PATH"], "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"}
    told = subprocess.run([sys.executable, "-c", script], env=plain, capture_output=True, text=True, check=True).stdout
    assert told.startswith("warning export PYTHONUTF8=1 not all is UTF-8")
    good = plain | {"PYTHONUTF8": "1"}
    told = subprocess.run([sys.executable, "-c", script], env=good, capture_output=True, text=True, check=True).stdout
    assert told.startswith("good")


def test_a_disk_with_too_little_space_is_bad(tmp_path: Path) -> None:
    free = check_disk([tmp_path], little=1.0, too_little=0.5)
    assert free.verdict is Verdict.GOOD
    size = free.figures["free_bytes"][str(tmp_path)]
    assert check_disk([tmp_path], little=2.0 * size, too_little=0.0).verdict is Verdict.WARNING
    full = check_disk([Path(tempfile.gettempdir())], little=4.0 * size, too_little=2.0 * size)
    assert full.verdict is Verdict.BAD
    assert full.mend == f"du -xh {tempfile.gettempdir()} | sort -h | tail"
    assert check_disk([tmp_path / "nowhere"]).verdict is Verdict.BAD


def test_a_port_is_free_until_somebody_listens() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        taken.listen()
        finding = check_port(port)
        assert finding.verdict is Verdict.WARNING
        assert f"port {port} on 127.0.0.1 is in use" in finding.summary
        assert finding.mend == f"ss -ltnp 'sport = :{port}'"
    assert check_port(port).verdict is Verdict.GOOD


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    pytest.importorskip("cryptography")
    folder = KeyFolder(tmp_path / "keys")
    folder.init(NOW)
    folder.issue("leader", "", NOW, 365.0)
    return folder.path


def test_no_keys_are_good(tmp_path: Path) -> None:
    finding = check_keys(tmp_path / "keys", now=NOW)
    assert finding.verdict is Verdict.GOOD
    assert not (tmp_path / "keys").exists()


def test_a_certificate_that_ends_tomorrow_is_a_warning_and_one_that_ended_is_bad(keys: Path) -> None:
    assert check_keys(keys, now=NOW).verdict is Verdict.GOOD
    KeyFolder(keys).issue("follower", "lab", NOW, 1.0)
    soon = check_keys(keys, now=NOW)
    assert soon.verdict is Verdict.WARNING
    assert soon.mend == "foretouch keys rotate follower.lab"
    assert soon.figures["days_left"]["follower.lab"] == pytest.approx(1.0, abs=1e-3)
    assert "in 1.0 days" in soon.summary
    gone = check_keys(keys, now=NOW + timedelta(days=3))
    assert gone.verdict is Verdict.BAD
    assert "follower.lab has expired 2.0 days ago" in gone.summary


def test_a_certificate_of_another_authority_is_bad(keys: Path, tmp_path: Path) -> None:
    other = KeyFolder(tmp_path / "other")
    other.init(NOW)
    other.issue("follower", "", NOW)
    (keys / "follower.pem").write_bytes((other.path / "follower.pem").read_bytes())
    (keys / "follower.pem").chmod(0o600)
    finding = check_keys(keys, now=NOW)
    assert finding.verdict is Verdict.BAD
    assert finding.mend == "foretouch keys rotate follower"


def test_a_key_that_others_can_read_is_bad_and_the_command_says_how(keys: Path) -> None:
    (keys / "leader.pem").chmod(0o644)
    finding = check_keys(keys, now=NOW)
    assert finding.verdict is Verdict.BAD
    assert finding.mend == f"chmod 600 {keys / 'leader.pem'}"
    subprocess.run(finding.mend.split(), check=True)
    assert check_keys(keys, now=NOW).verdict is Verdict.GOOD


@pytest.mark.long
def test_an_image_is_really_drawn() -> None:
    finding = check_graphics()
    if finding.verdict is not Verdict.GOOD:
        pytest.skip(finding.summary)
    assert finding.figures["contrast"] > 30.0
    assert 0.0 < finding.figures["draw_s"] < 10.0


def test_nobody_who_draws_is_a_warning_with_the_packages_that_bring_it(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nowhere")  # where the library looks for who draws
    finding = check_graphics()
    assert finding.verdict is Verdict.WARNING
    assert "no camera image can be drawn" in finding.summary
    assert finding.mend.startswith("sudo apt-get install")


@pytest.mark.live
def test_two_loops_really_run() -> None:
    reports = run_loops(0.5)
    for kind in ("session", "bare"):
        report = reports[kind]
        assert report["ticks"] == 500
        assert 0.0 <= report["late_p50_s"] <= report["late_p99_s"] <= report["late_max_s"]
        assert 0.0 < report["compute_p50_s"] < 1e-3
    assert reports["session"]["compute_p50_s"] > reports["bare"]["compute_p50_s"]
    finding = check_loops(reports)
    assert finding.verdict in (Verdict.GOOD, Verdict.WARNING, Verdict.BAD)
    assert f"p99 {1e3 * reports['bare']['late_p99_s']:.3f}" in finding.summary


def report(late: float, most: float) -> dict[str, float]:
    return {
        "late_p50_s": 0.0,
        "late_p99_s": late,
        "late_max_s": most,
        "compute_p50_s": 2e-5,
        "compute_p99_s": 9e-5,
        "slice_s": 1e-4,
    }


@pytest.mark.parametrize(
    ("session", "bare", "verdict", "says"),
    [
        (report(1e-5, 1e-3), report(1e-5, 1e-3), Verdict.GOOD, "computes 20 us"),
        (report(8e-4, 3e-3), report(9e-4, 3e-3), Verdict.WARNING, "the machine itself is late"),
        (report(8e-4, 3e-3), report(1e-5, 3e-3), Verdict.WARNING, "what is computed is too slow"),
        (report(6e-3, 9e-3), report(1e-5, 3e-3), Verdict.BAD, "p99 6.000"),
        (report(1e-5, 0.08), report(1e-5, 3e-3), Verdict.BAD, "most 80.00 ms"),
    ],
)
def test_loops_are_judged_by_lateness(
    session: dict[str, float], bare: dict[str, float], verdict: Verdict, says: str
) -> None:
    finding = check_loops({"session": session, "bare": bare})
    assert finding.verdict is verdict
    assert says in finding.summary


def test_loops_that_could_not_run_say_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/bin/false")
    with pytest.raises(RuntimeError, match="loop ended"):
        run_loops(1.0)
    result = {finding.name: finding for finding in examine(seconds=1.0, say=lambda _: None)}
    assert result["loop at 1 kHz"].verdict is Verdict.UNKNOWN
    assert result["real time"].verdict is Verdict.UNKNOWN
    assert result["graphics"].verdict is Verdict.WARNING


def test_nothing_heavy_is_loaded_by_the_examination_itself() -> None:
    script = (
        "import sys, foretouch.doctor, foretouch.doctor.surroundings as s\n"
        "s.check_keys(); s.check_port(8080)\n"
        "print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert not {"scipy", "numba", "mujoco", "zenoh", "rich", "foretouch.session"} & set(loaded)
