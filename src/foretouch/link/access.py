"""Who may say what: the access list that every process of a session gives to Zenoh.

Denied unless it is allowed here. A peer is known by the common name of its certificate; a process takes a channel only
if it receives it at all and the peer's role may speak on it, so that a watcher's handle, for example, is taken by a
leader and by nobody else. What comes over plain TCP was allowed with the endpoint, which is on this machine unless
somebody typed ``--insecure``.

A `Hello` says itself who speaks, and a `Command` who leads. Between machines a hello goes out under a key of the
speaker's role and a command under one of the common name, which the access list checks, so that no peer can speak in
another's name: control is held by a certificate, and what others read of it is of no use to them.
"""

from __future__ import annotations

from collections.abc import Iterable

from foretouch.link.key_folder import ROLES, role_of
from foretouch.messages import CHANNELS, Command, Hello, Message

__all__ = ["access_list", "key_to_send", "keys_to_receive", "may_claim", "may_publish", "may_say"]

PREFIX = "foretouch/"
"""What every network key begins with."""

HELLO, COMMAND = "hello", "command"
NAMED = (HELLO, COMMAND)
"""Channels whose keys end, between machines, with who speaks."""

_SENDER = {"leader": "leader", "follower": "follower", "watcher": "console"}
_MORE = {"leader": ("settings",)}


def may_publish(role: str) -> tuple[str, ...]:
    """Names of the channels that a role may speak on.

    Args:
        role: ``"leader"``, ``"follower"`` or ``"watcher"``.
    """
    own = tuple(name for name, channel in CHANNELS.items() if channel.sender in ("any", _SENDER[role]))
    return own + tuple(name for name in _MORE.get(role, ()) if name not in own)


def key_to_send(name: str, common_name: str = "") -> str:
    """Network key under which a process speaks on a channel.

    Args:
        name: Of the channel.
        common_name: Of the process's certificate, "" where it has none.
    """
    if not common_name or name not in NAMED:
        return PREFIX + name
    return f"{PREFIX}{name}/{role_of(common_name) if name == HELLO else common_name}"


def keys_to_receive(name: str) -> tuple[str, ...]:
    """Network keys under which a channel is received: from this machine, and from others.

    Args:
        name: Of the channel.
    """
    return (PREFIX + name, f"{PREFIX}{name}/*") if name in NAMED else (PREFIX + name,)


def may_say(key: str, message: Message) -> bool:
    """Whether what came under a key may say of itself who it is from.

    Args:
        key: Network key; without a name at its end, it is from this machine or an insecure one.
        message: A `Hello` with its role, or a `Command` with its holder; others say nothing.
    """
    if isinstance(message, Hello):
        return may_claim(key, message.role)
    return not isinstance(message, Command) or _shown(key) in ("", message.holder)


def may_claim(key: str, role: str) -> bool:
    """Whether a hello that came under a key may be of this role.

    Args:
        key: As for `may_say`.
        role: Leader, follower, or what is a watcher.
    """
    return _shown(key) in ("", role if role in ROLES else "watcher")


def _shown(key: str) -> str:
    """Who speaks, as the access list has checked it; "" where nobody did."""
    return key.removeprefix(PREFIX).partition("/")[2]


def access_list(allowed: Iterable[str], receive: Iterable[str]) -> dict[str, object]:
    """Zenoh's ``access_control`` setting for one process.

    Args:
        allowed: Common names of the peers that are let in.
        receive: Names of the channels that the process receives.
    """
    received = set(receive)
    everything = [key for name in CHANNELS for key in keys_to_receive(name)]
    rules: list[dict[str, object]] = [
        _rule("speak", ["put"], ["egress"], everything),
        _rule("listen", ["declare_subscriber"], ["ingress", "egress"], everything),
        _rule("local", ["put"], ["ingress"], everything),
    ]
    subjects: list[dict[str, object]] = [{"id": "local", "link_protocols": ["tcp"]}]
    policies: list[dict[str, object]] = [{"rules": ["speak", "listen", "local"], "subjects": ["local"]}]
    for name in allowed:
        subjects.append({"id": name, "cert_common_names": [name], "link_protocols": ["tls"]})
        granted = ["speak", "listen"]
        if heard := [key_to_send(channel, name) for channel in may_publish(role_of(name)) if channel in received]:
            rules.append(_rule(name, ["put"], ["ingress"], heard))
            granted.append(name)
        policies.append({"rules": granted, "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> dict[str, object]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
