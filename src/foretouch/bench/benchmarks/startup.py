"""Fresh processes: how long until there is help, a package, a first compiled call."""

from __future__ import annotations

from foretouch.bench.children import measure_process
from foretouch.bench.rows import Row, Scope
from foretouch.bench.timing import Contestant, interleave, spread

ROUNDS = 7

FIRST_CALL = (
    "from foretouch.identification import ContactMapBank, ContactSample\n"
    "ContactMapBank().update(ContactSample(0.0, 1e-3, 0.0, 1.0, True))"
)

PROCESSES: dict[str, tuple[list[str], float | None]] = {
    "foretouch --help": (["-m", "foretouch", "--help"], 0.3),
    "import foretouch": (["-c", "import foretouch"], 0.2),
    "first compiled call, from a warm cache": (["-c", FIRST_CALL], 1.5),
    "bare Python": (["-c", "pass"], None),
}
"""What is started, and how long it is to take at most [s]."""


def measure(scope: Scope) -> list[Row]:
    """Seconds from a process's start to its end."""

    def start(arguments: list[str]) -> Contestant:
        return Contestant(lambda: measure_process(arguments))

    times = interleave({what: start(arguments) for what, (arguments, _) in PROCESSES.items()}, ROUNDS)
    return [
        Row.of(f"{what}, a fresh process", spread(times[what]), "s", reach) for what, (_, reach) in PROCESSES.items()
    ]
