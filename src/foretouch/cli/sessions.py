"""Commands that run a whole session on this machine."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.extras import require_extras
from foretouch.cli.options import (
    Duration,
    Json,
    ReportDirectory,
    made_by,
    make_folder,
    print_json,
    require_duration,
    require_recording,
    say,
    show,
    with_session_settings,
)
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.cli.recordings import say_if_cut
from foretouch.errors import RecordingError

if TYPE_CHECKING:
    from foretouch.messages import SessionLog

__all__ = ["COMMANDS", "print_report", "simulate", "teleop"]

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
    from foretouch.session import RECORDING_INCOMPLETE, StopFlag, run_processes, session_calibration

    require_duration(duration)
    require_extras("sim", "link", *(() if headless else ("console",)), "recordings")
    _check_material(settings.material)
    session_calibration(settings)  # the follower reads it again; here, who typed it is told before anything starts
    path = recording or _default_recording(report)
    if recording is not None:
        require_recording(recording)
    if report is not None:
        make_folder(report)
    require_recording(path)
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
    _report_recorded(path, report, json_output, all_of_it=code != RECORDING_INCOMPLETE, failed=code == 1)
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

    With --scene it runs in three dimensions: a fixture that a camera sees, and what it is made of, place by place.

    Example: foretouch simulate --duration 20 --material hunt-crossley --report out
    """
    from foretouch.recordings import SessionWriter
    from foretouch.session import prepare_simulation, require_simulated_operator

    require_duration(duration)
    require_simulated_operator(settings)
    if recording is not None:
        require_recording(recording)
    if report is not None:
        make_folder(report)
    compile_first()
    with progress_bar("simulating") as bar:
        start = prepare_simulation(settings, duration=duration, progress=lambda now: bar.update(now, duration), say=say)
        if recording is None:
            session = start(None)
        else:
            with SessionWriter(recording) as writer:
                session = start(writer.write)
                writer.close(session.log.counts)
    print_report(session.log, recording, report, json_output, elapsed=session.elapsed)


COMMANDS = (teleop, simulate)


def _check_material(name: str) -> None:
    from foretouch.robot import make_material

    make_material(name)


def _default_recording(report: Path | None) -> Path:
    if report is not None:
        return report / "session.mcap"
    return Path(time.strftime("foretouch-%Y%m%d-%H%M%S.mcap"))


def _report_recorded(path: Path, directory: Path | None, json_output: bool, *, all_of_it: bool, failed: bool) -> None:
    """Print the report of a session that was recorded, as far as it was, and say what was kept where it was not."""
    from foretouch.recordings import read_session

    try:
        log = read_session(path)
    except RecordingError as error:
        say(f"no report: {error}")
        return
    if not log.leader.size and not json_output:  # who reads JSON is given the object that there always is
        why = "the session failed for what stands above" if failed else "the session never began"
        say(f"no report: {why}, and {path} holds no tick of a leader")
        return
    if not all_of_it:
        ticks = [table["time_ns"] for table in (log.leader, log.follower) if table.size]
        kept = max((float(times[-1] - times[0]) * 1e-9 for times in ticks), default=0.0)
        say(f"the recording is not all there: {kept:.1f} s of the session are kept in {path}")
    print_report(log, path, directory, json_output)


def print_report(
    log: SessionLog, path: Path | None, directory: Path | None, json_output: bool, *, elapsed: float | None = None
) -> None:
    """Print a session's report, and write its page where one is asked for."""
    from foretouch.report import render_text, session_report, write_page

    if path is not None:
        say_if_cut(path, log)
    content = session_report(log)
    content["recording"] = None if path is None else str(path)
    if elapsed is not None:
        content["timing"]["elapsed_s"] = elapsed
    if json_output:
        print_json(content)
    else:
        show(render_text(content))
    if directory is not None:
        write_page(directory, log, content, made_by([] if path is None else [path]))
        say(f"report: {directory / 'index.html'}")
