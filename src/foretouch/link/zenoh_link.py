"""Messages over Eclipse Zenoh: explicit endpoints, no scouting, no waiting in the loop.

Between machines both ends show a certificate of the private authority, and an access list permits sending by role.

`ask_to_stop` is here because it needs no more than a link: an emergency stop does not wait until laws and robots
are imported.
"""

from __future__ import annotations

import base64
import contextlib
import json
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from foretouch.errors import DecodeError, LinkError, MissingExtraError, PeerVersionError
from foretouch.link.access import (
    Credentials,
    access_list,
    as_sent,
    check_endpoint,
    check_port_free,
    is_encrypted,
    is_exposed,
    key_to_send,
    keys_to_receive,
    may_claim,
    may_say,
)
from foretouch.messages import (
    CHANNELS,
    LARGEST_MESSAGE,
    SIDES,
    VERSION,
    EmergencyStop,
    Hello,
    Message,
    Status,
    decode,
    encode,
    foreign_speaker,
)

if TYPE_CHECKING:
    import zenoh


KEPT, SHORTEST_QUEUE = 20.0, 64
"""An inbox holds what comes at its channel's rate for this time [s], and at least this many messages; beyond it the
oldest are dropped, so that a reader that stopped costs no more memory than that."""

PATIENCE = 1.5
"""Time [s] without a hello in this version after which a peer of another version counts as one: each peer says hello
twice a second."""

_NOTHING: deque[tuple[int, Message]] = deque(maxlen=0)

MOST_PEERS = 64  # Peers that may be connected at a time


class ZenohLink:
    """One process's place on the network.

    Arriving messages are decoded on Zenoh's threads and wait in an inbox, a `deque` per channel, whose append and
    popleft are atomic: the loop takes no lock. What does not decode is counted and dropped.

    Args:
        listen: Endpoints to listen on.
        connect: Endpoints to connect to; a peer that is not there yet is waited for in the background.
        subscribe: Names of the channels to receive.
        insecure: Allow endpoints off this machine that are not encrypted.
        credentials: For ``tls`` endpoints: what this process shows, and whom it lets in.
        watch: Called with each arriving message on Zenoh's thread, instead of filling the inboxes.

    Attributes:
        inboxes: By channel: ``(arrival [ns, this machine's monotonic clock], message)``, oldest first.
        undecodable: Messages that arrived and were dropped.
        foreign: Number of these that are of another version.
        dropped: Messages that arrived at a full inbox and pushed out its oldest.
        unsent: Messages that the network refused to take, or that are too large for it.
        too_large: One line on the first that was too large; "" while none was.
        insecure: Whether an endpoint is off this machine and neither encrypted nor checked.
        name: Common name of the certificate that this process shows; "" without one.
        aside: Called with each message that is published, too, on the thread that publishes it.

    Raises:
        LinkError: An endpoint is malformed, not allowed or in use.
        MissingExtraError: eclipse-zenoh is not installed.
    """

    def __init__(
        self,
        *,
        listen: Sequence[str] = (),
        connect: Sequence[str] = (),
        subscribe: Iterable[str] = (),
        insecure: bool = False,
        credentials: Credentials | None = None,
        watch: Callable[[Message], None] | None = None,
    ) -> None:
        zenoh = zenoh_module()
        subscribe = list(subscribe)
        for endpoint in (*listen, *connect):
            check_endpoint(endpoint, insecure=insecure)
            if is_encrypted(endpoint) and credentials is None:
                raise LinkError(f"endpoint {endpoint!r} needs keys: foretouch keys init makes an authority for them")
        for endpoint in listen:
            check_port_free(endpoint)
        self.inboxes: dict[str, deque[tuple[int, Message]]] = {}
        self.undecodable = self.foreign = self.dropped = self.unsent = 0
        self.too_large = ""
        self.aside: Callable[[Message], None] | None = None
        self._send_error = zenoh.ZError
        self._greeted: set[str] = set()  # both of roles that there are, and so bounded
        self._foreigners: dict[str, tuple[int, PeerVersionError]] = {}
        self.name = "" if credentials is None else credentials.identity.common_name
        self.insecure = any(map(is_exposed, (*listen, *connect)))
        self._watch = watch
        secured = {} if credentials is None else _secured(credentials, subscribe)
        try:
            self._session: Any = zenoh.open(_config(listen, connect, secured))
        except zenoh.ZError as error:
            raise LinkError(f"cannot open the link on {', '.join((*listen, *connect))}: {error}") from None
        self._publishers = {
            channel.kind: self._session.declare_publisher(
                key_to_send(channel.name, self.name), congestion_control=zenoh.CongestionControl.DROP
            )
            for channel in CHANNELS.values()
        }
        self._subscribers = [subscriber for name in subscribe for subscriber in self._subscribe(name)]

    def _subscribe(self, name: str) -> list[Any]:
        kind = CHANNELS[name].kind
        inbox = self.inboxes[name] = deque(maxlen=max(SHORTEST_QUEUE, round(KEPT * CHANNELS[name].rate)))

        def receive(sample: zenoh.Sample) -> None:
            arrival = time.monotonic_ns()
            payload = sample.payload
            if len(payload) > LARGEST_MESSAGE:  # refused before it is copied
                self.undecodable += 1
                return
            data, key = payload.to_bytes(), str(sample.key_expr)
            try:
                message = decode(data, kind)
                if not may_say(key, message):
                    raise DecodeError("it says that it is from another")
            except PeerVersionError as error:
                self.undecodable += 1
                self.foreign += 1
                if kind is Hello and (role := foreign_speaker(data)) and may_claim(key, role):
                    self._foreigners.setdefault(role, (arrival, error))
            except DecodeError:
                self.undecodable += 1
            else:
                if isinstance(message, Hello):
                    self._greeted.add(message.role)
                message = as_sent(key, message)
                if self._watch is None:
                    self.dropped += len(inbox) == inbox.maxlen
                    inbox.append((arrival, message))
                else:
                    self._watch(message)

        return [self._session.declare_subscriber(key, receive) for key in keys_to_receive(name)]

    @contextlib.contextmanager
    def hearing(self, name: str) -> Iterator[None]:
        """Receive one more channel for a while; from other machines only what was asked for at the beginning comes."""
        subscribers = self._subscribe(name)
        try:
            yield
        finally:
            for subscriber in subscribers:
                subscriber.undeclare()

    def other_version(self, roles: Iterable[str] = SIDES) -> PeerVersionError | None:
        """The error where this process's peers send hellos, but in another version; else None.

        It takes a hello in one of these roles, under a permitted key, and only if none has come in this version within
        `PATIENCE`. Whatever else is of another version is counted, no more.

        Args:
            roles: Roles of its peers; the sides of a session where none are named. The link receives
                ``hello``.
        """
        wanted, latest = set(roles), time.monotonic_ns() - round(PATIENCE * 1e9)
        errors = (error for role, (first, error) in self._foreigners.items() if role in wanted and first <= latest)
        return None if wanted & self._greeted else next(errors, None)

    def publish(self, message: Message) -> None:
        """Send a message on its channel; never waits and never raises: what cannot be sent is dropped."""
        if self.aside is not None:
            self.aside(message)
        data = encode(message)
        if len(data) > LARGEST_MESSAGE:
            self.unsent += 1
            kind, most = type(message).__name__, f"at most {LARGEST_MESSAGE} go over the network"
            self.too_large = self.too_large or f"a {kind} of {len(data)} bytes was not sent: {most}"
            return
        try:
            self._publishers[type(message)].put(data)
        except self._send_error:
            self.unsent += 1

    def repeat(self, hello: Hello) -> None:
        """Tell processes of this machine what another says of itself; other machines refuse it from a third."""
        with contextlib.suppress(self._send_error):
            self._session.put(key_to_send("hello"), encode(hello))

    def deliver(self, message: Message) -> None:
        """Put a message that came in another way into its channel's inbox, which is made where it is not received."""
        name = next(name for name, channel in CHANNELS.items() if channel.kind is type(message))
        if isinstance(message, Hello):
            self._greeted.add(message.role)
        self.inboxes.setdefault(name, deque(maxlen=SHORTEST_QUEUE)).append((time.monotonic_ns(), message))

    def take(self, name: str) -> list[tuple[int, Any]]:
        """Messages that have arrived on a channel since the last call, oldest first; none where it is not received."""
        inbox = self.inboxes.get(name, _NOTHING)
        return [inbox.popleft() for _ in range(len(inbox))]

    def close(self) -> None:
        """Leave the network."""
        self._session.close()

    def __enter__(self) -> ZenohLink:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def zenoh_module() -> Any:
    """The package, which is imported when it is needed."""
    try:
        import zenoh
    except ImportError:
        raise MissingExtraError("eclipse-zenoh", "link") from None
    return zenoh


def zenoh_config(settings: dict[str, object]) -> zenoh.Config:
    """Zenoh's settings: those given, without scouting and without shared memory."""
    config: zenoh.Config = zenoh_module().Config()
    never = ("scouting/multicast/enabled", "scouting/gossip/enabled", "transport/shared_memory/enabled")
    for key, value in (dict.fromkeys(never, False) | settings).items():
        config.insert_json5(key, json.dumps(value))
    return config


def _config(listen: Sequence[str], connect: Sequence[str], secured: dict[str, object]) -> zenoh.Config:
    settings: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        # A peer that is not there yet is retried for ever, quickly, and is no error.
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2},
        # Without these two, jitter of the machine alone loses messages on loopback.
        "transport/unicast/lowlatency": True,
        "transport/unicast/qos/enabled": False,
        # Long enough for a process that pauses for some seconds: of the connections that are closed and made anew
        # while it does, some stay dumb. To learn of silence sooner, poll.
        "transport/link/tx/lease": 5000,
        "transport/link/protocols": ["tcp", "tls"],
        # Limits of what a peer may make this process hold.
        "transport/link/rx/max_message_size": 2 * LARGEST_MESSAGE,
        "transport/unicast/max_sessions": MOST_PEERS,
    }
    return zenoh_config(settings | secured)


def _secured(credentials: Credentials, receive: Iterable[str]) -> dict[str, object]:
    """Settings for ``tls`` endpoints: both ends show a certificate, and the access list says what each may send.

    Certificates name roles, not hosts: a listener is known by its certificate's common name, which
    the access list is about, so that names need not be known when certificates are made.
    """
    own, files = credentials.identity, {"root_ca_certificate": credentials.authority.certificate}
    for end in ("listen", "connect"):
        files |= {f"{end}_private_key": own.key, f"{end}_certificate": own.certificate}
    contents = {f"{name}_base64": base64.b64encode(content).decode() for name, content in files.items()}
    return {
        "transport/link/tls": {"enable_mtls": True, "verify_name_on_connect": False, **contents},
        "access_control": access_list(credentials.allowed, receive),
    }


STOPPING_CHANNELS = ("telemetry", "hello")
"""Channels that the link of a process that asks for a stop receives."""

ASKING_PERIOD_NS = 50_000_000
"""An emergency stop is asked for this often [ns], until the follower says that it has stopped."""


def new_press() -> int:
    """A number for one press of an emergency stop."""
    return 1 + secrets.randbits(62)


def ask_to_stop(link: ZenohLink, reason: str, *, patience: float = 5.0) -> int | None:
    """Ask every follower on the link for an emergency stop, again and again until one says that it has stopped.

    Args:
        link: Link with `STOPPING_CHANNELS`.
        reason: One sentence, for the people at the robot.
        patience: Longest time for which it is asked [s].

    Returns:
        `Status.STOPPED`; or where no message reported it, the last status received, None for none.

    Raises:
        PeerVersionError: No message reported it, and the follower speaks another version: it does not understand.
    """
    status: int | None = None
    asked, end, press = 0, time.monotonic() + patience, new_press()
    while status != Status.STOPPED and time.monotonic() < end:
        asked += 1
        link.publish(EmergencyStop(VERSION, asked, time.monotonic_ns(), reason, press))
        time.sleep(ASKING_PERIOD_NS * 1e-9)
        for _, telemetry in link.take("telemetry"):
            status = telemetry.status
    if status is None and (error := link.other_version({"follower"})) is not None:
        raise error
    return status
