"""What several commands share: their options, what they refuse, and how they print."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import json
import math
import shlex
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.errors import LinkError, SettingError, printable
from foretouch.settings import ARM_ENDING, DEFAULTS, KINDS, SETTINGS, is_arm

if TYPE_CHECKING:
    from foretouch.link import ZenohLink
    from foretouch.messages import Message
    from foretouch.session import SessionSettings


@dataclass(frozen=True)
class Answer:
    """What a command prints: one JSON object for programs or lines for people; and its exit code."""

    content: object
    lines: str | Iterable[str] = ()
    code: int = 0

    def give(self, as_json: bool) -> None:
        """Print it, and end the command where its exit code is not 0."""
        if as_json and self.content is not None:
            typer.echo(json.dumps(_bounded(self.content), allow_nan=False))
        if not as_json:
            for line in [self.lines] if isinstance(self.lines, str) else self.lines:
                show(line)
        if self.code:
            raise typer.Exit(self.code)


def command(
    *, json_help: str = "Print one JSON object instead of text.", **makers: Callable[..., Any]
) -> Callable[[Callable[..., Answer | None]], Callable[..., None]]:
    """Make a command of a function whose `Answer` is printed, as JSON with the option --json, which this adds.

    Args:
        json_help: Help of that option.
        **makers: By the name of the function's parameter, the class or function that makes its argument, whose
            parameters are options, with their defaults and annotations. They replace that parameter in order. A
            parameter ``json_output`` is given whether JSON is wanted.
    """

    def decorate(function: Callable[..., Answer | None]) -> Callable[..., None]:
        groups = {name: _parameters(maker) for name, maker in makers.items()}
        answers = "Answer" in str(function.__annotations__["return"])
        own = {one.name: one for one in _parameters(function, *makers)}
        wants_json = own.pop("json_output", None) is not None

        @functools.wraps(function)
        def run(json_output: bool = False, **given: Any) -> None:
            made = {name: makers[name](**{one.name: given.pop(one.name) for one in groups[name]}) for name in makers}
            answer = function(**made, **given, **({"json_output": json_output} if wants_json else {}))
            if answer is not None:
                answer.give(json_output)

        taken = [each for name, one in own.items() for each in groups.get(name, [one])]
        if answers or wants_json:
            taken.append(_parameter("json_output", False, bool, typer.Option("--json", help=json_help)))
        return _taking(run, taken)

    return decorate


def _parameters(function: Callable[..., Any], *made: str) -> list[inspect.Parameter]:
    """What a function takes, for Typer; the types of what is made, and returned, may be imported for mypy alone."""
    for name in (*made, "return"):
        function.__annotations__.pop(name, None)
    taken = inspect.signature(function, eval_str=True).parameters.values()
    return [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in taken]


def _parameter(name: str, default: object, kind: Any, option: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, option])


def _taking(function: Callable[..., Any], parameters: Sequence[inspect.Parameter]) -> Callable[..., Any]:
    """The function, with its parameters where `inspect.signature` and Typer look for them."""
    vars(function)["__signature__"] = inspect.Signature(parameters)
    function.__annotations__ = {one.name: one.annotation for one in parameters}
    return function


Duration = Annotated[float | None, typer.Option(help="End after so long [s]; without it, Ctrl-C ends.")]
ReportDirectory = Annotated[Path | None, typer.Option("--report", help="Folder for the page with the figures.")]
KeysFolder = Annotated[
    Path | None,
    typer.Option("--keys", help="Folder of keys; without it FORETOUCH_KEYS, or ~/.config/foretouch/keys."),
]
Parent = Annotated[int | None, typer.Option(hidden=True)]


def require_folder(path: Path | None) -> None:
    """Refuse a folder for results that could not be made or written to, before anything is computed that would be lost.

    It is made to try, and taken away again: a command that is refused for something else leaves none behind. Who writes
    the results makes it. Below the working directory its parents are made with it; elsewhere the parent must exist, so
    that a slip in a path makes no folder that goes unnoticed.
    """
    if path is None:
        return
    new: list[Path] = []
    try:
        new += [folder for folder in (path, *path.parents) if not folder.exists()]
        if not path.parent.is_dir() and not path.resolve().is_relative_to(Path.cwd()):
            raise SettingError("folder", str(path), f"there is no {path.parent} that it could be made in")
        path.mkdir(parents=True, exist_ok=True)
        require_writable(path)
    except OSError as error:
        raise SettingError("folder", str(path), f"cannot be written: {error.strerror}") from None
    finally:
        for folder in new:
            with contextlib.suppress(OSError):  # it was not made, or another process has put something in
                folder.rmdir()


def made_by(recordings: Sequence[Path] = (), **what: Any) -> dict[str, Any]:
    """Origin of a page, for its end: this command as it was given, the recordings, and further values."""
    texts: dict[str, Any] = {"command": shlex.join(["foretouch", *sys.argv[1:]])}
    if recordings:
        texts["recording" if len(recordings) == 1 else "recordings"] = "; ".join(map(_which, recordings))
    return texts | {name: value for name, value in what.items() if value is not None}


def _which(path: Path) -> str:
    """A recording's path and, of a file, the beginning of its checksum."""
    if not path.is_file():
        return str(path)
    with path.open("rb") as file:
        return f"{path} (SHA-256 {hashlib.file_digest(file, 'sha256').hexdigest()[:16]})"


def require_writable(folder: Path) -> None:
    """Raise `SettingError` unless a folder is there and files can be made in it."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except FileNotFoundError:
        raise SettingError("folder", str(folder), f"is not there: mkdir -p {folder}") from None
    except OSError as error:
        raise SettingError("folder", str(folder), f"cannot be written: {error.strerror}") from None


def require_elsewhere(output: Path | None, *read: Path | None, name: str, why: str = "is the recording itself") -> None:
    """Refuse an output in the place of what is read, where both are given."""
    if output is not None and output.resolve() in [path.resolve() for path in read if path is not None]:
        raise SettingError(name, str(output), f"{why}: name another file")


def require_duration(duration: float | None) -> None:
    """Raise `SettingError` unless it is above 0, or not given."""
    if duration is not None and not 0.0 < duration < math.inf:
        raise SettingError("duration", duration, "must be finite and above 0 s")


SIX_AXES = ("torque_bias", "centre_of_mass", "sensor_turn", "tool_inertia")
"""What a calibration knows that only six axes show."""


def require_machines(settings: SessionSettings, *, quiet: bool = False) -> None:
    """Refuse a file of an arm, a scene or a calibration that no session can begin with, before what takes long.

    What the robot cannot use of a calibration is said in one line, unless `quiet`.
    """
    from foretouch.robot import make_material, read_arm
    from foretouch.session import session_calibration, setup_of

    if settings.robot.endswith(ARM_ENDING):
        read_arm(settings.robot)
    make_material(settings.material)
    known = session_calibration(settings)
    unused = [name for name in SIX_AXES if getattr(known, name, None) is not None and not is_arm(settings.robot)]
    if unused and not quiet:
        why = f"robot {settings.robot} shows no torques, as the wrist of an arm does"
        say(f"calibration: {settings.calibration}: left out {', '.join(unused)}: {why}")
    setup_of(settings)  # reads the scene


def require_recording(path: Path | None) -> None:
    """Refuse a recording that could not be written, if any, before anything starts; no folder is made for it."""
    if path is None:
        return
    if path.suffix.lower() != ".mcap":
        raise SettingError("recording", str(path), "must end with .mcap")
    require_writable(path.parent)
    if path.exists() and not path.is_file():
        raise SettingError("recording", str(path), "is there and is no file")


def say(line: str) -> None:
    """One line for people, on the error stream: the output stays clean for programs."""
    typer.echo(printable(line, lines=True), err=True)


def show(text: str) -> None:
    """Text with names of others in it, such as topics of a file, as output."""
    typer.echo(printable(text, lines=True))


def _bounded(value: Any) -> Any:
    """The same with null for every number that is not finite: JSON has no other word for it."""
    if isinstance(value, Mapping):
        return {name: _bounded(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_bounded(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def session_settings(**defaults: object) -> Callable[..., SessionSettings]:
    """Makes the settings of a session from options, for `with_options`."""

    def make(**given: Any) -> SessionSettings:
        from foretouch.session import SessionSettings
        from foretouch.session.workspace import unused_setting

        settings = SessionSettings(**given)
        if unused := unused_setting(settings):
            raise unused
        return settings

    return _taking(make, [_option(name, one.group, (DEFAULTS | defaults)[name]) for name, one in SETTINGS.items()])


def changed_settings(panel: str, *names: str) -> Callable[..., dict[str, Any]]:
    """Maker of a mapping of the settings that are given as options, without defaults, for `with_options`."""

    def make(**given: Any) -> dict[str, Any]:
        return {name: value for name, value in given.items() if value is not None}

    return _taking(make, [_option(name, panel, None) for name in names])


def _option(name: str, panel: str, default: object) -> inspect.Parameter:
    kind = {"str": str, "int": int}.get(KINDS[name], float)
    return _parameter(name, default, kind, typer.Option(help=SETTINGS[name].sentence, rich_help_panel=panel))


ENDED = "the session was ended"  # Why a process that only listens has ended without being asked to


@dataclass(frozen=True)
class Endpoints:
    """Endpoints of a process by the options; without `keys` its keys are in the usual folder."""

    listen: Annotated[
        list[str] | None,
        typer.Option(help="Endpoint to listen on, such as tcp/127.0.0.1:7447; between machines tls/HOST:PORT."),
    ] = None
    connect: Annotated[list[str] | None, typer.Option(help="Endpoint to connect to; may be given more than once.")] = (
        None
    )
    insecure: Annotated[
        bool,
        typer.Option("--insecure", help="Allow tcp endpoints off this machine: anybody may listen and command."),
    ] = False
    keys: KeysFolder = None

    def __str__(self) -> str:
        return ", ".join(self.all)

    @property
    def all(self) -> tuple[str, ...]:
        """Those to listen on, and those to connect to."""
        return (*(self.listen or ()), *(self.connect or ()))


def open_link(
    process: str, endpoints: Endpoints, channels: Sequence[str], watch: Callable[[Message], None] | None = None
) -> ZenohLink:
    """The link of one process, with its keys where an endpoint asks for them; prints its warnings.

    A LinkError says that there is no endpoint, or one that cannot be used; a SettingError that keys are not there or
    not good.
    """
    from foretouch.link import ROLES, ZenohLink, is_encrypted, load_credentials

    if not endpoints.all:
        raise LinkError("no endpoint: give --listen or --connect, for example --connect tcp/127.0.0.1:7447")
    role = process if process in ROLES else "watcher"
    credentials = load_credentials(role, endpoints.keys) if any(map(is_encrypted, endpoints.all)) else None
    link = ZenohLink(
        listen=endpoints.listen or (),
        connect=endpoints.connect or (),
        subscribe=channels,
        insecure=endpoints.insecure,
        credentials=credentials,
        watch=watch,
    )
    if credentials is not None and credentials.warning:
        say(f"{process}: {credentials.warning}")
    if link.insecure:
        say(f"{process}: INSECURE: nothing is encrypted and nobody is checked; anybody on this network may command")
    return link


def unchecked(endpoints: Endpoints) -> str:
    """One line on a follower that may be commanded without a certificate, from its own machine; "" for others."""
    from foretouch.link import is_encrypted, is_exposed

    here = [endpoint for endpoint in endpoints.all if not is_encrypted(endpoint) and not is_exposed(endpoint)]
    asked_of = f"no certificate is asked for on {', '.join(here)}"
    return f"{asked_of}: every user of this machine may command there" if here else ""


def insecurity(link: ZenohLink) -> dict[str, str]:
    """Text in the `Hello` of an insecure process, for console, recording and report."""
    return {"insecure": "yes"} if link.insecure else {}
