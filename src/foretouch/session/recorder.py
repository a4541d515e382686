"""The recorder: a process of its own that listens to both sides and writes what it hears."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from foretouch.link import ZenohLink
from foretouch.messages import VERSION, Hello, split_texts
from foretouch.recordings import SessionWriter
from foretouch.session.housekeeping import ORPHANED, StopFlag, orphaned

__all__ = ["RECORDER_CHANNELS", "run_recorder"]

RECORDER_CHANNELS = ("telemetry", "leader", "model", "hello", "settings", "stop")
"""What the recorder's link receives and the recording holds."""

FLUSH_PERIOD = 0.5
"""Between two flushes [s]: what a killed recorder loses."""

POLL_PERIOD = 0.02
"""Between two looks at the inboxes [s]."""

GRACE = 1.0
"""Listening goes on for this long after a `Stop` [s], for the last messages of the other side."""


def run_recorder(
    link: ZenohLink, path: Path, *, stop: StopFlag, say: Callable[[str], None], parent: int | None = None
) -> None:
    """Record until a `Stop` has arrived or `stop` is set, then close the file.

    Once both sides have been heard it says `Hello` itself, so that a leader may wait for it.

    Args:
        link: With `RECORDER_CHANNELS`.
        path: The MCAP file.
        stop: Looked at in every round.
        say: Prints one line for people.
        parent: Process whose end ends this one.

    Raises:
        PeerVersionError: All that was heard speaks another version; no file is left.
    """
    counts: dict[str, int] = {}
    heard: set[str] = set()
    announced = False
    flushed = time.monotonic()
    end: float | None = None
    with SessionWriter(path) as writer:
        while not (stop.reason or (end is not None and time.monotonic() > end)):
            for name in RECORDER_CHANNELS:
                for arrival, message in link.take(name):
                    writer.write(message, arrival)
                    if isinstance(message, Hello):
                        heard.add(message.role)
                        counts |= split_texts(dict(zip(message.names, message.values, strict=False)))[1]
                    elif name == "stop" and end is None:
                        end = time.monotonic() + GRACE
            if not announced and {"leader", "follower"} <= heard:
                link.publish(Hello(VERSION, 1, time.monotonic_ns(), "recorder", (), ()))
                announced = True
            if link.version_error is not None and not heard:
                break
            if time.monotonic() - flushed >= FLUSH_PERIOD:
                writer.flush()
                flushed = time.monotonic()
                if orphaned(parent):
                    stop.set(ORPHANED)
            time.sleep(POLL_PERIOD)
        counts["recorder_undecodable"] = link.undecodable
        writer.close(counts)
    if link.version_error is not None and not heard:
        path.unlink()
        raise link.version_error
    if link.undecodable:
        say(f"recorder: {link.undecodable} messages did not decode and were dropped")
    say(f"recorder: wrote {path}")
