"""The link of a command: its options, and the link that they open."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from foretouch.cli.options import Connect, Insecure, KeysFolder, Listen, say, with_parameters
from foretouch.errors import LinkError

if TYPE_CHECKING:
    from foretouch.link import ZenohLink
    from foretouch.messages import Message

ENDED = "the session was ended"
"""Why a process that only listens has ended, where nobody told it to."""


ANY_USER = "every user of this machine may command there"


class Endpoints(NamedTuple):
    """Where a process is on the network, as the options say; without `keys` they are in the usual folder."""

    listen: list[str] | None = None
    connect: list[str] | None = None
    insecure: bool = False
    keys: Path | None = None

    def __str__(self) -> str:
        return ", ".join(self.all)

    @property
    def all(self) -> tuple[str, ...]:
        """Those to listen on, and those to connect to."""
        return (*(self.listen or ()), *(self.connect or ()))


OPTIONS: dict[str, Any] = {"listen": Listen, "connect": Connect, "insecure": Insecure, "keys": KeysFolder}
"""The option of each of the `Endpoints`."""


def with_endpoints(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of a link; it receives them as one argument, ``endpoints``.

    Args:
        command: With annotations that are there when it is defined.
    """

    @functools.wraps(command)
    def run(**arguments: Any) -> None:
        command(endpoints=Endpoints(**{name: arguments.pop(name) for name in OPTIONS}), **arguments)

    options = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=Endpoints._field_defaults[name], annotation=option
        )
        for name, option in OPTIONS.items()
    ]
    own = inspect.signature(command, eval_str=True).parameters.values()
    parameters = [
        parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        for one in own
        for parameter in (options if one.name == "endpoints" else (one,))
    ]
    return with_parameters(run, parameters)


def open_link(
    process: str,
    endpoints: Endpoints,
    channels: Sequence[str],
    watch: Callable[[Message], None] | None = None,
) -> ZenohLink:
    """The link of one process, with its keys where an endpoint asks for them; says what there is to be warned of.

    Args:
        process: leader, follower, or what is a watcher.
        endpoints: At least one.
        channels: That it receives.
        watch: Called with each message that arrives, instead of keeping them.

    Raises:
        LinkError: No endpoint, or one that cannot be used.
        SettingError: Keys that are not there or not good.
    """
    from foretouch.link import ROLES, ZenohLink, is_encrypted, load_credentials

    if not endpoints.all:
        raise LinkError("no endpoint: give --listen or --connect, for example --connect tcp/127.0.0.1:7447")
    role = process if process in ROLES else "watcher"
    credentials = load_credentials(role, endpoints.keys) if any(map(is_encrypted, endpoints.all)) else None
    link = ZenohLink(
        listen=endpoints.listen or (),
        connect=endpoints.connect or (),
        subscribe=channels,
        insecure=endpoints.insecure,
        credentials=credentials,
        watch=watch,
    )
    if credentials is not None and credentials.warning:
        say(f"{process}: {credentials.warning}")
    if link.insecure:
        say(f"{process}: INSECURE: nothing is encrypted and nobody is checked; anybody on this network may command")
    return link


def unchecked(endpoints: Endpoints) -> str:
    """One line for a follower that may be commanded without a certificate, from its own machine; "" for others."""
    from foretouch.link import is_encrypted, is_exposed

    here = [endpoint for endpoint in endpoints.all if not is_encrypted(endpoint) and not is_exposed(endpoint)]
    return f"no certificate is asked for on {', '.join(here)}: {ANY_USER}" if here else ""


def insecurity(link: ZenohLink) -> dict[str, str]:
    """What the `Hello` of an insecure process says, for console, recording and report."""
    return {"insecure": "yes"} if link.insecure else {}
