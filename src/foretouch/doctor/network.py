"""What is to be said of the way to a peer."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING

from foretouch.doctor.finding import Finding, Verdict
from foretouch.errors import ForetouchError, PeerVersionError, install_command

if TYPE_CHECKING:
    from foretouch.doctor.peer import RoundTrips
    from foretouch.link import ZenohLink
    from foretouch.messages import Message

UNSTEADY = 0.05
"""A gap in commands so long [s] makes a follower hold."""

FAR = 2.0
"""Round trip [s]: after a sudden change nothing that is rendered can be right for so long."""

LOSING, LOSING_MUCH = 0.01, 0.2
"""Share of messages lost."""

CONNECT_PATIENCE = 3.0
"""A connection that is not there after so long [s] will not come: the first packet is sent three times in it."""


def check_peer(
    endpoint: str,
    host: str,
    port: int,
    open_link: Callable[[Callable[[Message], None]], ZenohLink],
    seconds: float,
) -> list[Finding]:
    """Look for somebody at an endpoint, and measure the way there.

    Args:
        endpoint: As it was given.
        host: Of it.
        port: Of it.
        open_link: Opens a link to it, given what is to be called with each message that arrives.
        seconds: How long to ask [s].

    Returns:
        Whether a connection can be opened, and where it can, how messages fare.
    """
    from foretouch.doctor.peer import ask, connect_time
    from foretouch.link import is_exposed

    name = f"reach {endpoint}"
    trust = " --insecure" if is_exposed(endpoint) else ""
    there = f"on the other machine: foretouch doctor --listen {endpoint}{trust}"
    try:
        taken = connect_time(host, port, CONNECT_PATIENCE)
    except socket.gaierror as error:
        found = f"the name {host} is not known here ({error.strerror})"
        return [Finding(name, Verdict.BAD, found, f"getent hosts {host}")]
    except ConnectionRefusedError:
        return [Finding(name, Verdict.BAD, "the machine answers, nobody listens at the port", there)]
    except TimeoutError:
        found = f"nothing came back within {CONNECT_PATIENCE:g} s: another address, or a firewall"
        return [Finding(name, Verdict.BAD, found, f"on the other machine: sudo ufw allow {port}/tcp")]
    except OSError as error:
        return [Finding(name, Verdict.BAD, f"no connection: {error.strerror or error}", f"ip route get {host}")]
    reached = Finding(
        name, Verdict.GOOD, f"somebody listens; TCP connects in {_ms(taken)}", figures={"connect_s": taken}
    )
    try:
        heard = ask(open_link, seconds)
    except PeerVersionError as error:
        return [reached, Finding(f"link {endpoint}", Verdict.BAD, str(error), install_command(again=True))]
    except ForetouchError as error:
        return [reached, Finding(f"link {endpoint}", Verdict.BAD, str(error), "foretouch keys show")]
    return [reached, judge_round_trips(f"link {endpoint}", heard, there)]


def judge_round_trips(name: str, heard: RoundTrips, there: str) -> Finding:
    """What messages there and back say of the network.

    Delay by itself is no fault, for a session renders no delayed force; unsteadiness and loss are.

    Args:
        name: Of the finding.
        heard: What came of asking.
        there: What to do where nobody answers.
    """
    if not heard.roles:
        found = "something takes the connection, no side of a session is heard: a router, or another program"
        return Finding(name, Verdict.WARNING, found, there)
    if heard.asked and not heard.times:
        found = f"{heard.asked} questions, no answer"
        return Finding(name, Verdict.BAD, found, there, {"asked": heard.asked, "answered": 0, "loss": 1.0})
    return _judge_session(name, heard, there) if not heard.asked else _judge_asked(name, heard)


def _judge_asked(name: str, heard: RoundTrips) -> Finding:
    p50, p99, most, least = (heard.percentile(share) for share in (0.5, 0.99, 1.0, 0.0))
    unsteady = most - least
    found = (
        f"round trip p50 {_ms(p50)}, p99 {_ms(p99)}, most {_ms(most)}; {100 * heard.loss:.1f} % lost of {heard.asked}"
    )
    figures = {
        "asked": heard.asked,
        "answered": len(heard.times),
        "loss": heard.loss,
        "round_trip_p50_s": p50,
        "round_trip_p99_s": p99,
        "round_trip_max_s": most,
    }
    if heard.loss >= LOSING_MUCH:
        return Finding(name, Verdict.BAD, found, _rehearse(p50, unsteady, heard.loss), figures)
    if heard.loss >= LOSING or unsteady >= UNSTEADY or p50 >= FAR:
        return Finding(name, Verdict.WARNING, found, _rehearse(p50, unsteady, heard.loss), figures)
    return Finding(name, Verdict.GOOD, found, figures=figures)


def _judge_session(name: str, heard: RoundTrips, there: str) -> Finding:
    """A session runs there: it is listened to, for what is sent into it could disturb it."""
    who = ", ".join(sorted(heard.roles))
    figures = {
        "roles": sorted(heard.roles),
        "heard": heard.heard,
        "lost": heard.lost,
        "longest_gap_s": None if math.isnan(heard.longest_gap) else heard.longest_gap,
    }
    if not heard.heard:
        found = f"{who} says hello; no telemetry came, so nothing was measured"
        return Finding(name, Verdict.UNKNOWN, found, there, figures)
    found = f"{who} heard: {100 * heard.loss:.2f} % lost of {heard.heard + heard.lost} messages, "
    found += f"longest gap {_ms(heard.longest_gap)}; the round trip needs a doctor there"
    bad = heard.loss >= LOSING_MUCH
    if heard.loss >= LOSING or heard.longest_gap >= UNSTEADY:
        return Finding(name, Verdict.BAD if bad else Verdict.WARNING, found, there, figures)
    return Finding(name, Verdict.GOOD, found, figures=figures)


def _rehearse(round_trip: float, unsteady: float, loss: float) -> str:
    """Such a network cannot be mended from here; what a session makes of it can be tried."""
    half = 0.5 * round_trip
    return (
        f"foretouch simulate --position-delay {half:.3g} --force-delay {half:.3g} --jitter {0.5 * unsteady:.2g} "
        f"--loss {loss:.2g}"
    )


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.2f} s"
