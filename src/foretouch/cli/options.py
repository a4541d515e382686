"""Options that several commands share, how they are printed, and arguments that a command takes without naming them."""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import math
import shlex
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from foretouch.errors import SettingError, printable


def with_parameters(command: Callable[..., None], parameters: Sequence[inspect.Parameter]) -> Callable[..., None]:
    """Say which arguments a command takes, where `inspect.signature` and Typer look for them.

    Args:
        command: That takes any; it is changed.
        parameters: With their annotations.

    Returns:
        The command.
    """
    vars(command)["__signature__"] = inspect.Signature(parameters)
    command.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return command


LAWS_HELP = (
    "Contact law: contact-map, or continuous-switching (the paper's), hunt-crossley, kelvin-voigt, "
    "threshold-switching, quadratic (that of scenes)."
)
ModelName = Annotated[str, typer.Option("--model", help=LAWS_HELP)]
EstimatorName = Annotated[
    str | None,
    typer.Option("--estimator", help="Estimator; without it the law's own. A wrong name lists them all."),
]
Duration = Annotated[float | None, typer.Option(help="End after so long [s]; without it, Ctrl-C ends.")]
ReportDirectory = Annotated[Path | None, typer.Option("--report", help="Folder for the page with the figures.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of text.")]
Listen = Annotated[
    list[str] | None,
    typer.Option(help="Endpoint to listen on, such as tcp/127.0.0.1:7447; between machines tls/HOST:PORT."),
]
Cluster = Annotated[
    str | None,
    typer.Option(help="Address of a Dask scheduler, such as tcp://HOST:8786: its workers do it (extra cluster)."),
]
Connect = Annotated[list[str] | None, typer.Option(help="Endpoint to connect to; may be given more than once.")]
Insecure = Annotated[
    bool, typer.Option("--insecure", help="Allow tcp endpoints off this machine: anybody may listen and command.")
]
KeysFolder = Annotated[
    Path | None,
    typer.Option("--keys", help="Folder of keys; without it FORETOUCH_KEYS, or ~/.config/foretouch/keys."),
]
Parent = Annotated[int | None, typer.Option(hidden=True)]
PositionUnit = Annotated[
    str | None, typer.Option(help="Unit of positions, where the file states none: m, cm, mm or um; position_m: m.")
]
ForceUnit = Annotated[
    str | None, typer.Option(help="Unit of forces, where the file states none: N, mN, cN or kN; force_N: N.")
]
Flip = Annotated[bool, typer.Option("--flip", help="Positions in the file shrink with depth.")]
FlipForce = Annotated[bool, typer.Option("--flip-force", help="Forces in the file are negative under load.")]
ForceChannel = Annotated[str, typer.Option(help="Force of a TU/e file: raw bridge or logged torque.")]
Surface = Annotated[str, typer.Option(help="Position of the surface [m], or auto.")]
ForceOffset = Annotated[str, typer.Option(help="Force in free air [N], or auto.")]
SensorLag = Annotated[float, typer.Option(help="How late forces are against positions [s], where it is known.")]


def make_folder(path: Path) -> None:
    """Make a folder for results, before anything is computed that would be lost.

    Below the folder that one stands in, those above it are made with it; elsewhere the one above must be there, so that
    a slip in a path makes nothing where nobody looks.

    Raises:
        SettingError: It cannot be made or written to.
    """
    try:
        if not path.parent.is_dir() and not _is_below_here(path):
            raise SettingError("folder", str(path), f"there is no {path.parent} that it could be made in")
        path.mkdir(parents=True, exist_ok=True)
        require_writable(path)
    except OSError as error:
        raise SettingError("folder", str(path), f"cannot be written: {error.strerror}") from None


def made_by(recordings: Sequence[Path] = (), **what: Any) -> dict[str, Any]:
    """What makes a page, for its end: this command as it was given, the recordings, and what else is said of it.

    Args:
        recordings: That are read; of files a checksum says which.
        **what: By name; None is not said.
    """
    said: dict[str, Any] = {"command": shlex.join(["foretouch", *sys.argv[1:]])}
    if recordings:
        said["recording" if len(recordings) == 1 else "recordings"] = "; ".join(map(_which, recordings))
    return said | {name: value for name, value in what.items() if value is not None}


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


def _is_below_here(path: Path) -> bool:
    return path.resolve().is_relative_to(Path.cwd())


def require_duration(duration: float | None) -> None:
    """Raise `SettingError` unless it is above 0, or not given."""
    if duration is not None and not 0.0 < duration < math.inf:
        raise SettingError("duration", duration, "must be finite and above 0 s")


def require_recording(path: Path) -> None:
    """Refuse a recording that could not be written, before anything starts; no folder is made for it.

    Raises:
        SettingError: No MCAP file, or none that can be written there.
    """
    if path.suffix.lower() != ".mcap":
        raise SettingError("recording", str(path), "must end with .mcap")
    require_writable(path.parent)
    if path.exists() and not path.is_file():
        raise SettingError("recording", str(path), "is there and is no file")


def say(line: str) -> None:
    """One line for people, on the error stream: the output stays clean for programs."""
    typer.echo(printable(line, lines=True), err=True)


def show(text: str, *, end: bool = True) -> None:
    """Text with names of others in it, such as topics of a file, as output."""
    typer.echo(printable(text, lines=True), nl=end)


def print_json(content: Mapping[str, Any]) -> None:
    """One JSON object, the whole output; a figure without bound is null, for JSON has no other word for it."""
    typer.echo(json.dumps(_bounded(content), allow_nan=False))


def _bounded(value: Any) -> Any:
    """The same with null for every number that is not finite."""
    if isinstance(value, Mapping):
        return {name: _bounded(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_bounded(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


SESSION_OPTIONS: dict[str, tuple[type, object, str]] = {
    "material": (str, "foam-measured", "What the simulated robot presses: `foretouch materials list`, or a plug-in's."),
    "operator": (str, "scripted", "Who moves it: scripted, recorded, browser, gamepad, force-dimension, or a plug-in."),
    "model": (str, "contact-map", LAWS_HELP),
    "estimator": (str, "", "Estimator; without it the law's own. A wrong name lists them all."),
    "position_delay": (float, 0.08, "One-way delay of positions, leader to follower [s]."),
    "force_delay": (float, 0.3, "One-way delay of models and telemetry, follower to leader [s]."),
    "jitter": (float, 0.0, "Largest change of either delay, to both sides [s]."),
    "loss": (float, 0.0, "Share of messages lost, 0 to 1."),
    "outage": (float, 0.0, "Length of one outage in every 10 s [s]."),
    "seed": (int, 0, "Of sensors, operator and network."),
    "model_rate": (float, 50.0, "Models a second while nothing changes [1/s]."),
    "burst": (float, 1.0, "Mean length of a burst of losses [messages]; 1 loses each by itself."),
    "reorder": (float, 0.0, "Share of messages that later ones overtake, 0 to 1."),
    "duplicate": (float, 0.0, "Share of messages that come twice, 0 to 1."),
    "stall": (float, 0.0, "Length of one stall in every 10 s, at whose end all that was held comes at once [s]."),
    "grip": (str, "none", "Hand that the force moves: soft, normal or stiff; none for the operator's motion as it is."),
    "device_mass": (float, 0.1, "Of the device in the hand [kg]."),
    "device_damping": (float, None, "Viscous friction of the device [N s/m]; simulated 2, in your hand 0.1 at first."),
    "device_friction": (float, 0.1, "Coulomb friction of the device [N]."),
    "device_resolution": (float, 1e-5, "Count of the device's encoder [m]."),
    "device_delay": (
        float,
        None,
        "From reading a position until its force acts [s]; simulated 5e-4, in your hand a tick.",
    ),
    "device_watchdog": (float, 0.02, "When the device drops a force that nobody renews [s]; 0 for never."),
    "largest_stiffness": (float, 0.0, "Largest local stiffness rendered [N/m]; 0 for what the device carries."),
    "position_scale": (float, 1.0, "Follower's motion for the hand's."),
    "force_scale": (float, 1.0, "Hand's force for the follower's."),
    "clutch": (str, "", "When the hand presses the clutch [s]: START:END,START:END."),
    "leader_frame": (str, "0,1", "ORIGIN,DIRECTION: where the device has 0 [m], and -1 if it counts outwards."),
    "follower_frame": (str, "0,1", "ORIGIN,DIRECTION: where the robot has 0 [m], and -1 if it counts outwards."),
    "first_touch": (str, "auto", "Of an unknown surface: guarded or follow; auto guards with a grip or a real robot."),
    "approach_speed": (float, 0.02, "Of a guarded follower before it knows a surface [m/s]."),
    "guarded_force": (float, 2.0, "At which a guarded follower holds [N]."),
    "force_ceiling": (float, 15.0, "Contact force that the follower never holds more than [N]."),
    "stiffest": (float, 1e5, "What it has not gone through yet counts as so stiff [N/m]."),
    "most_damped": (
        float,
        500.0,
        "And as so damped at once [N s/m]; with more it goes slower into it.",
    ),
    "largest_depth": (float, 0.05, "Deepest below a surface that the follower has felt [m]."),
    "largest_speed": (float, 0.25, "Of the follower [m/s]."),
    "largest_acceleration": (float, 40.0, "Of the follower [m/s^2]."),
    "largest_jerk": (float, 1e5, "Of the follower [m/s^3]."),
    "return_speed": (float, 0.05, "Of the follower, inwards, back to commands that it did not follow [m/s]."),
    "queueing_allowance": (float, 0.5, "A command that waited longer than this on its way is stale [s]."),
    "hold_after": (float, 0.05, "Time without a fresh command after which the follower holds [s]."),
    "unload_after": (float, 0.5, "And after which it does what --on-silence says [s]."),
    "on_silence": (str, "unload", "unload: go back until next to nothing is felt; retreat: go out the way in."),
    "sensor_fault": (str, "", "KIND:BEGIN:END [s]: the robot's sensors fail meanwhile, such as stuck:5:8."),
    "scene": (str, "", "In three dimensions: plane, hill, phantom, or the file of a mesh (.stl, .obj, .ply)."),
    "fusion": (str, "full", "Of what the fixture's pose is made: full, image, contact or none."),
    "displacement": (float, 0.02, "A simulated fixture stands at most so far from where it is believed [m]."),
    "turn": (float, 0.175, "And is turned by at most so much [rad]."),
    "bump": (float, 0.0, "When the fixture is bumped [s]; 0 for never."),
    "camera_delay": (float, 0.06, "From an image's exposure until it has been read [s]."),
    "image_fault": (str, "", "KIND:BEGIN:END [s]: hand, glare, frozen or dropped images meanwhile."),
    "robot": (str, "simulated", "The follower's: simulated, or a plug-in's: `foretouch plugins`."),
    "calibration": (
        str,
        "",
        "TOML file of `foretouch calibrate` for the robot's sensor; read where the robot is.",
    ),
    "baseline": (str, "none", "Render the delayed force instead, for comparison: delayed or delayed-tdpa."),
}
"""Type, default and help of every option that becomes a field of `foretouch.session.SessionSettings`."""

SESSION_PANELS: dict[str, tuple[str, ...]] = {
    "What is pressed and learnt": ("material", "model", "estimator", "model_rate", "seed"),
    "Operator, hand and device": (
        "operator",
        "grip",
        "device_mass",
        "device_damping",
        "device_friction",
        "device_resolution",
        "device_delay",
        "device_watchdog",
        "clutch",
        "leader_frame",
    ),
    "What the hand is given": ("position_scale", "force_scale", "largest_stiffness", "baseline"),
    "Robot": (
        "robot",
        "calibration",
        "first_touch",
        "approach_speed",
        "guarded_force",
        "follower_frame",
        "sensor_fault",
    ),
    "In three dimensions": ("scene", "fusion", "displacement", "turn", "bump", "camera_delay", "image_fault"),
    "Safety at the robot": (
        "force_ceiling",
        "stiffest",
        "most_damped",
        "largest_depth",
        "largest_speed",
        "largest_acceleration",
        "largest_jerk",
        "return_speed",
        "queueing_allowance",
        "hold_after",
        "unload_after",
        "on_silence",
    ),
    "Network": (
        "position_delay",
        "force_delay",
        "jitter",
        "loss",
        "burst",
        "reorder",
        "duplicate",
        "stall",
        "outage",
    ),
}
"""Under which heading of the help each of them stands, and in which order."""


def with_session_settings(**defaults: object) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command all of `SESSION_OPTIONS`; it receives them as one argument, ``settings``.

    Args:
        **defaults: Defaults of this command that differ from the common ones.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @functools.wraps(command)
        def run(**arguments: Any) -> None:
            from foretouch.session import SessionSettings

            settings = SessionSettings(**{name: arguments.pop(name) for name in SESSION_OPTIONS})
            command(settings=settings, **arguments)

        own = [
            parameter
            for parameter in inspect.signature(command, eval_str=True).parameters.values()
            if parameter.name != "settings"
        ]
        shared = [
            _option(name, panel, defaults.get(name, SESSION_OPTIONS[name][1]))
            for panel, names in SESSION_PANELS.items()
            for name in names
        ]
        parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own] + shared
        return with_parameters(run, parameters)

    return decorate


def _option(name: str, panel: str, default: object) -> inspect.Parameter:
    """One of `SESSION_OPTIONS` as an argument of a command."""
    kind, _, text = SESSION_OPTIONS[name]
    # The type is a value of the table: no checker can follow it, Typer does.
    option = Annotated[kind, typer.Option(help=text, rich_help_panel=panel)]  # type: ignore[valid-type]
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=option)
