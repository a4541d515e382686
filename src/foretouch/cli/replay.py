"""The command that runs a recorded session again under other settings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import (
    SESSION_OPTIONS,
    Json,
    ReportDirectory,
    made_by,
    make_folder,
    print_json,
    require_recording,
    say,
    show,
)
from foretouch.cli.progress import compile_first, pulsing
from foretouch.cli.recordings import say_if_cut
from foretouch.errors import RecordingError, SettingError

if TYPE_CHECKING:
    from foretouch.messages import SessionLog

__all__ = ["REPLAY", "replay"]

PANEL = "Otherwise than recorded"


def _changed(name: str) -> typer.models.OptionInfo:
    """An option of a session, which here has the recording's value unless it is given."""
    option: typer.models.OptionInfo = typer.Option(help=SESSION_OPTIONS[name][2], rich_help_panel=PANEL)
    return option


def replay(
    *,
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="MCAP of a session.")],
    position_delay: Annotated[float | None, _changed("position_delay")] = None,
    force_delay: Annotated[float | None, _changed("force_delay")] = None,
    jitter: Annotated[float | None, _changed("jitter")] = None,
    loss: Annotated[float | None, _changed("loss")] = None,
    burst: Annotated[float | None, _changed("burst")] = None,
    reorder: Annotated[float | None, _changed("reorder")] = None,
    duplicate: Annotated[float | None, _changed("duplicate")] = None,
    stall: Annotated[float | None, _changed("stall")] = None,
    outage: Annotated[float | None, _changed("outage")] = None,
    seed: Annotated[int | None, _changed("seed")] = None,
    model: Annotated[str | None, _changed("model")] = None,
    estimator: Annotated[str | None, _changed("estimator")] = None,
    model_rate: Annotated[float | None, _changed("model_rate")] = None,
    grip: Annotated[str | None, _changed("grip")] = None,
    closed_loop: Annotated[
        bool, typer.Option("--closed-loop", help="The force that is rendered now moves the hand, from what it meant.")
    ] = False,
    output: Annotated[Path | None, typer.Option("--recording", help="MCAP file to write the replay to.")] = None,
    report: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """Run a recorded session again, under other delays, faults, laws or estimators, and compare both.

    What is not given is as it was recorded. The operator's motion is fixed, unless --closed-loop lets the force move
    the hand. A simulated material answers; of a real robot there is only the force where it was measured.

    Example: foretouch replay session.mcap --force-delay 0.6
    """
    from foretouch.report import compare_replay, render_replay, write_replay_page
    from foretouch.session import recorded_settings, replay_notes, replay_under

    given = {
        "position_delay": position_delay,
        "force_delay": force_delay,
        "jitter": jitter,
        "loss": loss,
        "burst": burst,
        "reorder": reorder,
        "duplicate": duplicate,
        "stall": stall,
        "outage": outage,
        "seed": seed,
        "model": model,
        "estimator": estimator,
        "model_rate": model_rate,
        "grip": grip,
    }
    if grip is not None and not closed_loop:
        raise SettingError("grip", grip, "in an open loop no force moves the hand: give --closed-loop too")
    if output is not None:
        require_recording(output)
        if output.resolve() == recording.resolve():
            raise SettingError("recording", str(output), "is the recording itself: name another file")
    if report is not None:
        make_folder(report)
    log = _session(recording)
    changes = {name: value for name, value in given.items() if value is not None}
    settings, told = recorded_settings(log.longest().settings, changes)
    compile_first()
    again = pulsing("running the session again", replay_under, log, settings, closed_loop)
    if output is not None:
        _write(output, again)
    content = compare_replay(log, again, (*replay_notes(log, settings, closed_loop), *told))
    content["recording"] = str(recording)
    if json_output:
        print_json(content)
    else:
        show(f"{recording}\n{render_replay(content)}")
    if report is not None:
        page = write_replay_page(report, recording.name, log, again, content, made_by([recording]))
        say(f"report: {page}")


REPLAY = (replay,)


def _session(path: Path) -> SessionLog:
    """A recorded session; other recordings are sent where they can be predicted."""
    from foretouch.recordings import read_session

    if path.suffix.lower() != ".mcap" and path.is_file():
        raise RecordingError(path, f"is no session's MCAP; `foretouch predict {path} --delay S` takes a press alone")
    log = read_session(path)
    say_if_cut(path, log)
    return log


def _write(path: Path, log: SessionLog) -> None:
    """The replay as a recording of its own, message by message as in simulated time."""
    from foretouch.messages import VERSION, FollowerSpace, Hello, LeaderSpace, LeaderState, Message, Telemetry
    from foretouch.recordings import SessionWriter

    texts = log.settings
    said: list[Message] = [Telemetry(VERSION, *row) for row in log.follower.tolist()]
    said += [FollowerSpace(VERSION, *row) for row in log.follower_space.tolist()]
    said += [*log.models, *log.fields, *log.images, *log.beliefs]
    said += [LeaderState(VERSION, *row) for row in log.leader.tolist()]
    said += [LeaderSpace(VERSION, *row) for row in log.leader_space.tolist()]
    said.sort(key=lambda message: message.time_ns)  # of those of one tick, the follower's first
    with SessionWriter(path) as writer:
        writer.write(Hello.of("simulation", 1, 0, texts), 0)
        for message in said:
            writer.write(message, message.time_ns)
        writer.close(log.counts)
