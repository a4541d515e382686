"""The way to a peer: whether a process listens there, its role, the round trip of messages, and how to judge them.

Only `Hello` messages are sent, in the role ``doctor``, which no side of a session answers, and only where a peer has
that role and no other is received: a running session is only listened to.
"""

from __future__ import annotations

import itertools
import math
import secrets
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from foretouch.doctor.finding import Finding, Verdict, percentile
from foretouch.errors import ForetouchError, PeerVersionError, install_command
from foretouch.link import Faults, FaultStage, ZenohLink
from foretouch.messages import SIDES, Hello, Message, Telemetry
from foretouch.messages.schema import LONGEST_VALUE

DOCTOR_CHANNELS = ("hello", "telemetry")  # Channels that a doctor's link receives

ROLE = "doctor"

PEERS = (*SIDES, ROLE)  # Roles of a peer: the sides of a session, or another doctor
MOST_ANSWERS = 700_000  # Largest number of messages noted; more were not asked for

ASKS, ANSWERS, PRESENT = "asks", "answers", "present"
"""Names of the texts of its `Hello`: a question with its number, the same in an answer, and that it is there."""

FILL, FILLED = "fill", "filled"
"""Texts that make a question as large as a message of a session, and that say how much of that its answer has."""

RATE = 100.0  # Questions a second [1/s]
PRESENCE_PERIOD = 0.25  # Period at which a doctor announces itself [s]
SETTLING = 0.7  # Time to wait for others after the first hello [s]: the sides of a session send it twice a second
LAST_PATIENCE = 2.0  # Longest wait for answers to the last questions [s]


@dataclass(frozen=True, slots=True)
class RoundTrips:
    """The messages received from a peer.

    Attributes:
        roles: Roles that sent a hello.
        asked: Questions sent; 0 where no doctor answered there.
        times: Round trips of those that were answered [s], in the order of the questions.
        received: Number of telemetry messages from a session that runs there.
        lost: Number of telemetry messages that did not come, though later ones did.
        longest_gap: Longest time between two of them [s]; NaN where fewer than two came.
    """

    roles: frozenset[str] = frozenset()
    asked: int = 0
    times: tuple[float, ...] = ()
    received: int = 0
    lost: int = 0
    longest_gap: float = math.nan

    @property
    def loss(self) -> float:
        """Fraction of questions without an answer, or of telemetry that did not come; NaN where there was neither."""
        if self.asked:
            return 1.0 - len(self.times) / self.asked
        return self.lost / (self.lost + self.received) if self.received else math.nan

    def percentile(self, fraction: float) -> float:
        """Round trip [s] that this fraction of the answered questions does not exceed; NaN where none was answered."""
        return percentile(self.times, fraction)


def connect_time(host: str, port: int, timeout: float) -> float:
    """Time to open a TCP connection within a timeout [s]: one round trip of the network itself.

    An OSError says that the name is not known, no process listens there, or nothing came back.
    """
    family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    with socket.socket(family, kind, protocol) as probe:
        probe.settimeout(timeout)
        begun = time.perf_counter()
        probe.connect(address)
        return time.perf_counter() - begun


EMPTY: Mapping[str, str] = MappingProxyType({})


def filling(size: int) -> dict[str, str]:
    """A text of so many characters at most, which makes a message larger; none for 0."""
    return {FILL: "." * min(size, LONGEST_VALUE)} if size > 0 else {}


class Answerer:
    """Answers the questions of doctors, at once or, with faults on the way back, as a bad network would.

    `open_link` opens the link, given the function to be called with each message that arrives.
    """

    def __init__(
        self, open_link: Callable[[Callable[[Message], None]], ZenohLink], faults: Faults | None = None
    ) -> None:
        self._arrived: deque[tuple[int, tuple[str, str]]] = deque(maxlen=10_000)
        self._wakes = threading.Event()
        self._stage: FaultStage[tuple[str, str]] = FaultStage(Faults() if faults is None else faults)
        self._sent = 0
        self.answered = 0
        self._link = open_link(self._take)

    def _take(self, message: Message) -> None:
        question = _text(message, ASKS)
        if question:
            self._arrived.append((time.monotonic_ns(), (question, _text(message, FILLED))))
            self._wakes.set()

    def run(self, ended: Callable[[], bool]) -> None:
        """Answer until it is ended, which is looked at every 0.1 s at least."""
        published, taken = -math.inf, 0
        while not ended():
            now = time.monotonic()
            if now - published >= PRESENCE_PERIOD:
                self._say(PRESENT, "yes")
                published = now
            while self._arrived:
                self._stage.push(*self._arrived.popleft())
                taken += 1
            for question, filled in self._stage.pop_due(time.monotonic_ns()):
                self._say(ANSWERS, question, filling(int(filled)) if filled.isdecimal() else {})
                self.answered += 1
            held = self.answered + self._stage.dropped < taken + self._stage.duplicated
            self._wakes.wait(2e-4 if held else 0.1)
            self._wakes.clear()

    def _say(self, name: str, value: str, fill: Mapping[str, str] = EMPTY) -> None:
        self._sent += 1
        self._link.publish(Hello.of(ROLE, self._sent, time.monotonic_ns(), {name: value, **fill}))

    def close(self) -> None:
        """Leave the network."""
        self._link.close()


class Received:
    """What arrives, noted on the link's thread: each by one operation that cannot be interrupted."""

    def __init__(self) -> None:
        self.own = secrets.token_hex(8)
        self.roles: set[str] = set()
        self.present = False
        self.answers: dict[str, int] = {}
        self.telemetry: deque[tuple[int, int, int]] = deque(maxlen=100_000)

    def take(self, message: Message) -> None:
        """Note one message."""
        now = time.monotonic_ns()
        if isinstance(message, Telemetry):
            self.telemetry.append((message.run, message.sequence, now))
        elif isinstance(message, Hello):
            self.roles.add(message.role)
            self.present = self.present or bool(_text(message, PRESENT))
            asker, _, number = _text(message, ANSWERS).partition("/")
            if asker == self.own and number not in self.answers and len(self.answers) < MOST_ANSWERS:
                self.answers[number] = now

    def meet(self, link: ZenohLink, patience: float) -> bool:
        """Wait for a hello, for at most so long [s], and for those of others; whether one came.

        A PeerVersionError says that the peer speaks another version.
        """
        wait(lambda: bool(self.roles) or link.other_version(PEERS) is not None, patience)
        if (error := link.other_version(PEERS)) is not None:
            raise error
        if self.roles:
            wait(lambda: False, SETTLING)
        return bool(self.roles)

    def ask(self, link: ZenohLink, number: int, texts: Mapping[str, str] = EMPTY) -> int:
        """Send the question of this number, with further texts; when that was [ns]."""
        now = time.monotonic_ns()
        link.publish(Hello.of(ROLE, number, now, {ASKS: f"{self.own}/{number}", **texts}))
        return now


def ask(
    open_link: Callable[[Callable[[Message], None]], ZenohLink], seconds: float, *, patience: float = 3.0
) -> RoundTrips:
    """Ask a doctor's peer for a time [s], or listen where a session runs, after at most `patience` [s] for a hello.

    `open_link` opens the link, given what is to be called with each message. A PeerVersionError says that the peer
    speaks another version.
    """
    received = Received()
    with open_link(received.take) as link:
        if not received.meet(link, patience):
            return RoundTrips()
        if not received.present or received.roles - {ROLE}:
            return listen_in(received.telemetry, frozenset(received.roles), seconds)
        sent: dict[str, int] = {}  # when each question was sent [ns], by its number
        begun = time.monotonic()
        for number in range(1, max(1, round(seconds * RATE)) + 1):
            time.sleep(max(0.0, begun + number / RATE - time.monotonic()))
            sent[str(number)] = received.ask(link, number)
        wait(lambda: len(received.answers) >= len(sent), LAST_PATIENCE)
    answers = dict(received.answers)
    times = tuple(1e-9 * (answers[name] - asked) for name, asked in sent.items() if name in answers)
    return RoundTrips(frozenset(received.roles), len(sent), times)


def listen_in(telemetry: deque[tuple[int, int, int]], roles: frozenset[str], seconds: float) -> RoundTrips:
    """Count for a time [s] the telemetry of a session's follower: nothing is sent to it.

    Each has process, sequence number and arrival [ns], and they grow meanwhile; the roles are those that sent a hello.
    """
    telemetry.clear()
    time.sleep(seconds)
    rows = list(telemetry)
    run = rows[-1][0] if rows else 0
    numbers = sorted({sequence for which, sequence, _ in rows if which == run})
    arrivals = [arrival for which, _, arrival in rows if which == run]
    gaps = [1e-9 * (after - before) for before, after in itertools.pairwise(arrivals)]
    lost = numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0
    return RoundTrips(roles, received=len(numbers), lost=lost, longest_gap=max(gaps, default=math.nan))


def wait(done: Callable[[], bool], patience: float) -> None:
    """Wait until this is so, for at most so long [s]."""
    end = time.monotonic() + patience
    while not done() and time.monotonic() < end:
        time.sleep(0.005)


def _text(message: Message, name: str) -> str:
    """A text of a doctor's `Hello`, "" where it has none of this name."""
    if not isinstance(message, Hello) or message.role != ROLE:
        return ""
    return message.texts.get(name, "")


UNSTEADY = 0.05  # Gap in commands that makes a follower hold [s]

FAR = 2.0
"""Round trip from which a peer counts as far [s]: after a sudden change the rendered force is wrong for this time."""

LOSING, LOSING_MUCH = 0.01, 0.2
"""Fractions of messages lost from which a network is poor, and bad."""

CONNECT_PATIENCE = 3.0
"""Time after which a missing connection will not come [s]: the first packet is sent three times in it."""


def check_peer(
    endpoint: str, host: str, port: int, open_link: Callable[[Callable[[Message], None]], ZenohLink], seconds: float
) -> list[Finding]:
    """Whether a connection can be opened to host and port of an endpoint, and where it can, how messages fare.

    `open_link` opens a link, given the function to be called with each message; the peer is asked for a time [s].
    """
    from foretouch.link import is_exposed

    name = f"reach {endpoint}"
    trust = " --insecure" if is_exposed(endpoint) else ""
    there = f"on the other machine: foretouch doctor --listen {endpoint}{trust}"
    try:
        taken = connect_time(host, port, CONNECT_PATIENCE)
    except socket.gaierror as error:
        text = f"the name {host} is not known here ({error.strerror})"
        return [Finding(name, Verdict.BAD, text, f"getent hosts {host}")]
    except ConnectionRefusedError:
        return [Finding(name, Verdict.BAD, "the machine answers, no program listens at the port", there)]
    except TimeoutError:
        text = f"nothing came back within {CONNECT_PATIENCE:g} s: another address, or a firewall"
        return [Finding(name, Verdict.BAD, text, f"on the other machine: sudo ufw allow {port}/tcp")]
    except OSError as error:
        return [Finding(name, Verdict.BAD, f"no connection: {error.strerror or error}", f"ip route get {host}")]
    text, name_of_link = f"a program listens; TCP connects in {_ms(taken)}", f"link {endpoint}"
    reached = Finding(name, Verdict.GOOD, text, figures={"connect_s": taken})
    try:
        return [reached, judge_round_trips(name_of_link, ask(open_link, seconds), there)]
    except ForetouchError as error:
        mend = install_command(again=True) if isinstance(error, PeerVersionError) else "foretouch keys show"
        return [reached, Finding(name_of_link, Verdict.BAD, str(error), mend)]


def judge_round_trips(name: str, trips: RoundTrips, there: str) -> Finding:
    """Judge the network by its round trips; `there` says what to do where no peer answers.

    Delay by itself is no fault, for a session renders no delayed force; unsteadiness and loss are.
    """
    if not trips.roles:
        text = "something takes the connection, no side of a session answers: a router, or another program"
        return Finding(name, Verdict.WARNING, text, there)
    if trips.asked and not trips.times:
        text = f"{trips.asked} questions, no answer"
        return Finding(name, Verdict.BAD, text, there, {"asked": trips.asked, "answered": 0, "loss": 1.0})
    return _judge_session(name, trips, there) if not trips.asked else _judge_asked(name, trips)


def _judge_asked(name: str, trips: RoundTrips) -> Finding:
    p50, p99, most, least = (trips.percentile(fraction) for fraction in (0.5, 0.99, 1.0, 0.0))
    unsteady = most - least
    lost = f"{100 * trips.loss:.1f} % lost of {trips.asked}"
    text = f"round trip p50 {_ms(p50)}, p99 {_ms(p99)}, most {_ms(most)}; {lost}"
    figures = {"asked": trips.asked, "answered": len(trips.times), "loss": trips.loss}
    figures |= {"round_trip_p50_s": p50, "round_trip_p99_s": p99, "round_trip_max_s": most}
    if trips.loss < LOSING and unsteady < UNSTEADY and p50 < FAR:
        return Finding(name, Verdict.GOOD, text, figures=figures)
    # Such a network cannot be mended from here; what a session makes of it can be tried.
    mend = (
        f"foretouch simulate --position-delay {0.5 * p50:.3g} --force-delay {0.5 * p50:.3g} "
        f"--jitter {0.5 * unsteady:.2g} --loss {trips.loss:.2g}"
    )
    return Finding(name, Verdict.BAD if trips.loss >= LOSING_MUCH else Verdict.WARNING, text, mend, figures)


def _judge_session(name: str, trips: RoundTrips, there: str) -> Finding:
    """A session runs there: it is listened to, for what is sent into it could disturb it."""
    who = ", ".join(sorted(trips.roles))
    figures = {
        "roles": sorted(trips.roles),
        "received": trips.received,
        "lost": trips.lost,
        "longest_gap_s": None if math.isnan(trips.longest_gap) else trips.longest_gap,
    }
    if not trips.received:
        text = f"{who} says hello; no telemetry came, so nothing was measured"
        return Finding(name, Verdict.UNKNOWN, text, there, figures)
    text = f"telemetry of {who}: {100 * trips.loss:.2f} % lost of {trips.received + trips.lost} messages, "
    text += f"longest gap {_ms(trips.longest_gap)}; the round trip needs a doctor there"
    bad = trips.loss >= LOSING_MUCH
    if trips.loss >= LOSING or trips.longest_gap >= UNSTEADY:
        return Finding(name, Verdict.BAD if bad else Verdict.WARNING, text, there, figures)
    return Finding(name, Verdict.GOOD, text, figures=figures)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.2f} s"
