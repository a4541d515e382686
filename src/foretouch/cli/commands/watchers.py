"""Commands that watch a session, each a process of its own: recorder, camera, console, ROS 2 bridge."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import (
    ENDED,
    Answer,
    Endpoints,
    Parent,
    command,
    insecurity,
    open_link,
    require_recording,
    say,
    session_settings,
)
from foretouch.errors import LinkError, plural

if TYPE_CHECKING:
    from foretouch.messages import Message
    from foretouch.session import SessionSettings


bridge = typer.Typer(help="Pass a running session on to other systems.", no_args_is_help=True)


@bridge.callback()
def _bridge() -> None:
    pass


@bridge.command("ros2")
@command(endpoints=Endpoints)
def ros2(
    *,
    endpoints: Endpoints,
    router: Annotated[
        str, typer.Option(help="Of the ROS 2 graph; rmw_zenoh_cpp's own listens here.")
    ] = "tcp/127.0.0.1:7447",
    domain: Annotated[int, typer.Option(envvar="ROS_DOMAIN_ID", help="Of the ROS 2 graph, 0 to 232.")] = 0,
    namespace: Annotated[str, typer.Option(help="Before the names of the topics, such as /robot1.")] = "/",
    rate: Annotated[float, typer.Option(help="Messages a second of each topic at most.")] = 100.0,
    parent: Parent = None,
) -> Answer:
    """Publish a session's wrench, joint states, pose and contact model for ROS 2, which need not be installed here.

    Example: foretouch bridge ros2 --connect tcp/127.0.0.1:7451 --connect tcp/127.0.0.1:7452
    """
    from foretouch.ros2 import BRIDGE_CHANNELS, Bridge, Graph, Node
    from foretouch.session import StopFlag, give_way, orphaned

    if router in endpoints.all:
        raise LinkError(f"{router} cannot be the session's and the ROS 2 router's: give the session another port")
    graph = Graph(router, Node(domain, namespace), insecure=endpoints.insecure)
    passes_on = Bridge(graph, rate=rate, router=router, say=say)
    give_way()
    stop = StopFlag().on_signals()
    try:
        with open_link("bridge", endpoints, BRIDGE_CHANNELS) as link:
            passes_on.run(link, lambda: bool(stop.reason or link.other_version()) or orphaned(parent))
            if (error := link.other_version()) is not None:
                raise error
    finally:
        graph.close()
    for name, count in sorted(graph.sent.items()):
        say(f"bridge: {name} {plural(count, 'message')}")
    return Answer({"ended": stop.reason or ENDED, "sent": graph.sent, "unsent": graph.unsent})


WATCHED_CHANNELS = (
    "telemetry", "leader", "model", "hello", "stop", "field", "fixture", "image"
)  # fmt: skip
"""What the console's link receives."""


@command(endpoints=Endpoints)
def record(
    *, path: Annotated[Path, typer.Argument(help="MCAP file to write.")], endpoints: Endpoints, parent: Parent = None
) -> Answer:
    """Record a session that runs elsewhere, until it ends or Ctrl-C.

    Where the disk is full or the file is removed meanwhile it says so at once, stays, and ends with exit code 3.

    Example: foretouch record session.mcap --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448
    """
    from foretouch.session import RECORDER_CHANNELS, RECORDING_INCOMPLETE, StopFlag, give_way, run_recorder

    require_recording(path)
    give_way()
    stop = StopFlag().on_signals()
    with open_link("recorder", endpoints, RECORDER_CHANNELS) as link:
        problem = run_recorder(link, path, stop=stop, say=say, parent=parent)
    content = {"ended": stop.reason or ENDED, "recording": str(path), "problem": problem or None}
    return Answer(content, code=RECORDING_INCOMPLETE if problem else 0)


@command(endpoints=Endpoints, settings=session_settings())
def camera(*, endpoints: Endpoints, parent: Parent = None, settings: SessionSettings) -> Answer:
    """The camera at the follower of a scene: simulated images, and where they and the touches show the fixture.

    It stands beside the follower, on the same machine, in a process of its own.

    Example: foretouch camera --scene hill --listen tcp/127.0.0.1:7449 --connect tcp/127.0.0.1:7447
    """
    from foretouch.session import StopFlag, give_way, setup_of
    from foretouch.session.network.lease import ContestPrinter
    from foretouch.session.runners.camera import CAMERA_CHANNELS, run_camera
    from foretouch.session.spatial import make_camera

    scene = setup_of(settings).seen()
    give_way()
    sees = settings.fusion in ("full", "image") or parent is not None
    missing: list[str] = []
    drawn = make_camera(settings, scene, say=missing.append) if sees else None
    for line in missing:
        say(line)
    contest = ContestPrinter("camera", say, parent)

    def describe() -> dict[str, str]:  # called twice a second, as hellos come
        for _, hello in link.take("hello"):
            contest.take(hello)
        return texts | insecurity(link)

    with open_link("camera", endpoints, (*CAMERA_CHANNELS, "hello")) as link:
        texts = {"camera": "there is none" if drawn is None else "there is one", "camera_missing": "".join(missing)}
        stop = StopFlag().on_signals()
        return Answer(run_camera(link, drawn, settings, stop=stop, parent=parent, description=describe))


@command(endpoints=Endpoints)
def console(
    *,
    endpoints: Endpoints,
    port: Annotated[int, typer.Option(help="On 127.0.0.1.")] = 8080,
    recordings: Annotated[
        list[Path] | None,
        typer.Option(help="Folder whose recordings can be looked at, or several; else the current one."),
    ] = None,
    host_name: Annotated[
        list[str] | None, typer.Option(help="Another name by which browsers reach it, beside 127.0.0.1 and localhost.")
    ] = None,
    parent: Parent = None,
) -> Answer:
    """Watch a session in the browser, take its handle, and look at recordings.

    With --recordings and no endpoint it shows recordings alone.

    It prints the address to open, which lets one browser in; when that was used it prints another.

    Example: foretouch console --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448
    """
    from foretouch.console import Console
    from foretouch.messages import Stop
    from foretouch.session import StopFlag, give_way, orphaned

    give_way()
    stop = StopFlag().on_signals()
    names, folders = tuple(host_name or ()), tuple(recordings or [Path()])
    live = bool(endpoints.all) or not recordings

    def publish(message: Message) -> None:
        if link is not None:
            link.publish(message)

    shown = Console(port, publish, recordings=folders, names=names, live=live, say=say)
    heard_end = False  # else it is this console alone that ends, and the session goes on

    def watch(message: Message) -> None:
        nonlocal heard_end
        if isinstance(message, Stop):
            heard_end = True
            stop.set(message.reason)
        shown.watch(message)

    linked = open_link("console", endpoints, WATCHED_CHANNELS, watch) if live else contextlib.nullcontext()
    with linked as link:
        say(f"console: {shown.url}")
        # Processes of one parent are of one version: what else one hears is a stranger's.
        differ = link.other_version if link is not None and parent is None else lambda: None
        shown.run(lambda: bool(stop.reason or differ()) or orphaned(parent))
        shown.close(ended=heard_end or (parent is not None and bool(stop.reason)))
        if (error := differ()) is not None:
            raise error
    return Answer({"ended": stop.reason or ENDED, "url": shown.base})
