"""Measure what one recording, one simulated session and one live session cost: the table of `docs/scale.md`.

Usage: `.venv/bin/python docs/measure_scale.py`; it takes about two minutes.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from measured_blocks import fill

from foretouch import comparison
from foretouch.comparison.combination import Combination, Scoring, try_combination
from foretouch.link import free_endpoint
from foretouch.messages import VERSION, Command, LeaderState, Telemetry, encode
from foretouch.recordings import SessionWriter, write_columns
from foretouch.session import SAMPLE_PERIOD, SessionSettings, make_operator, make_session_robot, simulate

PAGE = Path(__file__).parent / "scale.md"

SECONDS = 60.0
"""Of the recording, and of the session in simulated time."""

LIVE = 20.0
"""Of the live session [s]; its first 5 s, in which all is loaded, are not counted."""

FLOWS = 3
"""Sessions whose messages pass one router here."""

Costs = dict[str, float]


def costs() -> str:
    """What is measured, as a table."""
    found = simulated() | live() | router()
    rows = [
        ("a recording of 60 s through `compare`, contact map, one delay", f"{found['recording_s']:.2f} s of one core"),
        ("a session of 60 s in simulated time", f"{found['session_s']:.2f} s of one core"),
        *(
            (
                f"a live session's {role}",
                f"{100 * found[f'{role}_cores']:.0f} % of a core, {found[f'{role}_MB']:.0f} MB",
            )
            for role in ROLES
        ),
        ("its network, to the follower", f"{found['forth_kbit']:.0f} kbit/s, {found['forth_messages']:.0f} messages/s"),
        ("its network, to the leader", f"{found['back_kbit']:.0f} kbit/s, {found['back_messages']:.0f} messages/s"),
        ("its recording", f"{found['recording_MB_per_min']:.1f} MB a minute"),
        ("a Zenoh router (in Python's binding)", f"{found['router_us']:.1f} us of a core a message"),
    ]
    table = "\n".join(f"| {what} | {cost} |" for what, cost in rows)
    return f"| What | Cost |\n| --- | --: |\n{table}\n"


def simulated() -> Costs:
    """A session in simulated time, its recording's size, and its samples through `compare`."""
    settings = SessionSettings()
    for duration in (1.0, SECONDS):  # the first loads what is compiled
        robot, material = make_session_robot(settings)
        operator = make_operator(settings, surface=material.surface, press_depth=material.press_depth, say=print)
        begun = time.process_time()
        log = simulate(settings, duration=duration, operator=operator, robot=robot).log
        spent = time.process_time() - begun
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "session.mcap"
        writer = SessionWriter(path)
        for kind, rows in ((LeaderState, log.leader), (Telemetry, log.follower)):
            for row in rows:
                message = kind(VERSION, *row.item())
                writer.write(message, message.time_ns)
        for model in log.models:
            writer.write(model, model.time_ns)
        for n, row in enumerate(log.leader, 1):
            command = Command(VERSION, n, int(row["time_ns"]), float(row["position"]), 1, False, "leader", 1)
            writer.write(command, int(row["time_ns"]))
        writer.close()
        size = path.stat().st_size
        press = Path(folder) / "press.csv"
        columns = {"time_s": log.follower["time_ns"] * 1e-9, "position_m": log.follower["position"]}
        write_columns(press, columns | {"force_N": log.follower["sensor_force"]})
        job = Combination(comparison.file_case(press), "contact-map", "bank", Scoring((0.3,)))
        begun = time.process_time()
        result = try_combination(job)
        recording = time.process_time() - begun
        if result.status != "ok":
            raise SystemExit(f"the recording could not be compared: {result.reason}")
    seconds = log.leader.size * SAMPLE_PERIOD
    forth = len(encode(Command(VERSION, 10_000, 10**13, 0.0123456, 300, False, "leader", 2**40, (), 10_000, 2**40)))
    telemetry = np.mean([len(encode(Telemetry(VERSION, *row.item()))) for row in log.follower[::97]])
    models = sum(len(encode(model)) for model in log.models) / seconds
    return {
        "session_s": spent,
        "recording_s": recording,
        "recording_MB_per_min": size / 1e6 * 60.0 / seconds,
        "forth_kbit": 8e-3 * forth / SAMPLE_PERIOD,
        "forth_messages": 1.0 / SAMPLE_PERIOD,
        "back_kbit": 8e-3 * (float(telemetry) / SAMPLE_PERIOD + models),
        "back_messages": 1.0 / SAMPLE_PERIOD + len(log.models) / seconds,
    }


ROLES = ("leader", "follower", "recorder", "console")


def live() -> Costs:
    """Share of a core and memory of each process of a session in real time."""
    port = int(free_endpoint().rpartition(":")[2])
    with tempfile.TemporaryDirectory() as folder:
        options = ["--port", str(port), "--recording", f"{folder}/session.mcap"]
        command = [sys.executable, "-m", "foretouch", "teleop", *options]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as session:
            try:
                time.sleep(5.0)
                pids = {role: pid for pid in children(session.pid) if (role := role_of(pid))}
                before = {role: cpu_seconds(pid) for role, pid in pids.items()}
                time.sleep(LIVE - 5.0)
                after = {role: cpu_seconds(pid) for role, pid in pids.items()}
                memory = {role: own_memory(pid) for role, pid in pids.items()}
            finally:
                session.send_signal(signal.SIGINT)
    cores = {f"{role}_cores": (after[role] - before[role]) / (LIVE - 5.0) for role in ROLES}
    return cores | {f"{role}_MB": memory[role] / 1e6 for role in ROLES}


def children(parent: int) -> list[int]:
    """Process ids of a process's children."""
    return [int(pid) for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]


def role_of(pid: int) -> str:
    """The part of the session that a process is."""
    words = Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0")
    role = words[words.index("foretouch") + 1] if "foretouch" in words else ""
    return {"record": "recorder"}.get(role, role)


def cpu_seconds(pid: int) -> float:
    """User's and system's time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def own_memory(pid: int) -> float:
    """What a process holds, its share of what several hold [bytes]."""
    found = re.search(r"^Pss:\s+(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_text(), re.MULTILINE)
    return 1024.0 * float(found[1]) if found else float("nan")


ROUTER = """
import json, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"router"')
config.insert_json5("listen/endpoints", json.dumps([sys.argv[1]]))
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config):
    print("ready", flush=True)
    sys.stdin.read()
"""
"""Passes messages on until its input ends."""

FLOW = """
import json, sys, time, zenoh
endpoint, name, seconds, size = sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4])
def opened():
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)
heard = [0]
def receive(sample):
    heard[0] += 1
with opened() as there, opened() as here:
    kept = there.declare_subscriber(name, receive)
    publisher = here.declare_publisher(name, congestion_control=zenoh.CongestionControl.DROP)
    time.sleep(1.0)
    print("ready", flush=True)
    sys.stdin.readline()
    due, end = time.monotonic(), time.monotonic() + seconds
    while due < end:
        publisher.put(bytes(size))
        due += 1e-3
        time.sleep(max(0.0, due - time.monotonic()))
    time.sleep(0.5)
    print(heard[0])
"""
"""One direction of a session through the router, at 1 kHz."""


def router() -> Costs:
    """Time of a core that a router needs for a message."""
    endpoint = free_endpoint()
    names = [f"foretouch/{number}" for number in range(FLOWS)]
    with piped(ROUTER, endpoint) as middle:
        middle.stdout.readline()
        flows = [piped(FLOW, endpoint, name, "6", "120") for name in names]
        running = [flow.__enter__() for flow in flows]
        for flow in running:
            flow.stdout.readline()
        before = cpu_seconds(middle.pid)
        for flow in running:
            flow.stdin.write("\n")
            flow.stdin.flush()
        passed = sum(int(flow.stdout.readline()) for flow in running)
        spent = cpu_seconds(middle.pid) - before
        for flow in flows:
            flow.__exit__(None, None, None)
    return {"router_us": 1e6 * spent / max(passed, 1)}


@contextmanager
def piped(script: str, *arguments: str) -> Iterator[Any]:
    """A process that runs a script; its input ends with the block."""
    command = [sys.executable, "-c", script, *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.stdin.close()
        process.wait(20)


def main() -> None:
    """Measure, and fill the page."""
    block = costs()
    print(block)
    fill(PAGE, {"costs": block})


if __name__ == "__main__":
    main()
