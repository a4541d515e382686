"""Commands that run a session or a part of one."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import (
    Connect,
    Duration,
    Insecure,
    Json,
    Listen,
    Parent,
    ReportDirectory,
    make_folder,
    print_json,
    say,
    with_session_settings,
)
from foretouch.errors import LinkError, SettingError

if TYPE_CHECKING:
    from foretouch.link import ZenohLink
    from foretouch.messages import Message, SessionLog
    from foretouch.robot import Material

__all__ = ["COMMANDS", "console", "follower", "leader", "print_report", "record", "simulate", "teleop"]

LONGEST_REACH = 0.1
"""Largest surface position and press depth [m] that a leader takes from a follower."""

LEADER_SAYS = (
    "operator",
    "grip",
    "device_mass",
    "device_damping",
    "device_friction",
    "device_resolution",
    "largest_stiffness",
    "position_scale",
    "force_scale",
    "clutch",
    "leader_frame",
    "first_touch",
    "baseline",
)
"""Settings that are the leader's: what a follower that was started by hand has for them means nothing."""

RecordingFile = Annotated[Path | None, typer.Option("--recording", help="MCAP file to write.")]


@with_session_settings(operator="browser")
def teleop(
    *,
    settings: Any,
    duration: Duration = None,
    headless: Annotated[bool, typer.Option("--headless", help="No console.")] = False,
    port: Annotated[int, typer.Option(help="Of the console, on 127.0.0.1.")] = 8080,
    recording: RecordingFile = None,
    report: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """The main job: leader, follower, console and recorder on this machine, joined by a real network connection.

    Example: foretouch teleop --headless --duration 20 --operator recorded --report out
    """
    from foretouch.session import StopFlag, run_processes

    _check_duration(duration)
    _check_material(settings.material)
    path = recording or _default_recording(report)
    _check_writable(path)
    if report is not None:
        make_folder(report)
    if not headless:
        from foretouch.console import require_free_port

        require_free_port(port)
    say("Ctrl-C ends the session and prints the report." if duration is None else f"running for {duration:g} s")
    code = run_processes(
        settings,
        recording=path,
        console_port=None if headless else port,
        duration=duration,
        stop=StopFlag().on_signals(),
        say=say,
    )
    if path.exists() and path.stat().st_size:
        from foretouch.recordings import read_session

        print_report(read_session(path), path, report, json_output)
    if code:
        raise typer.Exit(code)


@with_session_settings()
def simulate(
    *,
    settings: Any,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 20.0,
    recording: RecordingFile = None,
    report: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """The same session in simulated time: one process, seeded network, the same result every time.

    Example: foretouch simulate --duration 20 --material hunt-crossley --report out
    """
    from foretouch.recordings import SessionWriter
    from foretouch.robot import make_robot
    from foretouch.session import framed_robot, inverse, make_operator
    from foretouch.session import simulate as run

    _check_duration(duration)
    if settings.operator == "browser":
        raise SettingError(
            "operator", settings.operator, "needs real time: use `foretouch teleop`, or scripted or recorded"
        )
    if report is not None:
        make_folder(report)
    arm = make_robot(settings.material, seed=settings.seed)
    reach = arm.material
    start = functools.partial(
        run,
        settings,
        duration=duration,
        operator=make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=say),
        robot=framed_robot(arm, inverse(settings.frames[1])),
        description=_reach_texts(reach),
    )
    if recording is None:
        session = start()
    else:
        _check_writable(recording)
        with SessionWriter(recording) as writer:
            session = start(record=writer.write)
            writer.close(session.log.counts)
    print_report(session.log, recording, report, json_output, elapsed=session.elapsed)


@with_session_settings()
def follower(
    *,
    settings: Any,
    listen: Listen = None,
    connect: Connect = None,
    insecure: Insecure = False,
    duration: Duration = None,
    parent: Parent = None,
) -> None:
    """The follower's side alone: the robot, what it presses, and the identification.

    Example: foretouch follower --listen tcp/127.0.0.1:7447 --duration 5
    """
    from foretouch.robot import make_robot
    from foretouch.session import FOLLOWER_CHANNELS, StopFlag, framed_robot, inverse, run_follower

    _check_duration(duration)
    arm = make_robot(settings.material, seed=settings.seed)
    said = {name: text for name, text in settings.as_text().items() if name not in LEADER_SAYS}
    with _link(listen, connect, insecure, FOLLOWER_CHANNELS) as link:
        if parent is None:
            say(f"follower: pressing {settings.material}, waiting for a leader")
        run_follower(
            link,
            framed_robot(arm, inverse(settings.frames[1])),
            settings,
            stop=StopFlag().on_signals(),
            say=say,
            description=said | _reach_texts(arm.material),
            duration=duration,
            parent=parent,
        )


@with_session_settings()
def leader(
    *,
    settings: Any,
    listen: Listen = None,
    connect: Connect = None,
    insecure: Insecure = False,
    duration: Duration = None,
    wait_for_recorder: Annotated[
        bool, typer.Option("--wait-for-recorder", help="Begin when a recorder listens, or after 10 s.")
    ] = False,
    parent: Parent = None,
) -> None:
    """The leader's side alone: the operator and the virtual environment. Waits for a follower.

    Example: foretouch leader --connect tcp/127.0.0.1:7447 --duration 5
    """
    from foretouch.session import (
        LEADER_CHANNELS,
        StopFlag,
        make_operator,
        run_leader,
        wait_for_hello,
    )

    _check_duration(duration)
    stop = StopFlag().on_signals()
    with _link(listen, connect, insecure, LEADER_CHANNELS) as link:
        if parent is None:
            say("leader: waiting for a follower")
        hello = wait_for_hello(link, {"follower"}, stop, parent=parent).get("follower", {})
        if stop.reason:
            return
        moved_by = make_operator(
            settings, surface=_reach(hello, "surface"), press_depth=_reach(hello, "press_depth"), say=say
        )
        run_leader(
            link,
            moved_by,
            settings,
            stop=stop,
            say=say,
            description={name: settings.as_text()[name] for name in LEADER_SAYS} | {"operator": moved_by.name},
            duration=duration,
            wait_for_recorder=wait_for_recorder,
            parent=parent,
        )


def record(
    path: Annotated[Path, typer.Argument(help="MCAP file to write.")],
    connect: Connect = None,
    listen: Listen = None,
    insecure: Insecure = False,
    parent: Parent = None,
) -> None:
    """Record a session that runs elsewhere, until it ends or Ctrl-C.

    Example: foretouch record session.mcap --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448
    """
    from foretouch.session import RECORDER_CHANNELS, StopFlag, run_recorder

    _check_writable(path)
    with _link(listen, connect, insecure, RECORDER_CHANNELS) as link:
        run_recorder(link, path, stop=StopFlag().on_signals(), say=say, parent=parent)


def console(
    connect: Connect = None,
    listen: Listen = None,
    insecure: Insecure = False,
    port: Annotated[int, typer.Option(help="On 127.0.0.1.")] = 8080,
    parent: Parent = None,
) -> None:
    """Watch a session in the browser, and take its handle.

    Example: foretouch console --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448
    """
    from foretouch.console import Console
    from foretouch.messages import Stop
    from foretouch.session import StopFlag, orphaned

    stop = StopFlag().on_signals()
    shown = Console(port, lambda message: link.publish(message))

    def watch(message: Message) -> None:
        if isinstance(message, Stop):
            stop.set(message.reason)
        shown.watch(message)

    with _link(listen, connect, insecure, WATCHED_CHANNELS, watch) as link:
        say(f"console: {shown.url}")
        shown.run(lambda: bool(stop.reason or link.version_error) or orphaned(parent))
        shown.close()
        if link.version_error is not None:
            raise link.version_error


COMMANDS = (teleop, simulate, leader, follower, record, console)

WATCHED_CHANNELS = ("telemetry", "leader", "model", "hello", "stop")
"""What the console's link receives."""


def _link(
    listen: list[str] | None,
    connect: list[str] | None,
    insecure: bool,
    channels: Sequence[str],
    watch: Callable[[Message], None] | None = None,
) -> ZenohLink:
    """The link of one process."""
    from foretouch.link import ZenohLink

    if not listen and not connect:
        raise LinkError("no endpoint: give --listen or --connect, for example --connect tcp/127.0.0.1:7447")
    return ZenohLink(listen=listen or (), connect=connect or (), subscribe=channels, insecure=insecure, watch=watch)


def _reach_texts(material: Material) -> dict[str, str]:
    """Where a material is in the session's frame and how deep it is pressed, for an operator to reach it.

    The simulated arm counts as the settings' follower frame says because it is built to, so that its own line of
    positions, in which the material is given, is the session's.
    """
    return {"surface": str(material.surface), "press_depth": str(material.press_depth)}


def _reach(hello: dict[str, str], name: str) -> float:
    """A length that the follower said, for the operator to reach the material."""
    try:
        value = float(hello[name])
    except (KeyError, ValueError):
        value = math.nan
    if not 0.0 < value <= LONGEST_REACH:
        raise LinkError(f"the follower says {name} = {hello.get(name)!r}: it must be at most {LONGEST_REACH:g} m")
    return value


def _check_duration(duration: float | None) -> None:
    if duration is not None and not 0.0 < duration < math.inf:
        raise SettingError("duration", duration, "must be above 0 s")


def _check_material(name: str) -> None:
    from foretouch.robot import make_material

    make_material(name)


def _default_recording(report: Path | None) -> Path:
    if report is not None:
        return report / "session.mcap"
    return Path(time.strftime("foretouch-%Y%m%d-%H%M%S.mcap"))


def _check_writable(path: Path) -> None:
    """Refuse a recording that could not be written, before anything starts."""
    if path.suffix.lower() != ".mcap":
        raise SettingError("recording", str(path), "must end with .mcap")
    make_folder(path.parent)
    if path.exists() and not path.is_file():
        raise SettingError("recording", str(path), "is there and is no file")


def print_report(
    log: SessionLog, path: Path | None, directory: Path | None, json_output: bool, *, elapsed: float | None = None
) -> None:
    """Print a session's report, and write its page where one is asked for."""
    from foretouch.report import render_text, session_report, write_page

    content = session_report(log)
    content["recording"] = None if path is None else str(path)
    if elapsed is not None:
        content["timing"]["elapsed_s"] = elapsed
    if json_output:
        print_json(content)
    else:
        typer.echo(render_text(content))
    if directory is not None:
        write_page(directory, log, content)
        say(f"report: {directory / 'index.html'}")
