"""Peers that keep to no rule of ours: bare Zenoh sessions with any certificate, or none."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

from foretouch.link import ROLES, Identity
from foretouch.messages import CHANNELS, VERSION, Message, encode

MARK = 666_666
"""Sequence number of everything that an intruder says."""


@contextmanager
def intruder(
    *,
    connect: str | None = None,
    listen: str | None = None,
    identity: Identity | None = None,
    trusts: Identity | None = None,
) -> Iterator[Any]:
    import zenoh

    files = {} if trusts is None else {"root_ca_certificate": trusts.certificate}
    for end in ("connect", "listen") if identity is not None else ():
        files |= {f"{end}_certificate": identity.certificate, f"{end}_private_key": identity.key}
    tls: dict[str, object] = {f"{name}_base64": base64.b64encode(content).decode() for name, content in files.items()}
    tls |= {"verify_name_on_connect": False} | ({} if identity is None else {"enable_mtls": connect is not None})
    settings = {
        "mode": "peer",
        "connect/endpoints": [connect] if connect else [],
        "listen/endpoints": [listen] if listen else [],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 100, "period_increase_factor": 2},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        "transport/link/tls": tls,
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        yield session


def listen(session: Any, key: str, received: list[str]) -> Any:
    import zenoh

    return session.declare_subscriber(
        key, lambda sample: received.append(str(sample.key_expr)), allowed_origin=zenoh.Locality.REMOTE
    )


def sample(name: str) -> Message:
    kind = CHANNELS[name].kind
    defaults: dict[type, object] = {
        msgspec.inspect.IntType: 1,
        msgspec.inspect.FloatType: 0.5,
        msgspec.inspect.BoolType: True,
        msgspec.inspect.StrType: "x",
        msgspec.inspect.BytesType: b"",
        msgspec.inspect.VarTupleType: (),
    }
    info = msgspec.inspect.type_info(kind)
    assert isinstance(info, msgspec.inspect.StructType)
    fields = {field.name: defaults[type(field.type)] for field in info.fields if field.name not in ("record", "space")}
    content = fields | {"version": VERSION, "sequence": MARK}
    return kind(**content | ({"role": "recorder"} if name == "hello" else {}))  # type: ignore[arg-type]


def hello_of(role: str) -> Message:
    return msgspec.structs.replace(sample("hello"), role="recorder" if role == "watcher" else role)


def say_everything(session: Any) -> None:
    """A message on every channel, and keys that are not ours."""
    for name in CHANNELS:
        session.put(f"foretouch/{name}", encode(sample(name)))
    for role in ROLES:
        session.put(f"foretouch/hello/{role}", encode(hello_of(role)))
        session.put(f"foretouch/forth/{role}", encode(sample("forth")))
        session.put(f"foretouch/command/{role}", encode(msgspec.structs.replace(sample("command"), holder=role)))
    session.put("foretouch/command/more", b"x")
    session.put("elsewhere", b"x")


def until(condition: Callable[[], object], seconds: float = 15.0, what: str = "it did not happen") -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"not within {seconds:g} s: {what}"
        time.sleep(0.01)
