"""Feeds a recorder as fast as it takes messages and prints its resident memory at ten points.

    python tests/session/recorder_memory.py FILE HOURS

Each line: hours of session, messages, resident memory [kB], bytes of the file; the last after the file was ended.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from foretouch.messages import COUNT_PREFIX, VERSION, Hello, LeaderState, Message, ModelUpdate, Telemetry
from foretouch.session import Recorder

TICKS_PER_HOUR = 3_600_000
POINTS = 10
ROUND = 20
"""Ticks between two looks at the inboxes."""
FLUSH = 400
"""Ticks between two flushes."""
DISTINCT = 2000
"""Ticks whose messages differ."""


def leader(n: int) -> LeaderState:
    return LeaderState(VERSION, n, n * 10**6, 0.01, 0.0, 1.5 / (n % 97 + 1), 1.0 / n, 0.5, n, n, 0.0, False, 1000, 9)


def follower(n: int) -> Telemetry:
    return Telemetry(
        VERSION, n, n * 10**6, n, 0.01, 0.01 + 1e-6 * (n % 83), 0.0, 1.0 / n, 0.9, 0.95, True, False, n, 1000, 9
    )


def model(n: int) -> ModelUpdate:
    numbers = tuple(float(n + place) for place in range(8))
    return ModelUpdate(VERSION, n, n, n, "contact-map", numbers, (), 0.01, True, "", "bank", bytes(900))


def hello(role: str, n: int) -> Hello:
    return Hello(VERSION, n, n, role, ("material", f"{COUNT_PREFIX}{role}_unsent"), ("foam", str(n)))


def resident() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def show(hours: float, messages: int, path: Path) -> None:
    sys.stdout.write(f"{hours:.4f} {messages} {resident()} {path.stat().st_size}\n")
    sys.stdout.flush()


def main(path: Path, hours: float) -> None:
    rounds = [range(begin, begin + ROUND) for begin in range(1, DISTINCT + 1, ROUND)]
    made: list[dict[str, list[Message]]] = [
        {
            "leader": [leader(n) for n in ticks],
            "telemetry": [follower(n) for n in ticks],
            "model": [model(ticks[0])],
            "hello": [hello("leader", ticks[0]), hello("follower", ticks[0])] if number % 25 == 0 else [],
        }
        for number, ticks in enumerate(rounds)
    ]
    recorder = Recorder(path)
    ticks, messages = round(hours * TICKS_PER_HOUR), 0
    due = [round(ticks * (point + 1) / POINTS) for point in range(POINTS)]
    for tick in range(0, ticks, ROUND):
        for name, output in made[tick // ROUND % len(made)].items():
            recorder.take(name, [(tick * 10**6, message) for message in output])
            messages += len(output)
        if tick % FLUSH == 0:
            recorder.flush()
        if tick + ROUND >= due[0]:
            due.pop(0)
            show((tick + ROUND) / TICKS_PER_HOUR, messages, path)
    recorder.close({})
    assert not recorder.problem, recorder.problem
    show(hours, messages, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]))
