"""Commands that watch a session: a recorder, a camera, a console; each a process of its own, here or elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.links import ENDED, Endpoints, insecurity, open_link, with_endpoints
from foretouch.cli.options import Json, Parent, print_json, require_recording, say, with_session_settings
from foretouch.errors import SettingError

if TYPE_CHECKING:
    from foretouch.messages import Message

__all__ = ["COMMANDS", "camera", "console", "record"]

WATCHED_CHANNELS = (
    "telemetry", "leader", "model", "hello", "stop", "follower-space", "leader-space", "field", "fixture", "image"
)  # fmt: skip
"""What the console's link receives."""


@with_endpoints
def record(
    *,
    path: Annotated[Path, typer.Argument(help="MCAP file to write.")],
    endpoints: Endpoints,
    json_output: Json = False,
    parent: Parent = None,
) -> None:
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
    if json_output:
        print_json({"ended": stop.reason or ENDED, "recording": str(path), "problem": problem or None})
    if problem:
        raise typer.Exit(RECORDING_INCOMPLETE)


@with_session_settings()
@with_endpoints
def camera(*, settings: Any, endpoints: Endpoints, json_output: Json = False, parent: Parent = None) -> None:
    """The camera at the follower of a scene: simulated images, and where they and the touches show the fixture.

    It stands beside the follower, on the same machine, in a process of its own.

    Example: foretouch camera --scene hill --listen tcp/127.0.0.1:7449 --connect tcp/127.0.0.1:7447
    """
    from foretouch.session import StopFlag, give_way
    from foretouch.session.contest import ContestHeard
    from foretouch.session.spatial import CAMERA_CHANNELS, make_camera, make_scene, run_camera

    if not settings.scene:
        raise SettingError("scene", settings.scene, "is needed for a camera: plane, hill, phantom, or a mesh")
    give_way()
    scene = make_scene(settings.scene)
    sees = settings.fusion in ("full", "image") or parent is not None
    missing: list[str] = []
    drawn = make_camera(settings, scene, say=missing.append) if sees else None
    for line in missing:
        say(line)
    contest = ContestHeard("camera", say, parent)

    def describe() -> dict[str, str]:  # called twice a second, as hellos come
        for _, hello in link.take("hello"):
            contest.hear(hello)
        return texts | insecurity(link)

    with open_link("camera", endpoints, (*CAMERA_CHANNELS, "hello")) as link:
        texts = {"camera": "there is none" if drawn is None else "there is one", "camera_missing": "".join(missing)}
        ran = run_camera(
            link,
            scene,
            drawn,
            settings,
            stop=StopFlag().on_signals(),
            parent=parent,
            description=describe,
        )
    if json_output:
        print_json(ran)


@with_endpoints
def console(
    *,
    endpoints: Endpoints,
    port: Annotated[int, typer.Option(help="On 127.0.0.1.")] = 8080,
    recordings: Annotated[Path, typer.Option(help="Folder whose recordings can be looked at.")] = Path(),
    host_name: Annotated[
        list[str] | None, typer.Option(help="Another name by which browsers reach it, beside 127.0.0.1 and localhost.")
    ] = None,
    json_output: Json = False,
    parent: Parent = None,
) -> None:
    """Watch a session in the browser, take its handle, and look at recordings.

    It prints the address to open, which lets one browser in; when that was used it prints another.

    Example: foretouch console --connect tcp/127.0.0.1:7447 --connect tcp/127.0.0.1:7448
    """
    from foretouch.console import Console
    from foretouch.messages import Stop
    from foretouch.session import StopFlag, give_way, orphaned

    give_way()
    stop = StopFlag().on_signals()
    names = tuple(host_name or ())
    shown = Console(port, lambda message: link.publish(message), recordings=recordings, names=names, say=say)

    heard_end = False  # else it is this console alone that ends, and the session goes on

    def watch(message: Message) -> None:
        nonlocal heard_end
        if isinstance(message, Stop):
            heard_end = True
            stop.set(message.reason)
        shown.watch(message)

    with open_link("console", endpoints, WATCHED_CHANNELS, watch) as link:
        say(f"console: {shown.url}")
        # Processes of one parent are of one version: what else one hears is a stranger's.
        differ = link.other_version if parent is None else lambda: None
        shown.run(lambda: bool(stop.reason or differ()) or orphaned(parent))
        shown.close(ended=heard_end or (parent is not None and bool(stop.reason)))
        if (error := differ()) is not None:
            raise error
    if json_output:
        print_json({"ended": stop.reason or ENDED, "url": shown.base})


COMMANDS = (camera, record, console)
