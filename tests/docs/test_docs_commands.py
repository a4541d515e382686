"""Every `foretouch` command that the documentation shows runs, in a short form; so do its Python blocks.

A command that is not one of `OFFLINE` or `LIVE` fails here: give a new one its short form.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from docs_pages import ROOT, Block, blocks, commands
from typer.main import get_command
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.link import ZenohLink
from foretouch.recordings import DATA_DIR, DATASETS
from menagerie import write_arm


def lasting(seconds: float) -> Callable[[list[str]], list[str]]:
    """A short form: this duration instead of the command's own."""
    return lambda arguments: [*without(arguments, "--duration"), "--duration", str(seconds)]


def as_it_is(arguments: list[str]) -> list[str]:
    return arguments


def here(words: list[str]) -> list[str]:
    """In this process: tests of the comparison have a cluster and workers of their own, which take longer to start than
    this work does. And workers that are kept would look for the files of later tests in the folder of this one."""
    return [*without(without(words, "--cluster"), "--jobs"), "--jobs", "1"]


def one_law_without_simulation(words: list[str]) -> list[str]:
    """Every law by every estimator on nine simulated recordings takes minutes; one on few files goes the same way."""
    words = here(without(without(words, "--models"), "--estimators"))
    words = [word for word in words if word != "--simulated"]
    files = words if any("." in word for word in words) else [*words, "press.csv"]
    return [*files, "--models", "kelvin-voigt", "--estimators", "rls"]


def only_the_quickest_section(words: list[str]) -> list[str]:
    """The whole reproduction takes minutes; one section goes through the same code."""
    return words if "--only" in words else [*words, "--only", "fig2"]


def short_sessions(words: list[str], count: int = 1) -> list[str]:
    """A sweep takes an hour; one session of it goes the same way, and a replay needs some first."""
    few = ["--sessions", str(count), "--baselines", "0", "--duration", "2"]
    return words if "--replay" in words else [*here(words), *few]


def only_the_quickest_benchmark(words: list[str]) -> list[str]:
    """All benchmarks take minutes; one goes the same way."""
    return [words[0], "--only", "batch", *(["--json"] if "--json" in words else [])]


def in_new_keys(words: list[str]) -> list[str]:
    """In a folder of its own, with an authority and what there is to be shown or made again."""
    if words[1] != "init":
        run(["keys", "init", "--keys", "keys"])
    if words[1] in ("show", "rotate"):
        run(["keys", "issue", "leader", "--keys", "keys"])
    return [*words, "--keys", "keys"]


def of_touched_scenes(words: list[str]) -> list[str]:
    """With the recordings of two sessions on one surface, and with their map."""
    still = ["--fusion", "none", "--displacement", "0", "--turn", "0", "--duration", "9"]
    for day, seed in (("monday", "1"), ("tuesday", "2")):
        run(["simulate", "--scene", "plane", *still, "--seed", seed, "--recording", f"{day}.mcap"])
    if words[1] == "show":
        run(["map", "merge", "monday.mcap", "tuesday.mcap", "--out", "specimen.ply"])
    return words


OFFLINE: dict[tuple[str, ...], Callable[[list[str]], list[str]]] = {
    ("--help",): as_it_is,
    ("--version",): as_it_is,
    ("warm-up",): as_it_is,
    ("simulate",): lasting(0.3),
    ("identify",): as_it_is,
    ("predict",): as_it_is,
    ("report",): as_it_is,
    ("replay",): as_it_is,
    ("calibrate", "sensor"): as_it_is,
    ("calibrate", "compliance"): as_it_is,
    ("arms", "meshes"): as_it_is,
    ("datasets", "list"): as_it_is,
    ("datasets", "fetch"): as_it_is,
    ("recordings", "repair"): as_it_is,
    ("recordings", "inspect"): as_it_is,
    ("recordings", "convert"): as_it_is,
    ("map", "merge"): of_touched_scenes,
    ("map", "show"): of_touched_scenes,
    ("network", "list"): as_it_is,
    ("network", "show"): as_it_is,
    ("materials", "list"): as_it_is,
    ("materials", "fit"): as_it_is,
    ("plugins",): as_it_is,
    ("plugins", "check"): as_it_is,
    ("export", "c"): as_it_is,
    ("export", "page"): as_it_is,
    ("keys", "init"): in_new_keys,
    ("keys", "issue"): in_new_keys,
    ("keys", "rotate"): in_new_keys,
    ("keys", "show"): in_new_keys,
    ("compare",): one_law_without_simulation,
    ("reproduce",): only_the_quickest_section,
    ("sweep",): short_sessions,
    ("bench",): only_the_quickest_benchmark,
}
"""Commands that end by themselves, and their short forms."""

ALONE = ("teleop", "stop", "release", "camera", "bridge", "gate", "doctor", "network")
"""Commands of a session in real time that have a test of their own, and no place in a lap."""

LIVE = ("follower", "leader", "record", "console", *ALONE)
"""Commands of a session in real time."""

ELSEWHERE = "ros2@"
"""Commands with this need a graph, and are tried in `tests/ros2`."""

UDP = "udp@127.0.0.1:47100"
"""The robot of the first day, `examples/udp_robot`: here at a port of its own."""

SHADOW = "--shadow"
"""A follower with this watches, and stops nothing."""


def without(arguments: list[str], option: str) -> list[str]:
    """The arguments without an option and its value."""
    if option not in arguments:
        return arguments
    place = arguments.index(option)
    return without(arguments[:place] + arguments[place + 2 :], option)


COMMAND: Any = get_command(app)


def examples() -> dict[str, str]:
    """The examples in the help of the commands."""
    result: dict[str, str] = {}

    def look(command: Any, name: str) -> None:
        for text in re.findall(r"Example: foretouch (.+)", " ".join((command.help or "").split())):
            result[text] = f"foretouch {name} --help"
        for child, inner in getattr(command, "commands", {}).items():
            look(inner, f"{name} {child}".strip())

    look(COMMAND, "")
    return result


SHOWN = examples() | commands()


def of(*words: str) -> list[str]:
    return [text for text in SHOWN if tuple(shlex.split(text)[: len(words)]) == words]


def kind(text: str) -> tuple[str, ...] | None:
    """The key of a command in `OFFLINE`, or its name in `LIVE`."""
    words = shlex.split(text)
    for length in (2, 1):
        if tuple(words[:length]) in OFFLINE:
            return tuple(words[:length])
    return (words[0],) if words[0] in LIVE else None


def test_the_commands_are_found() -> None:
    assert len(SHOWN) > 25
    assert {"README.md", "docs/getting-started.md"} <= {place.split(":")[0] for place in SHOWN.values()}


@pytest.mark.parametrize("text", SHOWN)
def test_every_command_has_a_short_form_and_known_options(text: str) -> None:
    assert kind(text) is not None, f"{SHOWN[text]}: foretouch {text} has no short form in {Path(__file__).name}"
    command, words = COMMAND, shlex.split(text)
    name = "foretouch"
    while hasattr(command, "commands") and words and words[0] in command.commands:
        name = words.pop(0)
        command = command.commands[name]
    if words[:1] != ["--help"]:
        command.make_context(name, words)  # raises on an option that is not there


@pytest.fixture(scope="module")
def udp_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The name of that robot, built and running."""
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("the other end needs a C++ compiler")
    built, header = tmp_path_factory.mktemp("udp") / "robot", ROOT / "src" / "foretouch" / "robot" / "drivers"
    source = ROOT / "examples" / "udp_robot" / "robot.cpp"
    subprocess.run([compiler, "-std=c++17", "-O2", "-I", str(header), str(source), "-o", str(built)], check=True)
    port = free_port()
    with subprocess.Popen([str(built), str(port)], stdout=subprocess.DEVNULL) as robot:
        yield f"udp@127.0.0.1:{port}"
        robot.kill()


def with_its_robot(arguments: list[str], request: pytest.FixtureRequest) -> list[str]:
    """The same command with that robot where it runs."""
    if UDP not in arguments:
        return arguments
    name: str = request.getfixturevalue("udp_robot")
    return [name if word == UDP else word for word in arguments]


# --- commands that end by themselves ----------------------------------------------------------------------------------


def write_press(path: Path, scale: float = 1.0) -> dict[str, np.ndarray]:
    """Presses of a Hunt-Crossley material as CSV, positions times `scale`; the columns in SI units."""
    time = np.arange(0.0, 4.0, 1e-3)
    position = 0.010 + 0.006 * np.sin(2.0 * np.pi * 0.9 * time - 1.5)
    depth, velocity = np.maximum(position - 0.010, 0.0), np.gradient(position, time)
    noise = 0.005 * np.random.default_rng(3).standard_normal(time.size)
    force = np.maximum(depth**1.4 * (3000.0 + 1500.0 * velocity), 0.0) + 0.5 + noise
    rows = (f"{t:.4f},{scale * x:.7g},{f:.6f}" for t, x, f in zip(time, position, force, strict=True))
    path.write_text("time_s,position_m,force_N\n" + "\n".join(rows) + "\n")
    return {"time_s": time, "position_m": position, "force_N": force}


def write_foreign_press(folder: Path, columns: dict[str, np.ndarray]) -> None:
    """The same presses as a spreadsheet and as a robot would leave them: `tensile.csv`, and a rosbag2 in `bag`."""
    rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
    rows = [f"{t:.3f};{1e3 * x:.5f};{f:.5f};gut" for t, x, f in zip(*columns.values(), strict=True)]
    (folder / "tensile.csv").write_text("Zeit [s];Weg [mm];Kraft [N];Notiz\n" + "\n".join(rows).replace(".", ","))
    run(["recordings", "inspect", str(folder / "tensile.csv"), "--save", str(folder / "tensile.toml")])
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    of = store.types
    vector, nothing = of["geometry_msgs/msg/Vector3"], np.empty(0)
    plugin = rosbag2.StoragePlugin.SQLITE3
    with rosbag2.Writer(folder / "bag", version=9, storage_plugin=plugin) as writer:
        kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/ft/wrench": "geometry_msgs/msg/WrenchStamped"}
        topics = {name: writer.add_connection(name, kind, typestore=store) for name, kind in kinds.items()}
        for tick, (_, x, f) in enumerate(zip(*columns.values(), strict=True)):
            stamp = of["builtin_interfaces/msg/Time"](1_700_000_000 + tick // 1000, tick % 1000 * 1_000_000)
            header, log_ns = of["std_msgs/msg/Header"](stamp, "tool"), (1_700_000_000_000 + tick) * 1_000_000
            wrench = of["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, f), vector(0.0, 0.0, 0.0))
            output = {"/ft/wrench": of[kinds["/ft/wrench"]](header, wrench)}
            if tick % 2 == 0:
                at = np.array([x / 0.075])
                output["/joint_states"] = of[kinds["/joint_states"]](header, ["lever"], at, nothing, nothing)
            for name, message in output.items():
                writer.write(topics[name], log_ns, store.serialize_cdr(message, kinds[name]))


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The files that the commands name."""
    folder = tmp_path_factory.mktemp("samples")
    columns = write_press(folder / "press.csv")
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    parquet.write_table(pyarrow.table(columns), folder / "press.parquet")
    for name in ("poses.csv", "wrist.csv", "fr3.csv", "block.csv", "spring.csv", "lever.toml"):
        shutil.copy(ROOT / "docs" / "examples" / name, folder)
    write_foreign_press(folder, columns)
    run(["recordings", "convert", str(folder / "press.csv"), str(folder / "press.mcap")])
    for poses, file in (("poses.csv", "sensor.toml"), ("fr3.csv", "fr3.toml")):
        run(["calibrate", "sensor", str(folder / poses), "--output", str(folder / file)])
    run(["simulate", "--duration", "2.5", "--material", "hunt-crossley", "--recording", str(folder / "session.mcap")])
    return folder


@pytest.fixture
def folder(samples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder of its own with the sample files."""
    shutil.copytree(samples, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(arguments: list[str]) -> str:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, f"foretouch {shlex.join(arguments)}: {result.exception}\n{result.output}"
    return result.stdout


SLOW = (
    *(("materials", "fit"), ("bench",), ("sweep",), ("reproduce",), ("simulate",)),
    *(("export", "c"), ("export", "page"), ("map", "merge"), ("map", "show")),
)
"""Commands that take long in any form; their parts have tests of their own."""


def one_now(many: list[Any], *, slow: bool = False) -> list[Any]:
    """The first of many as it is, unless that is slow, the others among what takes long."""
    now = 0 if slow else 1
    return [*many[:now], *(pytest.param(other, marks=pytest.mark.long) for other in many[now:])]


def one_of_each_now() -> list[Any]:
    """The first of each command as it is, the others among what takes long; the options of all are looked at."""
    result: dict[tuple[str, ...], list[str]] = {}
    for text in SHOWN:
        if (key := kind(text)) in OFFLINE and key is not None:
            result.setdefault(key, []).append(text)
    return [one for key, many in result.items() for one in one_now(many, slow=key in SLOW)]


def publish(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Something in the place of an original, and its checksum in the registry: nothing is downloaded for a test."""
    dataset = replace(DATASETS[name], sha256=hashlib.sha256(b"volts").hexdigest())
    path = folder / dataset.origin.local_folder / dataset.file
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"volts")
    monkeypatch.setitem(DATASETS, name, dataset)
    monkeypatch.setenv(DATA_DIR, str(folder))


@pytest.mark.parametrize("text", one_of_each_now())
def test_a_command_runs_in_its_short_form(
    text: str, folder: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    key = kind(text)
    assert key is not None
    arguments = with_its_robot(shlex.split(text), request)
    if key == ("datasets", "fetch"):
        publish(arguments[2], folder, monkeypatch)
    if key == ("arms", "meshes"):
        write_arm(arguments[2], folder / "menagerie")
        monkeypatch.setenv(DATA_DIR, str(folder))
    if "--replay" in arguments:
        run(short_sessions(["sweep", "--out", "out/sweep"], 2))
    if "--position-unit mm" in text:
        write_press(folder / arguments[1], -1e3 if "--flip" in arguments else 1e3)
    there = set(folder.rglob("*"))
    assert run(OFFLINE[key](arguments)).strip() or key == ("warm-up",)  # which has no result
    for option in ("--out", "--output", "--recording", "--report"):
        if option in arguments:
            made = folder / arguments[arguments.index(option) + 1]
            assert made.exists(), f"{SHOWN[text]}: {option} wrote nothing"
    assert not [path for path in set(folder.rglob("*")) - there if path.name.startswith(".")], "left half-written"


# --- commands of a live session ---------------------------------------------------------------------------------------


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start(arguments: list[str], folder: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "foretouch", *arguments]
    return subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(process: subprocess.Popen[str], seconds: float = 40.0) -> str:
    """Output of a process that must end well by itself."""
    out, err = process.communicate(timeout=seconds)
    assert process.returncode == 0, f"{shlex.join(process.args[2:])}: exit code {process.returncode}\n{err}"  # type: ignore[index]
    return out


@pytest.fixture
def running() -> Iterator[list[subprocess.Popen[str]]]:
    """Processes that the test starts; none stays behind."""
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
            try:
                process.communicate(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()


@pytest.mark.live
@pytest.mark.long
@pytest.mark.parametrize("text", of("teleop"), ids=str)
def test_a_session_runs_in_its_short_form(
    text: str, tmp_path: Path, running: list[subprocess.Popen[str]], request: pytest.FixtureRequest
) -> None:
    arguments = with_its_robot(lasting(1.5)(shlex.split(text)), request)
    if "--headless" not in arguments:
        arguments = [*without(arguments, "--port"), "--port", str(free_port())]
    running.append(start(arguments, tmp_path))
    out = finish(running[0])
    assert '"prediction_error_percent"' in out if "--json" in arguments else "Forces at equal command" in out
    assert list(tmp_path.rglob("*.mcap"))


def doctors_now() -> list[Any]:
    """Who answers; who looks takes long, and tests of the doctor start one too."""
    looks, answers = ([text for text in of("doctor") if ("--listen" in text) is listens] for listens in (False, True))
    return [*answers, *one_now(looks, slow=True)]


@pytest.mark.network
@pytest.mark.parametrize("text", doctors_now())
def test_a_doctor_looks_and_answers(
    text: str, tmp_path: Path, running: list[subprocess.Popen[str]], request: pytest.FixtureRequest
) -> None:
    """Who asks somebody finds nobody here; whether this machine is fit is not this test's matter."""
    arguments = with_its_robot(without(shlex.split(text), "--seconds"), request)
    if "--listen" in arguments:
        arguments = [*without(arguments, "--listen"), "--listen", f"tcp/127.0.0.1:{free_port()}", "--duration", "1"]
    elif "--connect" in arguments:
        arguments = [*without(arguments, "--connect"), "--connect", f"tcp/127.0.0.1:{free_port()}"]
    running.append(start([*arguments, "--seconds", "0.2"], tmp_path))
    out, err = running[0].communicate(timeout=60)
    assert running[0].returncode in (0, 1), err
    assert "questions answered" in out if "--listen" in arguments else "all in all:" in out


def laps() -> Iterator[dict[str, str]]:
    """The commands of single sides, combined so that each is in at least one lap; robots are stopped in the first."""
    names = [name for name in LIVE if name not in ALONE]
    here = {name: [text for text in of(name) if ELSEWHERE not in text] for name in names}
    sides = {name: sorted(texts, key=lambda text: SHADOW in text) for name, texts in here.items()}
    stops = of("stop")
    for lap in range(max(map(len, sides.values()))):
        one = {name: texts[lap % len(texts)] for name, texts in sides.items()}
        yield one | ({"stop": stops.pop(0)} if stops and SHADOW not in one["follower"] else {})
    assert not stops


def on_this_machine(text: str, kind: str, ports: tuple[int, int]) -> list[str]:
    """The same command with endpoints here: the follower listens on the first port, the leader on the second."""
    words = shlex.split(text)
    expected = {
        ("follower", "--listen"): [0],
        ("leader", "--connect"): [0],
        ("leader", "--listen"): [1],
        ("record", "--connect"): [0, 1],
        ("console", "--connect"): [0, 1],
        ("stop", "--connect"): [0],
        ("camera", "--connect"): [0],
        ("camera", "--listen"): [1],
        ("bridge", "--connect"): [0, 1],
        ("gate", "--connect"): [0],
        ("gate", "--listen"): [0],
        ("gate", "--at"): [1],
    }
    for option in ("--listen", "--connect", "--at"):
        places = [i + 1 for i, word in enumerate(words) if word == option]
        for number, place in enumerate(places):
            words[place] = f"{kind}/127.0.0.1:{ports[expected[words[0], option][number]]}"
    return words


def stop_the_robot(arguments: list[str], folder: Path, seconds: float = 40.0) -> None:
    """Ask again where the follower has not begun yet."""
    end = time.monotonic() + seconds
    while True:
        asking = start(arguments, folder)
        out, err = asking.communicate(timeout=20)
        if asking.returncode == 0:
            assert out.startswith("the robot has stopped: ")
            return
        assert asking.returncode == 1
        assert time.monotonic() < end, err


def release_the_robot(folder: Path) -> None:
    (text,) = set(of("release"))
    command = [sys.executable, "-m", "foretouch", *shlex.split(text)]
    output = subprocess.run(command, cwd=folder, input="y\nrelease\n", capture_output=True, text=True, timeout=20)
    assert output.stdout.endswith("the robot follows again, slowly at first\n"), output.stderr


@pytest.mark.live
@pytest.mark.parametrize("lap", one_now(list(laps())), ids=lambda lap: lap["leader"])
@pytest.mark.long
def test_the_sides_run_one_by_one(
    lap: dict[str, str],
    tmp_path: Path,
    running: list[subprocess.Popen[str]],
    monkeypatch: pytest.MonkeyPatch,
    request: pytest.FixtureRequest,
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # other followers of this machine are not meant
    ports = (free_port(), free_port())
    kind = "tls" if "tls/" in lap["leader"] else "tcp"
    if kind == "tls":
        monkeypatch.setenv("FORETOUCH_KEYS", str(tmp_path / "keys"))
        for words in (["init"], ["issue", "leader"], ["issue", "follower"], ["issue", "watcher"]):
            run(["keys", *words])
    if "fr3.toml" in lap["follower"]:
        poses = ROOT / "docs" / "examples" / "fr3.csv"
        run(["calibrate", "sensor", str(poses), "--output", str(tmp_path / "fr3.toml")])
    follower = with_its_robot(without(on_this_machine(lap["follower"], kind, ports), "--duration"), request)
    leader = lasting(1.5)(on_this_machine(lap["leader"], kind, ports))
    recorder = on_this_machine(lap["record"], kind, ports)
    console = [*without(on_this_machine(lap["console"], kind, ports), "--port"), "--port", str(free_port())]
    running += [start([*arguments, "--json"], tmp_path) for arguments in (follower, recorder, console)]
    if "stop" in lap:
        stop_the_robot(on_this_machine(lap["stop"], kind, ports), tmp_path)
        release_the_robot(tmp_path)
    waits = "--listen" in leader and recorder.count("--connect") == 2
    running.append(start([*leader, "--json", *(["--wait-for-recorder"] if waits else [])], tmp_path))
    output = [json.loads(finish(process)) for process in reversed(running)]
    assert all(one["ended"] for one in output)
    assert output[0]["commands_sent"] > 1000
    assert output[0]["ended"] == output[-1]["ended"] == "the duration is over"
    assert [one["problem"] for one in output if "recording" in one] == [None]
    assert (tmp_path / recorder[1]).stat().st_size > 10_000


@pytest.mark.live
@pytest.mark.long
@pytest.mark.parametrize("text", of("camera"), ids=str)
def test_a_camera_sees_beside_a_follower(text: str, tmp_path: Path, running: list[subprocess.Popen[str]]) -> None:
    ports = (free_port(), free_port())
    arguments = on_this_machine(text, "tcp", ports)
    scene = arguments[arguments.index("--scene") + 1]
    beside = ["follower", "--scene", scene, "--listen", f"tcp/127.0.0.1:{ports[0]}"]
    running += [start([*one, "--json"], tmp_path) for one in (arguments, beside)]
    end = time.monotonic() + 60.0
    with ZenohLink(connect=[f"tcp/127.0.0.1:{ports[1]}"], subscribe=["fixture"]) as link:
        while not any(belief.images for _, belief in link.take("fixture")):
            assert [process.poll() for process in running] == [None, None]
            assert time.monotonic() < end, "no image was used"
            time.sleep(0.02)
    running[1].send_signal(signal.SIGINT)  # the follower's last word ends the camera
    watching, following = (json.loads(finish(process)) for process in running)
    assert following["telemetry_sent"] > 100
    assert watching["images_used"] > 0


@pytest.mark.long  # the bridge itself is tried in tests/ros2
@pytest.mark.network
@pytest.mark.parametrize("text", of("bridge"), ids=str)
def test_a_bridge_tries_until_it_is_told_to_end(
    text: str, tmp_path: Path, running: list[subprocess.Popen[str]]
) -> None:
    arguments = on_this_machine(text, "tcp", (free_port(), free_port()))
    running.append(start([*arguments, "--json", "--router", f"tcp/127.0.0.1:{free_port()}"], tmp_path))
    assert running[0].stderr is not None
    assert running[0].stderr.readline().startswith("bridge: no ROS 2 router at tcp/127.0.0.1:")
    running[0].send_signal(signal.SIGTERM)
    assert json.loads(finish(running[0])) == {"ended": "terminated", "sent": {}, "unsent": 0}


@pytest.mark.network
@pytest.mark.parametrize("text", one_now(of("gate")), ids=str)
@pytest.mark.long
def test_a_gate_waits_until_it_is_told_to_end(text: str, tmp_path: Path, running: list[subprocess.Popen[str]]) -> None:
    running.append(start([*on_this_machine(text, "tcp", (free_port(), free_port())), "--json"], tmp_path))
    assert running[0].stderr is not None
    assert " may connect at tcp/127.0.0.1:" in running[0].stderr.readline()
    running[0].send_signal(signal.SIGTERM)
    assert json.loads(finish(running[0])) == {"ended": "terminated", "taken": 0, "handed": 0, "dropped": 0}


@pytest.mark.network
@pytest.mark.long
def test_a_network_is_measured_and_answered(tmp_path: Path, running: list[subprocess.Popen[str]]) -> None:
    asks, answers = (shlex.split(text) for text in (*of("network", "measure")[:1], *of("network", "answer")[:1]))
    here = f"127.0.0.1:{free_port()}"
    running.append(start(["network", "answer", here, *answers[3:], "--json"], tmp_path))
    assert running[0].stderr is not None
    assert "answers on" in running[0].stderr.readline()
    running.append(start(["network", "measure", here, *without(asks[3:], "--seconds"), "--seconds", "1"], tmp_path))
    assert "longest stall" in finish(running[1])
    running[0].send_signal(signal.SIGINT)
    assert json.loads(finish(running[0]))["answered"] > 100
    assert (tmp_path / asks[asks.index("--out") + 1]).read_text().startswith("# foretouch network measure")


# --- Python -----------------------------------------------------------------------------------------------------------


PYTHON = [block for block in blocks() if block.language == "python"]


@pytest.mark.parametrize("block", PYTHON, ids=lambda block: f"{block.page}:{block.line}")
@pytest.mark.first
@pytest.mark.network  # one looks at the pace of a driver
def test_a_python_block_runs(block: Block, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block.text, f"{block.page}:{block.line}", "exec"), {"__name__": "__main__"})
    capsys.readouterr()


def test_there_are_python_blocks() -> None:
    assert len(PYTHON) >= 3
