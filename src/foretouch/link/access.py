"""Who may say what: the access list that every process of a session gives to Zenoh.

Denied unless it is allowed here. A peer is known by the common name of its certificate; a process takes a channel only
if it receives it at all and the peer's role may speak on it, so that a watcher's handle, for example, is taken by a
leader and by nobody else. What comes over plain TCP was allowed with the endpoint, which is on this machine unless
somebody typed ``--insecure``.

A `Hello` says itself who speaks. Between machines it goes out under a key of the speaker's role, which the access list
checks, so that no peer can speak in another's name.
"""

from __future__ import annotations

from collections.abc import Iterable

from foretouch.link.key_folder import ROLES, role_of
from foretouch.messages import CHANNELS

__all__ = ["access_list", "key_to_send", "keys_to_receive", "may_claim", "may_publish"]

PREFIX = "foretouch/"
"""What every network key begins with."""

HELLO = "hello"

_SENDER = {"leader": "leader", "follower": "follower", "watcher": "console"}
_MORE = {"leader": ("settings",)}


def may_publish(role: str) -> tuple[str, ...]:
    """Names of the channels that a role may speak on.

    Args:
        role: ``"leader"``, ``"follower"`` or ``"watcher"``.
    """
    own = tuple(name for name, channel in CHANNELS.items() if channel.sender in ("any", _SENDER[role]))
    return own + tuple(name for name in _MORE.get(role, ()) if name not in own)


def key_to_send(name: str, role: str = "") -> str:
    """Network key under which a process speaks on a channel.

    Args:
        name: Of the channel.
        role: Of the process, "" where it has no certificate.
    """
    return f"{PREFIX}{name}/{role}" if role and name == HELLO else PREFIX + name


def keys_to_receive(name: str) -> tuple[str, ...]:
    """Network keys under which a channel is received: from this machine, and from others.

    Args:
        name: Of the channel.
    """
    return (PREFIX + name, f"{PREFIX}{name}/*") if name == HELLO else (PREFIX + name,)


def may_claim(key: str, role: str) -> bool:
    """Whether what came under a key may say that it is from this role.

    Args:
        key: Network key; without a role in it, it is from this machine or an insecure one.
        role: What the message says: leader, follower, or what is a watcher.
    """
    _, _, shown = key.removeprefix(PREFIX).partition("/")
    return not shown or shown == (role if role in ROLES else "watcher")


def access_list(allowed: Iterable[str], receive: Iterable[str]) -> dict[str, object]:
    """Zenoh's ``access_control`` setting for one process.

    Args:
        allowed: Common names of the peers that are let in.
        receive: Names of the channels that the process receives.
    """
    received = set(receive)
    everything = list(dict.fromkeys(key_to_send(name, role) for role in ("", *ROLES) for name in CHANNELS))
    subscriptions = [key for name in CHANNELS for key in keys_to_receive(name)]
    rules: list[dict[str, object]] = [
        _rule("speak", ["put"], ["egress"], everything),
        _rule("listen", ["declare_subscriber"], ["ingress", "egress"], subscriptions),
        _rule("local", ["put"], ["ingress"], everything),
    ]
    subjects: list[dict[str, object]] = [{"id": "local", "link_protocols": ["tcp"]}]
    policies: list[dict[str, object]] = [{"rules": ["speak", "listen", "local"], "subjects": ["local"]}]
    names = list(allowed)
    for role in ROLES:
        those = [name for name in names if role_of(name) == role]
        if not those:
            continue
        subjects.append({"id": role, "cert_common_names": those, "link_protocols": ["tls"]})
        granted = ["speak", "listen"]
        if heard := [key_to_send(name, role) for name in may_publish(role) if name in received]:
            rules.append(_rule(role, ["put"], ["ingress"], heard))
            granted.append(role)
        policies.append({"rules": granted, "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> dict[str, object]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
