"""A Zenoh router in this process, as rmw_zenohd is one, and what comes through it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from foretouch.link import free_endpoint


class Router:
    """Listens, and notes every sample and every liveliness token.

    Attributes:
        endpoint: Where it listens.
        samples: ``(key, payload, attachment)``.
        tokens: That are there now.
        gone: That were there.
    """

    def __init__(self, endpoint: str) -> None:
        import zenoh

        config = zenoh.Config()
        settings = {"mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False}
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
        self.endpoint = endpoint
        self.samples: list[tuple[str, bytes, bytes]] = []
        self.tokens: set[str] = set()
        self.gone: set[str] = set()
        self._deleted = zenoh.SampleKind.DELETE
        self._lock = threading.Lock()
        self._session: Any = zenoh.open(config)
        # Both as rmw_zenoh_cpp receives: an advanced subscriber for topics, history for tokens.
        self._kept = (
            zenoh.ext.declare_advanced_subscriber(self._session, "*/**", self._sample),
            self._session.liveliness().declare_subscriber("@ros2_lv/**", self._token, history=True),
        )

    def _sample(self, sample: Any) -> None:
        with self._lock:
            attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
            self.samples.append((str(sample.key_expr), sample.payload.to_bytes(), attached))

    def _token(self, sample: Any) -> None:
        with self._lock:
            key = str(sample.key_expr)
            (self.gone if sample.kind == self._deleted else self.tokens).add(key)
            if sample.kind == self._deleted:
                self.tokens.discard(key)

    def of(self, topic: str) -> list[tuple[bytes, bytes]]:
        """Payloads and attachments of a topic, by its full name."""
        with self._lock:
            return [
                (data, attached)
                for key, data, attached in self.samples
                if key.split("/", 1)[1].rsplit("/", 2)[0] == topic.removeprefix("/")
            ]

    def close(self) -> None:
        self._session.close()


@contextmanager
def router(endpoint: str = "") -> Iterator[Router]:
    """A router for a test."""
    opened = Router(endpoint or free_endpoint())
    try:
        yield opened
    finally:
        opened.close()


def wait_until(condition: Callable[[], Any], seconds: float = 20.0) -> None:
    """Wait until something is so, or fail."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "has not come"
        time.sleep(0.01)
