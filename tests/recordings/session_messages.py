"""A short session with the values that files get wrong, and the writer process that is killed."""

import os
import sys
import time
from itertools import count

import numpy as np

from foretouch.messages import VERSION, Hello, LeaderState, ModelUpdate, Settings, Stop, Telemetry
from foretouch.recordings import SessionWriter

ODD = (float("nan"), float("inf"), -float("inf"), -0.0, 5e-324, 1.7976931348623157e308, 0.1, -1 / 3)


def bits(value):
    """A value such that equal means equal bit by bit."""
    if isinstance(value, float):
        return np.float64(value).tobytes()
    if isinstance(value, (list, tuple)) or (hasattr(value, "typecode") and hasattr(value, "tobytes")):
        return tuple(bits(item) for item in value)
    return value


def telemetry(tick):
    odd = [ODD[(tick + shift) % len(ODD)] for shift in range(6)]
    return Telemetry(
        VERSION, tick, tick * 1_000_000, tick // 2, *odd, tick % 2 == 0, tick % 3 == 0, tick, 2**63 - 1, tick
    )


def leader_state(tick):
    odd = [ODD[(tick + 2 * shift) % len(ODD)] for shift in range(6)]
    return LeaderState(
        VERSION, tick, tick * 1_000_000 + 7, *odd[:5], 2**53 + tick, tick, odd[5], tick % 2 == 1, 0, tick
    )


def model(number):
    state = tuple(ODD[: number % len(ODD)])
    reason = ("", "ü" * number, "no contact yet")[number % 3]
    told = VERSION, number, number * 20_000_000, number, "law", ODD[:4], state
    return ModelUpdate(*told, 0.01, number % 2 == 0, reason, "fprls", bytes(range(number % 7)))


def session(ticks):
    """All messages of a session with the time at which each was recorded [ns]."""
    yield Hello(VERSION, 1, 5, "leader", ("operator", "seed"), ("scripted", "1")), 5
    yield Hello(VERSION, 1, 6, "follower", ("material", "note"), ("foam-measured", "")), 6
    for tick in range(1, ticks + 1):
        now = tick * 1_000_000
        yield leader_state(tick), now
        yield telemetry(tick), now
        if tick % 20 == 0:
            yield model(tick // 20), now
        if tick % 100 == 50:
            yield Settings(VERSION, tick, now, 0.08, 0.3), now
    yield Stop(VERSION, 1, ticks * 1_000_000, "duration reached"), ticks * 1_000_000


def write_session(path, ticks, counts=None):
    with SessionWriter(path) as writer:
        for number, (message, log_time_ns) in enumerate(session(ticks)):
            writer.write(message, log_time_ns)
            if number % 200 == 0:
                writer.flush()
        writer.close(counts)


def write_until_killed(path, flushed):
    """Flush after some ticks, say so, and go on writing without a flush until somebody ends the process."""
    writer = SessionWriter(path)
    for tick in count(1):
        writer.write(leader_state(tick), tick * 1_000_000)
        writer.write(telemetry(tick), tick * 1_000_000)
        if tick == flushed:
            writer.flush()
        if tick == flushed + 37:
            os.write(1, b"flushed\n")
            time.sleep(60)


if __name__ == "__main__":
    write_until_killed(sys.argv[1], int(sys.argv[2]))
