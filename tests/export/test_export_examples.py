"""Programs of C and C++: the examples, and that of the guide, are built strictly and run; sessions go over a gate."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
from packages import NATIVE, needs

from foretouch import session
from foretouch.devices import ScriptedOperator
from foretouch.link import ZenohLink, free_endpoint
from foretouch.recordings import read_session
from foretouch.report import session_figures
from foretouch.session import LEADER_CHANNELS, SessionSettings, StopFlag, run_leader, wait_for_hello

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "c"
GUIDE = ROOT / "docs" / "export.md"
STRICT = ["-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wshadow"]
SOURCES = {
    "leader": "leader.c",
    "loop": "loop.cpp",
    "franka_follower": "libfranka/follower.cpp",
    "try_controller": "ros2_control/try_controller.cpp",
}
NETWORK = ["--jitter", "0.02", "--loss", "0.05"]
ROW = re.compile(r"^ +[\d.]+ +[-\d.]+ +(?P<felt>[-\d.]+) +(?P<robot>[-\d.]+) .*?(?P<status>\d+)$", re.MULTILINE)
pytestmark = NATIVE


def compile_strictly(package: Path, source: Path, out: Path, compiler: str) -> Path:
    """A program; what is C of the package is compiled as C."""
    needs(compiler, "gcc")
    plain = {"g++": "gcc", "clang++": "clang"}.get(compiler, compiler)
    include, objects = [f"-I{package}/include"], []
    for own in sorted((package / "src").glob("*.c")):
        objects.append(out.with_name(f"{out.name}.{own.stem}.o"))
        run([plain, "-std=c11", *STRICT, *include, "-c", own, "-o", objects[-1]])
    standard = "-std=c11" if source.suffix == ".c" else "-std=c++17"
    own = [*include, f"-I{EXAMPLES}", "-isystem", EXAMPLES / "stubs", source, *objects]
    run([compiler, standard, *STRICT, "-pthread", *own, package / "lib" / "foretouch_kernels.o", "-lm", "-o", out])
    return out


def run(command: list[object], seconds: float = 60.0) -> str:
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=seconds, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def programs(package: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    out = tmp_path_factory.mktemp("programs")
    made = {}
    for name, source in SOURCES.items():
        compiler = "gcc" if source.endswith(".c") else "g++"
        made[name] = compile_strictly(package, EXAMPLES / source, out / name, compiler)
    return made


@pytest.mark.parametrize("name", SOURCES)
@pytest.mark.first
def test_an_example_compiles_with_clang_too(package: Path, tmp_path: Path, name: str) -> None:
    source = EXAMPLES / SOURCES[name]
    compile_strictly(package, source, tmp_path / name, "clang" if source.suffix == ".c" else "clang++")


@pytest.mark.long
def test_cmake_builds_every_example(package: Path, tmp_path: Path) -> None:
    needs("cmake")
    run(["cmake", "-S", EXAMPLES, "-B", tmp_path, f"-DFORETOUCH_PACKAGE={package}"])
    run(["cmake", "--build", tmp_path], 180.0)
    assert all((tmp_path / name).is_file() for name in SOURCES)


def test_every_stub_says_what_it_is() -> None:
    for stub in (EXAMPLES / "stubs").rglob("*.h*"):
        assert stub.read_text().startswith("// A STUB of "), stub
    for skeleton in ("libfranka/follower.cpp", "ros2_control/follower_controller.cpp"):
        assert "NEVER RUN WITH " in (EXAMPLES / skeleton).read_text()


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.first
def test_the_first_program_of_the_guide(package: Path, tmp_path: Path, compiler: str) -> None:
    (text,) = re.findall(r"^```c\n(#include.*?)^```$", GUIDE.read_text(), re.DOTALL | re.MULTILINE)
    assert len(list(filter(str.strip, text.splitlines()))) <= 25
    (said,) = re.findall(r"^It prints `(.+)`", GUIDE.read_text(), re.MULTILINE)
    (tmp_path / "first.c").write_text(text)
    program = compile_strictly(package, tmp_path / "first.c", tmp_path / "first", compiler)
    assert run([program]) == f"{said}\n"


def judge(output: str, felt: float) -> None:
    """What a leader or a loop prints: contact is felt, its energy is bounded, nothing is refused."""
    largest = re.search(r"largest force felt: (.+) N", output)
    margin = re.search(r"least energy above its bound: (.+) J", output)
    assert largest is not None, output
    assert margin is not None, output
    assert felt < float(largest[1]) < 10.0
    assert float(margin[1]) >= 0.0
    rows = [{name: float(value) for name, value in row.groupdict().items()} for row in ROW.finditer(output)]
    assert len(rows) >= 10
    assert {row["status"] for row in rows} <= {0.0, 1.0, 2.0}, output  # it follows, is guarded, or returns
    assert max(abs(row["robot"]) for row in rows) > felt


@pytest.mark.live
@pytest.mark.long
def test_a_loop_in_cpp_is_a_session(programs: dict[str, Path]) -> None:
    output = run([programs["loop"], 6])
    judge(output, 1.0)
    late = re.search(r"late by [\d.]+ us \(median\)", output)
    assert late is not None


class Process:
    """A command of foretouch, with what it prints in a file."""

    def __init__(self, folder: Path, name: str, *words: object) -> None:
        self.log, self.out = folder / f"{name}.err", folder / f"{name}.out"
        command = [sys.executable, "-m", "foretouch", *map(str, words), "--json"]
        with self.log.open("w") as err, self.out.open("w") as out:
            self.process = subprocess.Popen(command, stdout=out, stderr=err)

    def wait_for(self, words: str, seconds: float = 90.0) -> None:
        end = time.monotonic() + seconds
        while words not in self.log.read_text():
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end, self.log.read_text()
            time.sleep(0.05)

    def ended(self) -> dict[str, object]:
        assert self.process.wait(20.0) == 0, self.log.read_text()
        answer: dict[str, object] = msgspec.json.decode(self.out.read_bytes())
        return answer


@contextmanager
def running() -> Iterator[list[Process]]:
    processes: list[Process] = []
    try:
        yield processes
    finally:
        for one in processes:
            if one.process.poll() is None:
                one.process.kill()
                one.process.wait()


@pytest.mark.live
@pytest.mark.long
def test_a_leader_in_c_feels_what_a_follower_in_python_presses(programs: dict[str, Path], tmp_path: Path) -> None:
    between, beside, at = free_endpoint(), free_endpoint(), free_endpoint()
    path = tmp_path / "session.mcap"
    with running() as processes:
        follower = Process(tmp_path, "follower", "follower", "--listen", between, "--position-delay", 0.08, *NETWORK)
        ends = ["--connect", between, "--listen", beside, "--at", at]
        gate = Process(tmp_path, "gate", "gate", *ends, "--delay", 0.08, *NETWORK)
        recorder = Process(tmp_path, "record", "record", path, "--connect", between, "--connect", beside)
        processes += [follower, gate, recorder]
        gate.wait_for("a leader may connect")
        follower.wait_for("waiting for a leader")
        output = run([programs["leader"], "127.0.0.1", at.rpartition(":")[2], 8])
        judge(output, 1.0)
        assert "models refused: 0" in output
        trips = [float(row.split()[4]) for row in output.splitlines() if ROW.match(row)]
        assert min(trips[2:]) > 120.0
        assert max(trips[2:]) < 300.0
        counts = follower.ended()
        assert gate.ended()["ended"] == counts["ended"] == "the leader's time is over"
        assert counts["step_failures"] == counts["faulty_ticks"] == counts["follower_undecodable"] == 0
        assert recorder.ended()["problem"] is None
    figures = session_figures(read_session(path))
    assert figures["status"] == "ok"
    assert figures["energy_margin_J"] >= 0.0
    assert figures["largest_rendered_update_jump_N"] < 0.5
    assert figures["prediction_error_percent"] < 0.6 * figures["delayed_force_error_percent"]


@pytest.mark.live
@pytest.mark.long
@pytest.mark.parametrize("side", ["franka_follower", "try_controller"])
def test_a_leader_in_c_feels_what_a_follower_in_cpp_presses(
    programs: dict[str, Path], tmp_path: Path, side: str
) -> None:
    """Each by a gate of its own. Neither follower has run with the library that it is for."""
    between, near, far = free_endpoint(), free_endpoint(), free_endpoint()
    with running() as processes:
        delayed = ["--delay", 0.08, *NETWORK]
        there = Process(tmp_path, "there", "gate", "--side", "follower", "--listen", between, "--at", far, *delayed)
        here = Process(tmp_path, "here", "gate", "--connect", between, "--at", near, *delayed)
        processes += [there, here]
        there.wait_for("a follower may connect")
        here.wait_for("a leader may connect")
        port = far.rpartition(":")[2]
        words = ["arm", "127.0.0.1", port] if side == "franka_follower" else ["127.0.0.1", port, "12"]
        with subprocess.Popen([programs[side], *words], stdout=subprocess.PIPE, text=True) as follower:
            output = run([programs["leader"], "127.0.0.1", near.rpartition(":")[2], 8])
            said, _ = follower.communicate(timeout=20)
        assert follower.returncode == 0
        judge(output, 1.0)
        assert float(said.rpartition(" N")[0].rpartition(" ")[2]) < 0.5  # it has let go
        assert there.ended()["dropped"] == here.ended()["dropped"] == 0


class Telling(ScriptedOperator):
    """A hand that remembers the largest force that it was given [N]."""

    felt = 0.0

    def render(self, force: float) -> float:
        self.felt = max(self.felt, force)
        return super().render(force)


@pytest.mark.live
@pytest.mark.long
def test_a_leader_in_python_feels_what_a_follower_in_cpp_presses(programs: dict[str, Path], tmp_path: Path) -> None:
    between, far = free_endpoint(), free_endpoint()
    settings = SessionSettings(force_delay=0.08, jitter=0.02, loss=0.05)
    with running() as processes:
        words = ["--side", "follower", "--listen", between, "--at", far, "--delay", 0.08, *NETWORK]
        processes.append(Process(tmp_path, "gate", "gate", *words))
        processes[0].wait_for("a follower may connect")
        command = [programs["franka_follower"], "arm", "127.0.0.1", far.rpartition(":")[2]]
        hand, stop = Telling(surface=0.010, press_depth=0.006), StopFlag()
        with (
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as follower,
            ZenohLink(connect=[between], subscribe=LEADER_CHANNELS) as link,
        ):
            assert "process" in wait_for_hello(link, {"follower"}, stop, timeout=20.0)["follower"]
            own = session.Process(link, stop, lambda _: None)
            ran = run_leader(own, hand, settings, description={}, duration=8.0)
            said, _ = follower.communicate(timeout=20)
    assert follower.returncode == 0, said
    assert 1.0 < hand.felt < 10.0
    assert ran["models_refused"] == ran["leader_undecodable"] == 0
