"""Commands that run a whole session on this machine, live, simulated, or recorded and now under other settings.

A command checks that what it needs is installed before it starts processes that would each report it.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import (
    Answer,
    Duration,
    ReportDirectory,
    changed_settings,
    command,
    made_by,
    require_duration,
    require_elsewhere,
    require_folder,
    require_machines,
    require_recording,
    say,
    session_settings,
)
from foretouch.cli.progress import compile_first, progress_bar, pulsing
from foretouch.cli.reading import say_if_cut
from foretouch.cli.remembering import Remember, keep_of, settings_with
from foretouch.errors import MissingExtraError, RecordingError, SettingError
from foretouch.settings import FAULTS

if TYPE_CHECKING:
    from foretouch.messages import SessionLog
    from foretouch.session import SessionSettings


MODULES = {"sim": "mujoco", "link": "zenoh", "console": "viser", "recordings": "mcap"}
"""By its extra, the module that shows whether it is installed."""


def require_extras(*extras: str) -> None:
    """Refuse in one line what is not installed; nothing is imported."""
    missing = [extra for extra in extras if importlib.util.find_spec(MODULES[extra]) is None]
    if missing:
        raise MissingExtraError(", ".join(MODULES[extra] for extra in missing), ",".join(missing))


RecordingFile = Annotated[Path | None, typer.Option("--recording", help="MCAP file to write.")]


@command(settings=session_settings(operator="browser"))
def teleop(
    *,
    duration: Duration = None,
    headless: Annotated[bool, typer.Option("--headless", help="No console.")] = False,
    port: Annotated[int, typer.Option(help="Of the console, on 127.0.0.1.")] = 8080,
    recording: RecordingFile = None,
    report: ReportDirectory = None,
    remember: Remember = None,
    json_output: bool,
    settings: SessionSettings,
) -> Answer:
    """The main job: leader, follower, console and recorder on this machine, joined by a real network connection.

    Example: foretouch teleop --headless --duration 20 --operator recorded --report out
    """
    from foretouch.session import StopFlag, run_processes

    require_duration(duration)
    settings = settings_with(settings, remember)
    require_extras("sim", "link", *(() if headless else ("console",)), "recordings")
    require_machines(settings)  # each side does it again; here, the user gets the error before anything starts
    path = recording or (Path(time.strftime("foretouch-%Y%m%d-%H%M%S.mcap")) if report is None else report / RECORDED)
    require_recording(recording)
    require_folder(report)
    if not headless:
        from foretouch.console import require_free_port

        require_free_port(port)
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)  # the recorder makes none
    require_recording(path)
    say("Ctrl-C ends the session and prints the report." if duration is None else f"running for {duration:g} s")
    code = run_processes(
        settings,
        recording=path,
        console_port=None if headless else port,
        duration=duration,
        stop=StopFlag().on_signals(),
        say=say,
    )
    return _recorded(path, report, json_output, code, remember)


@command(settings=session_settings())
def simulate(
    *,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 20.0,
    recording: RecordingFile = None,
    report: ReportDirectory = None,
    remember: Remember = None,
    settings: SessionSettings,
) -> Answer:
    """The same session in simulated time: one process, seeded network, the same result every time.

    With --scene it runs in three dimensions: a fixture that a camera sees, and what it is made of, place by place;
    touched by a point, or with --probe-radius by a sphere.

    Example: foretouch simulate --duration 20 --material hunt-crossley --report out
    """
    from foretouch.recordings import SessionWriter
    from foretouch.session import require_simulated_operator
    from foretouch.session import simulate as run

    require_duration(duration)
    settings = settings_with(settings, remember)
    require_simulated_operator(settings)
    require_machines(settings)
    require_recording(recording)
    require_folder(report)
    compile_first()
    with progress_bar("simulating") as bar, contextlib.ExitStack() as files:
        writer = functools.cache(lambda: files.enter_context(SessionWriter(str(recording))))  # by the first message
        record = None if recording is None else lambda message, now_ns: writer().write(message, now_ns)
        shown: dict[str, Any] = {"progress": lambda now: bar.update(now, duration), "say": say}
        session = run(settings, duration=duration, record=record, **shown)
        if recording is not None:
            writer().close(session.log.counts)
    keep_of(session.log, remember)
    return report_of(session.log, recording, report, elapsed=session.elapsed)


RECORDED = "session.mcap"  # Name of the recording in the folder of its report
LARGE = 5.0  # Reading a larger recording takes more than a second [MB]


def _recorded(path: Path, directory: Path | None, json_output: bool, code: int, remember: str | None) -> Answer:
    """The report of a session that was recorded, as far as it was; says what was kept where it was not."""
    from foretouch.recordings import read_session
    from foretouch.session import RECORDING_INCOMPLETE

    size = path.stat().st_size * 1e-6 if path.is_file() else 0.0
    if size >= LARGE:
        say(f"reading the recording for the report ({size:.0f} MB)")
    try:
        log = pulsing("reading the recording for the report", read_session, path)
    except RecordingError as error:
        say(f"no report: {error}")
        return Answer(None, code=code)
    if not log.leader.size and not json_output:  # a reader of JSON always gets the object
        why = "the session failed for what stands above" if code == 1 else "the session never began"
        say(f"no report: {why}, and {path} holds no tick of a leader")
        return Answer(None, code=code)
    keep_of(log, remember)
    if code == RECORDING_INCOMPLETE:
        ticks = [table["time_ns"] for table in (log.leader, log.follower) if table.size]
        kept = max((float(times[-1] - times[0]) * 1e-9 for times in ticks), default=0.0)
        say(f"the recording is not all there: {kept:.1f} s of the session are kept in {path}")
    return replace(report_of(log, path, directory), code=code)


def report_of(log: SessionLog, path: Path | None, directory: Path | None, *, elapsed: float | None = None) -> Answer:
    """A session's report; its page is written where one is asked for."""
    from foretouch.report import render_text, session_figures, write_page

    if path is not None:
        say_if_cut(path, log)
    content = pulsing("working out the report", session_figures, log)
    content["recording"] = None if path is None else str(path)
    if elapsed is not None:
        content["timing"]["elapsed_s"] = elapsed
    if directory is not None:
        pulsing("drawing the page", write_page, directory, log, content, made_by([] if path is None else [path]))
        say(f"report: {directory / 'index.html'}")
    return Answer(content, render_text(content))


CHANGES = ("position_delay", "force_delay", *FAULTS, "seed", "model", "estimator", "model_rate", "grip")
"""Settings under which a session can be run again."""


@command(changes=changed_settings("Otherwise than recorded", *CHANGES))
def replay(
    *,
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="MCAP of a session.")],
    closed_loop: Annotated[
        bool, typer.Option("--closed-loop", help="The force that is rendered now moves the hand, from what it meant.")
    ] = False,
    output: Annotated[Path | None, typer.Option("--recording", help="MCAP file to write the replay to.")] = None,
    report: ReportDirectory = None,
    changes: dict[str, Any],
) -> Answer:
    """Run a recorded session again, under other delays, faults, laws or estimators, and compare both.

    What is not given is as it was recorded. The operator's motion is fixed, unless --closed-loop lets the force move
    the hand. A simulated material answers; of a real robot there is only the force where it was measured.

    Example: foretouch replay session.mcap --force-delay 0.6
    """
    from foretouch.recordings import read_session
    from foretouch.report import compare_replay, render_replay, write_replay_page
    from foretouch.session import recorded_settings, replay_notes, replay_under

    if "grip" in changes and not closed_loop:
        raise SettingError("grip", changes["grip"], "in an open loop no force moves the hand: give --closed-loop too")
    require_recording(output)
    require_elsewhere(output, recording, name="recording")
    require_folder(report)
    if recording.suffix.lower() != ".mcap" and recording.is_file():  # it can be predicted
        alone = f"`foretouch predict {recording} --delay S` takes a press alone"
        raise RecordingError(recording, f"is no session's MCAP; {alone}")
    log = read_session(recording)
    say_if_cut(recording, log)
    settings, reported = recorded_settings(log.longest().settings, changes)
    compile_first()
    again = pulsing("running the session again", replay_under, log, settings, closed_loop)
    if output is not None:
        _write(output, again)
    content = compare_replay(log, again, (*replay_notes(log, settings, closed_loop), *reported))
    content["recording"] = str(recording)
    if report is not None:
        page = write_replay_page(report, recording.name, log, again, content, made_by([recording]))
        say(f"report: {page}")
    return Answer(content, f"{recording}\n{render_replay(content)}")


def _write(path: Path, log: SessionLog) -> None:
    """The replay as a recording of its own, message by message as in simulated time."""
    from foretouch.messages import Hello
    from foretouch.recordings import SessionWriter

    with SessionWriter(path) as writer:
        writer.write(Hello.of("simulation", 1, 0, log.settings), 0)
        for message in log.messages():
            writer.write(message, message.time_ns)
        writer.close(log.counts)
