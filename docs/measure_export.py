"""Measure the package of C and the gate, and write it into the page: sizes, times of ticks, times through the gate.

Usage: `.venv/bin/python docs/measure_export.py`; it takes some four minutes and needs gcc and g++. Times hold for the
machine, and for one that does nothing else meanwhile.
"""

from __future__ import annotations

import re
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from measured_blocks import fill
from measuring import table

from foretouch.export import TARGETS, lowered, write_package
from foretouch.link import CHANNEL_NUMBERS, ZenohLink, free_endpoint
from foretouch.messages import VERSION, Command, Message, Telemetry, decode, encode

ROOT = Path(__file__).resolve().parents[1]
PAGE, EXAMPLES = ROOT / "docs" / "export.md", ROOT / "examples" / "c"
STRUCTS = ("leader", "follower", "safety")
BUILT = "-Os", "-fno-asynchronous-unwind-tables"  # as the CMake project of the package builds what is C
SECONDS = 5  # For which messages go through the gate, each way a thousand a second


def run(*command: object) -> str:
    """What a command prints."""
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout


def sizes() -> str:
    """The code for each processor, the structs, and a tick of both sides and their messages."""
    made = lowered(*TARGETS.values())
    rows = [[name, f"{len(one.content) / 1e3:.0f}"] for name, one in zip(TARGETS, made, strict=True)]
    with tempfile.TemporaryDirectory() as name:
        package, folder = Path(name, "package"), Path(name)
        write_package(package, TARGETS["x86_64"], lambda _: [made[list(TARGETS).index("x86_64")]])
        include, kernels = f"-I{package}/include", package / "lib" / "foretouch_kernels.o"
        lines = "".join(f'printf("%zu ", sizeof(foretouch_{one}));' for one in STRUCTS)
        Path(name, "sizes.c").write_text(
            f'#include <stdio.h>\n#include "foretouch_session.h"\nint main(void) {{ {lines} return 0; }}\n'
        )
        run("gcc", include, folder / "sizes.c", "-o", folder / "sizes")
        structs = [f"{int(size) / 1e3:.0f} kB" for size in run(folder / "sizes").split()]
        objects = []
        for source in sorted((package / "src").glob("*.c")):
            objects.append(folder / f"{source.stem}.o")
            run("gcc", "-std=c11", *BUILT, include, "-c", source, "-o", objects[-1])
        text, data, *_ = run("size", "-t", *objects, kernels).splitlines()[-1].split()
        loop = [f"-I{EXAMPLES}", EXAMPLES / "loop.cpp", *objects, kernels, "-lm"]
        run("g++", "-std=c++17", "-O2", include, *loop, "-o", folder / "loop")
        ticks = re.search(r"takes (.+) us and (.+) us", run(folder / "loop", 20))
    assert ticks is not None
    code = table(("Processor", "Object file of the kernels [kB]"), rows)
    whole = (int(text) + int(data)) / 1e3
    leader, follower, safety = structs
    return (
        f"{code}\nThe whole library, its messages among it, is {whole:.0f} kB of code and tables on x86_64, as CMake "
        f"builds it; the rest of an object file is names and places. A `foretouch_leader` has {leader}, a "
        f"`foretouch_follower` {follower}, a `foretouch_safety` {safety}. "
        f"A tick of both sides with all their messages takes {ticks[1]} us (median; 99 of 100: {ticks[2]} us) "
        "on x86_64, in `examples/c/loop.cpp`, the simulated robot and network included.\n"
    )


def gate() -> str:
    """Times of messages from a program to a link, and back, over a gate."""
    between, at = free_endpoint(), free_endpoint()
    heard: list[tuple[int, Message]] = []
    command = [sys.executable, "-m", "foretouch", "gate", "--connect", between, "--at", at]

    def hear(message: Message) -> None:
        heard.append((time.monotonic_ns(), message))

    with (
        ZenohLink(listen=[between], subscribe=["command"], watch=hear) as far,
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
    ):
        assert process.stderr is not None
        process.stderr.readline()
        host, _, port = at.removeprefix("tcp/").rpartition(":")
        with socket.create_connection((host, int(port))) as program:
            time.sleep(2.0)  # until both are connected
            back = _exchanged(program, far)
        process.terminate()
        process.wait()
    there = [(arrived - one.time_ns) * 1e-6 for arrived, one in heard]
    rows = [
        [way, str(len(times)), f"{np.median(times):.2f}", f"{np.percentile(times, 99):.2f}"]
        for way, times in (("program to session", there), ("session to program", back))
    ]
    return table(("Way", f"Of {1000 * SECONDS} arrived", "Median [ms]", "99 of 100 [ms]"), rows)


def _exchanged(program: socket.socket, far: ZenohLink) -> list[float]:
    """Send both ways, once a millisecond; times of what comes to the program [ms]."""
    program.setblocking(False)
    program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    came, times, head = bytearray(), list[float](), struct.Struct("<IB")
    end = next_ns = time.monotonic_ns()
    end += SECONDS * 1_000_000_000
    sequence = 0
    while (now := time.monotonic_ns()) < end + 200_000_000:
        if next_ns <= now < end:
            sequence, next_ns = sequence + 1, next_ns + 1_000_000
            data = encode(Command(VERSION, sequence, now, 0.0, 0, epoch=1))
            program.sendall(head.pack(1 + len(data), CHANNEL_NUMBERS["command"]) + data)
            far.publish(Telemetry(VERSION, sequence, time.monotonic_ns(), 0, *(0.0,) * 6, False, False, 0, 0, 0))
        try:
            came += program.recv(65_536)
        except BlockingIOError:
            time.sleep(2e-5)
            continue
        now = time.monotonic_ns()
        while len(came) >= head.size and len(came) >= 4 + head.unpack_from(came)[0]:
            size, number = head.unpack_from(came)
            if number == CHANNEL_NUMBERS["telemetry"]:
                times.append((now - decode(bytes(came[head.size : 4 + size]), Telemetry).time_ns) * 1e-6)
            del came[: 4 + size]
    return times


if __name__ == "__main__":
    fill(PAGE, {"sizes": sizes(), "gate": gate()})
