"""Permissions by role and endpoint: the access list that every process of a session gives to Zenoh.

Denied unless it is allowed here. A peer is known by the common name of its certificate; a process takes a channel only
if it receives it at all and the peer's role may speak on it, so that a watcher's handle, for example, is taken by a
leader and by no other role. What comes over plain TCP was allowed with the endpoint, which is on this machine unless
``--insecure`` is given.

A `Hello` names its sender, and a `Command` its leader. Between machines a hello goes out under a key of the
speaker's role and a command under one of the common name, which the access list checks, so that no peer can speak in
another's name: control is held by a certificate, and what others read of it is of no use to them.

An endpoint is ``tcp/HOST:PORT`` or ``tls/HOST:PORT``.
"""

from __future__ import annotations

import errno
import ipaddress
import os
import re
import socket
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import datetime

import msgspec

from foretouch.errors import LinkError
from foretouch.link.certificates import WARNING_DAYS, Identity, refused, utc_now
from foretouch.link.key_folder import ROLES, KeyFolder, role_of
from foretouch.messages import CHANNELS, Command, Hello, LeaderPacket, Message

_FORM = re.compile(r"(?P<kind>tcp|tls)/(?:\[(?P<six>[0-9a-fA-F:.]+)\]|(?P<host>[A-Za-z0-9.-]+)):(?P<port>\d{1,5})")


def _parse(endpoint: str) -> tuple[str, str, int]:
    match = _FORM.fullmatch(endpoint)
    port = int(match["port"]) if match else 0
    if match is None or not 0 < port < 65536:
        raise LinkError(
            f"endpoint {endpoint!r}: write it as tcp/HOST:PORT, for example tcp/127.0.0.1:7447, "
            "or as tls/HOST:PORT between machines"
        )
    return match["kind"], match["six"] or match["host"], port


def address_of(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint.

    Raises:
        LinkError: The endpoint is malformed.
    """
    return _parse(endpoint)[1:]


def is_encrypted(endpoint: str) -> bool:
    """Whether what goes there is encrypted and both ends are checked.

    Raises:
        LinkError: The endpoint is malformed.
    """
    return _parse(endpoint)[0] == "tls"


def is_exposed(endpoint: str) -> bool:
    """Whether it is off this machine and neither encrypted nor checked.

    Raises:
        LinkError: The endpoint is malformed.
    """
    kind, host, _ = _parse(endpoint)
    try:
        here = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        here = False  # a name may resolve to anything
    return kind != "tls" and not here


def check_endpoint(endpoint: str, *, insecure: bool = False) -> None:
    """Refuse an endpoint that is malformed, or off this machine and not encrypted without `insecure`.

    Raises:
        LinkError: What is wrong and what to do.
    """
    if is_exposed(endpoint) and not insecure:
        raise LinkError(
            f"endpoint {endpoint!r} is off this machine and nothing there is encrypted or checked: "
            "write tls/HOST:PORT (its keys: foretouch keys init), or add --insecure on a network that you trust"
        )


def bind_error(host: str, port: int, family: int = socket.AF_UNSPEC) -> OSError | None:
    """The reason that a server could not listen on a TCP port of a host now; None where it could."""
    try:
        kind, _, _, _, address = socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)[0]
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except OSError as error:
        return error
    return None


def check_port_free(endpoint: str) -> None:
    """Refuse to listen on an endpoint that is already in use.

    Raises:
        LinkError: The port is in use, or the address is not this machine's.
    """
    _, host, port = _parse(endpoint)
    error = bind_error(host, port)
    if error is not None:
        used = f"port {port} on {host} is in use: choose another one, or end what uses it"
        problem = f"cannot listen on {endpoint}: {error.strerror or error}"
        raise LinkError(used if error.errno == errno.EADDRINUSE else problem)


def free_port(host: str = "127.0.0.1") -> int:
    """A TCP port of this machine that is free at this moment."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def free_endpoint(kind: str = "tcp") -> str:
    """A loopback endpoint whose port is free at this moment.

    Args:
        kind: ``"tcp"`` or ``"tls"``.
    """
    return f"{kind}/127.0.0.1:{free_port()}"


@dataclass(frozen=True, slots=True)
class Credentials:
    """Read once and handed on as read, so that what was checked is what is used.

    Attributes:
        identity: Key and certificate of this process.
        authority: Certificate that all peers' are checked against.
        allowed: Common names that are let in.
        warning: One line where a certificate ends soon, "" otherwise.
    """

    identity: Identity
    authority: Identity = field(repr=False)
    allowed: tuple[str, ...]
    warning: str


def load_credentials(
    role: str, folder: str | os.PathLike[str] | None = None, *, now: datetime | None = None
) -> Credentials:
    """Credentials of this machine for a role.

    Args:
        role: ``"leader"``, ``"follower"`` or ``"watcher"``; of several certificates the one without a name is taken.
        folder: Folder of keys; the default one where none is given.
        now: UTC; this machine's clock where none is given.

    Raises:
        SettingError: A file is missing, can be read by others, has expired, or does not belong to the rest.
        MissingExtraError: cryptography is not installed.
    """
    now = utc_now() if now is None else now
    keys = KeyFolder(folder)
    authority, here, allowed = keys.read()
    fitting = [name for name in here if role_of(name) == role]
    if not fitting:
        raise refused(keys.path, f"has no certificate for the {role}: foretouch keys issue {role}")
    if role not in fitting and len(fitting) > 1:
        several = f"has several certificates for the {role} ({', '.join(fitting)})"
        raise refused(keys.path, f"{several}: keep the one of this machine")
    identity = here[role if role in fitting else fitting[0]]
    if not identity.issued_by(authority):
        rule = f"is from another authority than {keys.path / 'authority.crt'}: copy both from where they were made"
        raise refused(keys.path / f"{identity.common_name}.pem", rule)
    for each, remedy in ((authority, "rotate --authority"), (identity, f"rotate {identity.common_name}")):
        if each.days_left(now) <= 0.0:
            rule = f"expired on {each.expires:%Y-%m-%d}: foretouch keys {remedy}, and copy the new files"
            raise refused(each.common_name, rule)
    left, ends = identity.days_left(now), f"{identity.expires:%Y-%m-%d}"
    soon = f"the certificate of {identity.common_name} ends in {left:.0f} days, on {ends}: foretouch keys rotate"
    return Credentials(identity, authority, allowed, soon if left <= WARNING_DAYS else "")


PREFIX = "foretouch/"  # Beginning of every network key

HELLO, COMMAND, FORTH = "hello", "command", "forth"
NAMED = (HELLO, COMMAND, FORTH)  # Channels whose keys end, between machines, with the sender's name

_SENDERS = {"leader": ("any", "leader"), "follower": ("any", "follower"), "watcher": ("any", "console")}


def may_publish(role: str) -> tuple[str, ...]:
    """Names of the channels that a role may speak on.

    Args:
        role: ``"leader"``, ``"follower"`` or ``"watcher"``.
    """
    own = tuple(name for name, channel in CHANNELS.items() if channel.sender in _SENDERS[role])
    return (*own, "settings") if role == "leader" else own


def key_to_send(name: str, common_name: str = "") -> str:
    """Network key under which a process speaks on a channel, by the common name of its certificate, if it has one."""
    if not common_name or name not in NAMED:
        return PREFIX + name
    return f"{PREFIX}{name}/{role_of(common_name) if name == HELLO else common_name}"


def keys_to_receive(name: str) -> tuple[str, ...]:
    """Network keys under which a channel is received: from this machine, and from others."""
    return (PREFIX + name, f"{PREFIX}{name}/*") if name in NAMED else (PREFIX + name,)


def may_say(key: str, message: Message) -> bool:
    """Whether what came under a key may name the sender that it names: a `Hello` its role, a `Command` its holder."""
    if isinstance(message, Hello):
        return may_claim(key, message.role)
    return not isinstance(message, Command) or _sender(key) in ("", message.holder)


def as_sent(key: str, message: Message) -> Message:
    """A message that came under a key, with the name of its sender where it has room for one."""
    return msgspec.structs.replace(message, sender=_sender(key)) if isinstance(message, LeaderPacket) else message


def may_claim(key: str, role: str) -> bool:
    """Whether a hello that came under a key may be of this role; what is no leader and no follower is a watcher."""
    return _sender(key) in ("", role if role in ROLES else "watcher")


def _sender(key: str) -> str:
    """The sender, as the access list has checked it; "" where nothing was: on this machine, or an insecure one."""
    return key.removeprefix(PREFIX).partition("/")[2]


def access_list(allowed: Iterable[str], receive: Iterable[str]) -> dict[str, object]:
    """Zenoh's ``access_control`` setting for one process.

    Args:
        allowed: Common names of the peers that are let in.
        receive: Names of the channels that the process receives.
    """
    received = set(receive)
    everything = [key for name in CHANNELS for key in keys_to_receive(name)]
    rules = [
        _rule("speak", ["put"], ["egress"], everything),
        _rule("listen", ["declare_subscriber"], ["ingress", "egress"], everything),
        _rule("local", ["put"], ["ingress"], everything),
    ]
    subjects: list[dict[str, object]] = [{"id": "local", "link_protocols": ["tcp"]}]
    policies = [{"rules": ["speak", "listen", "local"], "subjects": ["local"]}]
    for name in allowed:
        subjects.append({"id": name, "cert_common_names": [name], "link_protocols": ["tls"]})
        keys = [key_to_send(channel, name) for channel in may_publish(role_of(name)) if channel in received]
        if keys:
            rules.append(_rule(name, ["put"], ["ingress"], keys))
        policies.append({"rules": ["speak", "listen", *([name] if keys else [])], "subjects": [name]})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> dict[str, object]:
    return {"id": name, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
