"""Commands that run one side of a session, let one in, or stop its robot: each a process of its own."""

from __future__ import annotations

import contextlib
import getpass
import math
import os
import signal
import socket
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import (
    ENDED,
    Answer,
    Duration,
    Endpoints,
    Parent,
    changed_settings,
    command,
    insecurity,
    open_link,
    require_duration,
    require_machines,
    say,
    session_settings,
    unchecked,
)
from foretouch.cli.remembering import Remember, keep, settings_with
from foretouch.errors import LinkError, RecordingError, SettingError, UnknownNameError, one_line
from foretouch.settings import FAULTS, LEADER_SETTINGS, NETWORK

if TYPE_CHECKING:
    from foretouch.devices import Device, SpatialDevice
    from foretouch.session import SessionSettings, StopFlag

LONGEST_NAME = 64  # Characters of a leader's name that a command carries
WAITS = "waiting for a leader"  # State of a follower before it hears a leader, for people
PATIENCE = 5.0  # Longest time for which an emergency stop is asked for [s]
LOOK = 0.05  # Time between two looks whether the followers of this machine have stopped [s]
BY_SWITCH = "stop it by its own switch"  # Advice where a stop did not arrive
LONGEST_REACH = 0.1  # Largest surface position and press depth [m] that a leader takes from a follower


@command(endpoints=Endpoints, settings=session_settings())
def follower(
    *,
    endpoints: Endpoints,
    duration: Duration = None,
    shadow: Annotated[
        bool, typer.Option("--shadow", help="Estimate and predict, command nothing: somebody else moves the robot.")
    ] = False,
    remember: Remember = None,
    parent: Parent = None,
    settings: SessionSettings,
) -> Answer:
    """The follower's side alone: the robot, what it presses, and the identification.

    With --shadow no leader is needed; the robot of the simulation is then moved by the operator's motion.

    Example: foretouch follower --listen tcp/127.0.0.1:7447 --duration 5
    """
    from foretouch.session import StopFlag, be_prompt, prepare

    require_duration(duration)
    settings = settings_with(settings, remember)
    require_machines(settings, quiet=parent is not None)  # who started it has said it
    be_prompt()
    stop = StopFlag().on_signals()
    # Before the robot is opened: a driver's watchdog does not wait for the compiler.
    ended = prepare(settings, stop, say, parent)
    return Answer({"ended": ended} if ended else _follow(settings, endpoints, shadow, stop, duration, parent, remember))


@command(endpoints=Endpoints, settings=session_settings())
def leader(
    *,
    endpoints: Endpoints,
    duration: Duration = None,
    wait_for_recorder: Annotated[
        bool, typer.Option("--wait-for-recorder", help="Begin when a recorder listens, or after 10 s.")
    ] = False,
    name: Annotated[
        str | None,
        typer.Option(help="Who holds control, as others are told; else USER@HOST, with keys the certificate's."),
    ] = None,
    relay: Annotated[
        bool,
        typer.Option(
            "--relay",
            help="Over a thin link: tell consoles and recorders on this machine, which connect to the leader alone, "
            "what it hears of the robot's side.",
        ),
    ] = False,
    parent: Parent = None,
    settings: SessionSettings,
) -> Answer:
    """The leader's side alone: the operator and the virtual environment. Waits for a follower.

    Example: foretouch leader --connect tcp/127.0.0.1:7447 --duration 5
    """
    from foretouch.session import (
        Process,
        StopFlag,
        be_prompt,
        close_operator,
        end_of,
        felt_texts,
        hear_packets,
        join_thin,
        prepare,
        run_leader,
        setup_of,
        side_channels,
        wait_for_hello,
    )

    if relay and not settings.budget:
        raise SettingError("relay", relay, "is of a thin link: give a budget, too")
    require_duration(duration)
    setup_of(settings)  # a scene that cannot be read is refused before a follower is waited for
    be_prompt()
    stop = StopFlag().on_signals()
    prepare(settings, stop, say, parent)  # while the follower does the same
    with open_link("leader", endpoints, side_channels("leader", settings)) as link:
        end = end_of("leader", settings)
        if end is not None and relay:
            end.tell = link.publish
        join_thin(link, end)
        if parent is None:
            say("leader: waiting for a follower" + (" that has a --budget, too" if end is not None else ""))
        meanwhile = bool if end is None else partial(hear_packets, link, end)
        hello = wait_for_hello(link, {"follower"}, stop, parent=parent, meanwhile=meanwhile).get("follower", {})
        if stop.reason:
            return Answer({"ended": stop.reason})
        moved_by = _operator(settings, hello)
        try:
            description = {name: text for name, text in settings.as_text().items() if name in LEADER_SETTINGS}
            description |= {"operator": moved_by.name} | insecurity(link)
            description |= felt_texts(moved_by, settings)
            ran = run_leader(
                Process(link, stop, say, parent, end),
                moved_by,
                settings,
                description=description,
                duration=duration,
                wait_for_recorder=wait_for_recorder,
                name=_leader_name(name, link.name),
            )
        finally:  # a device that is felt gives no force after its session, however that ended
            close_operator(moved_by)
    return Answer(ran)


@command(endpoints=Endpoints, faults=changed_settings(NETWORK, *FAULTS, "seed"))
def gate(
    *,
    endpoints: Endpoints,
    at: Annotated[
        str, typer.Option(help="Where the program connects, one at a time: an address of this machine, tcp/HOST:PORT.")
    ] = "tcp/127.0.0.1:7460",
    side: Annotated[str, typer.Option(help="Whose place the program takes: leader or follower.")] = "leader",
    delay: Annotated[float, typer.Option(help="One-way delay of what comes to the program [s], 0 to 10.")] = 0.0,
    faults: dict[str, Any],
) -> Answer:
    """Let a program in another language be the leader or the follower of a session, over plain TCP.

    The program is built with `foretouch export c` and needs no Zenoh and no keys: those are the gate's. Whoever can
    connect there may command the robot, so that it is an address of this machine alone, unless --insecure is given.

    Example: foretouch gate --connect tcp/127.0.0.1:7447 --at tcp/127.0.0.1:7460
    """
    from foretouch.link import Faults, FrameServer
    from foretouch.messages import SIDES
    from foretouch.session import Gate, StopFlag, be_prompt, gate_channels

    if side not in SIDES:
        raise UnknownNameError("side", side, SIDES)
    other = next(one for one in SIDES if one != side)
    server = FrameServer(at, lambda line: say(f"gate: {line}"), insecure=endpoints.insecure)
    stop = StopFlag().on_signals()
    with contextlib.closing(server):
        passes_on = Gate(side, server, Faults(delay=delay, **faults))
        be_prompt()
        with open_link(side, endpoints, gate_channels(side), passes_on.hear) as link:
            say(f"gate: a {side} may connect at {at}")
            passes_on.run(link, lambda: bool(stop.reason or link.other_version({other})))
            if (error := link.other_version({other})) is not None:
                raise error
    say(f"gate: ended: {passes_on.ended or stop.reason or ENDED}")
    return Answer({"ended": passes_on.ended or stop.reason or ENDED} | passes_on.counts())


@command(endpoints=Endpoints)
def stop(*, endpoints: Endpoints) -> Answer:
    """Stop the robot: an emergency stop, asked for again and again until the follower says that it has stopped.

    Without --listen or --connect it stops your followers on this machine. The robot goes back until it feels next to
    nothing, and stays there until it is released at the follower. Exit code 1 if no follower has confirmed within 5 s.

    Example: foretouch stop --connect tcp/127.0.0.1:7447
    """
    from foretouch.link import STOPPING_CHANNELS, ask_to_stop
    from foretouch.messages import STATUS_SENTENCES, Status

    if not endpoints.all:
        return _stop_those_here()
    with open_link("stop", endpoints, STOPPING_CHANNELS) as link:
        received = ask_to_stop(link, f"asked for by {_own_name()}", patience=PATIENCE)
    content = {"stopped": received == Status.STOPPED, "status": None if received is None else int(received)}
    if received == Status.STOPPED:
        return Answer(content, "the robot has stopped: it unloads, and stays so until it is released at the follower")
    sentence = next((sentence for status, sentence in STATUS_SENTENCES.items() if status == received), "")
    doing = f"the robot {sentence}" if sentence else f"no follower is heard at {endpoints}"
    say(f"foretouch: NOT stopped (after {PATIENCE:g} s): {doing}; {BY_SWITCH}")
    return Answer(content, code=1)


def _stop_those_here() -> Answer:
    """Stop the robots of all of this user's followers on this machine, by signal."""
    from foretouch.link import followers

    asked, end = followers(), time.monotonic() + PATIENCE
    for process in asked:
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGUSR1)
    texts = asked
    while asked and not all(map(_has_stopped, texts.values())) and time.monotonic() < end:
        time.sleep(LOOK)
        now = followers()
        texts = {process: now.get(process, "it has ended") for process in asked}
    lines, failed = [], not asked
    for process, sentence in texts.items():
        if _has_stopped(sentence):
            lines.append(f"follower {process} has stopped: {one_line(sentence)}")
        else:
            failed = True
            doing = one_line(sentence) or "no stop was confirmed"
            say(f"foretouch: follower {process} NOT stopped (after {PATIENCE:g} s): {doing}; {BY_SWITCH}")
    if not asked:
        what = "no follower of yours runs on this machine; give --connect for one elsewhere"
        say(f"foretouch: NOT stopped: {what}, or {BY_SWITCH}")
    return Answer({"stopped": not failed, "followers": sorted(asked)}, lines, code=int(failed))


def _has_stopped(sentence: str) -> bool:
    """Whether a follower that says this has stopped its robot; a shadow cannot, and waits for no release."""
    return "emergency stop" in sentence and "foretouch release" in sentence


def _follow(
    settings: SessionSettings,
    endpoints: Endpoints,
    shadow: bool,
    stop: StopFlag,
    duration: float | None,
    parent: int | None,
    remember: str | None,
) -> Mapping[str, Any]:
    """The follower's side of a session, or a shadow of it; why it ended, and what it counted."""
    from foretouch.identification import Estimator
    from foretouch.session import (
        SHADOW_CHANNELS,
        Process,
        make_moved_robot,
        make_session_robot,
        reach_texts,
        run_follower,
        run_shadow,
        side_channels,
    )

    texts = {name: text for name, text in settings.as_text().items() if name not in LEADER_SETTINGS}
    run: Callable[..., Mapping[str, Any]] = run_follower
    channels = side_channels("follower", settings)
    waits = WAITS
    pressed = f"pressing {settings.material}" if settings.robot == "simulated" else f"robot {settings.robot}"
    pressed += settings.workspace.where.format(settings.scene)
    robot, reach = make_moved_robot(settings, say=say) if shadow else make_session_robot(settings)
    if shadow:
        run, channels, texts = run_shadow, SHADOW_CHANNELS, {}  # it reports its settings by itself
        simulated = robot.specification.simulated
        mover = f"the {settings.operator} operator moves it" if simulated else "somebody else moves it"
        waits = f"{mover} and nothing is commanded"
    with contextlib.closing(robot), open_link("follower", endpoints, channels) as link:
        if parent is None:
            say(f"follower: {pressed}, {waits}")
            if not shadow and (warning := unchecked(endpoints)):
                say(f"follower: {warning}")
        description = texts | reach_texts(reach) | insecurity(link)
        process, learnt = Process(link, stop, say, parent), list[Estimator]()
        ran = run(process, robot, settings, description=description, duration=duration, keep=learnt.append)
    for estimator in learnt:
        try:
            keep(estimator, remember)
        except RecordingError as error:  # what the session has counted is told all the same
            say(f"foretouch: {error}")
    return ran


def _operator(settings: SessionSettings, hello: dict[str, str]) -> Device | SpatialDevice:
    """Who moves the leader, over what the follower says that it reaches."""
    from foretouch.devices import UNKNOWN_REACH
    from foretouch.session import setup_of

    ours, theirs = settings.scene, hello.get("scene", "")
    if ours != theirs:
        raise LinkError(settings.workspace.sides.format(ours=ours, theirs=theirs or "a session along a line"))
    if ours:
        _require_radius(settings.probe_radius, hello.get("probe_radius", "0"))
        if settings.specimen != (there := hello.get("specimen", "")):
            rule = "give both sides the same, for the script's hand sees it"
            raise LinkError(f"the follower says specimen = {there!r} and not {settings.specimen!r}: {rule}")
    told = {name: _reach(hello, name) for name in settings.workspace.lengths}
    return setup_of(settings).operator(UNKNOWN_REACH._replace(**told), say)  # type: ignore[no-any-return]


def _require_radius(ours: float, theirs: str) -> None:
    """Refuse a follower whose probe is of another size; one that says none has a point."""
    try:
        same = float(theirs) == ours
    except ValueError:
        same = False
    if not same:
        raise LinkError(f"the follower says probe_radius = {theirs!r} and not {ours:g}: give both sides the same")


def _own_name() -> str:
    """Who starts a process, and where, as this machine says."""
    try:
        return f"{getpass.getuser()}@{socket.gethostname()}"[:LONGEST_NAME]
    except (OSError, KeyError):  # a container's user without a name
        return socket.gethostname()[:LONGEST_NAME] or "somebody"


def _leader_name(name: str | None, certified: str) -> str:
    """The name of a leader: its certificate's, as it was given, or as this machine says."""
    if certified and name not in (None, certified):
        raise SettingError("name", name, f"cannot be given with keys: others are told the certificate's, {certified}")
    name = certified or (_own_name() if name is None else name)
    if not 0 < len(name) <= LONGEST_NAME or not name.isprintable():
        raise SettingError("name", name, f"must have 1 to {LONGEST_NAME} printable characters")
    return name


def _reach(hello: dict[str, str], name: str) -> float:
    """A length that the follower reported, by which the operator reaches the material; NaN where it reported none."""
    try:
        value = float(hello.get(name, "nan"))
    except ValueError:
        value = math.nan
    if name in hello and not 0.0 < value <= LONGEST_REACH:
        raise LinkError(f"the follower says {name} = {hello.get(name)!r}: it must be at most {LONGEST_REACH:g} m")
    return value
