"""Commands that work on recordings."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import Answer, ReportDirectory, command, made_by, require_elsewhere, require_folder, say
from foretouch.cli.progress import compile_first, pulsing
from foretouch.cli.reading import Scored, Source, read_and_say, recording_options, say_what_is_left_out
from foretouch.cli.remembering import Remember, begin_as, begin_with, keep
from foretouch.errors import SettingError, plural
from foretouch.settings import LAWS_HELP

if TYPE_CHECKING:
    from foretouch.identification import Learner
    from foretouch.quantities import Recording
    from foretouch.recordings import RecordingOptions

WORTHLESS = 50.0  # Residual from which on a law is reported not to describe a recording [% of the force in contact]


@dataclass(frozen=True)
class Learning:
    """Which law is learnt from a recording, by which estimator, and what is known of surface and sensor."""

    model: Annotated[str, typer.Option("--model", help=LAWS_HELP)] = "contact-map"
    estimator: Annotated[
        str | None,
        typer.Option("--estimator", help="Estimator; without it the law's own. A wrong name lists them all."),
    ] = None
    surface: Annotated[str, typer.Option(help="Position of the surface [m], or auto.")] = "auto"
    force_offset: Annotated[
        str, typer.Option(help="Force in free air [N], its standard deviation too (0.3±0.05), or auto.")
    ] = "auto"
    sensor_lag: Annotated[float, typer.Option(help="How late forces are against positions [s], where it is known.")] = (
        0.0
    )

    remember: Remember = None

    def __post_init__(self) -> None:
        """Refuse what is no number before anything is read or compiled."""
        from foretouch.errors.checks import require
        from foretouch.identification.conditioning.conditioner import LONGEST_LAG

        require("sensor_lag", self.sensor_lag, at_least=0.0, at_most=LONGEST_LAG)
        _number_or_auto("surface", self.surface)
        _with_error("force-offset", self.force_offset)

    @property
    def title(self) -> str:
        """Law and estimator, for people."""
        return f"{self.model} by {self.estimator}"

    def with_estimator(self) -> Learning:
        """The same with the law's own estimator where none is named; an UnknownNameError says that it is no law."""
        from foretouch.identification import default_estimator

        return self if self.estimator is not None else replace(self, estimator=default_estimator(self.model))

    def learner(self) -> functools.partial[Learner]:
        """Makes the learner, once the recording's contact floor is known."""
        from foretouch import identification

        assert self.estimator is not None  # `with_estimator` has been asked
        offset, error = _with_error("force-offset", self.force_offset)
        estimator = identification.make_estimator(self.model, self.estimator)
        begin_with(estimator, self.remember)
        return functools.partial(
            identification.Learner,
            estimator,
            surface=_number_or_auto("surface", self.surface),
            force_offset=offset,
            offset_error=error,
            sensor_lag=self.sensor_lag,
        )

    def at_the_contact(self, data: Recording, path: Path) -> tuple[Recording, Learning]:
        """The recording as its sensor's calibration corrects it, and the same with what that knows of the sensor.

        A SettingError says that the calibration has what is given here too.
        """
        from foretouch.identification import correct_recording
        from foretouch.recordings import read_calibration

        calibration = read_calibration(path)
        known = calibration.force_offset
        if known is not None and self.force_offset != "auto":
            raise SettingError("force-offset", self.force_offset, f"{path} has it too: give one of them")
        if calibration.sensor_lag is not None and self.sensor_lag != 0.0:
            raise SettingError("sensor-lag", self.sensor_lag, f"{path} has it too: give one of them")
        data = correct_recording(data, calibration, force_offset=_with_error("force-offset", self.force_offset)[0])
        return data, replace(
            self,
            force_offset=self.force_offset if known is None else repr(known),
            sensor_lag=calibration.sensor_lag or self.sensor_lag,
        )


@dataclass(frozen=True)
class ScoredOne(Scored):
    """Which part of one recording is scored."""

    score_from: Annotated[float, typer.Option(help="Scoring begins [s after the first sample].")] = 1.5

    def __str__(self) -> str:
        return f"from {self.score_from:g} s" + (f" to {self.score_to:g} s" if self.score_to is not None else "")


@command(source=Source, learning=Learning, options=recording_options)
def identify(
    *,
    source: Source,
    learning: Learning,
    sensor: Annotated[
        Path | None, typer.Option(help="TOML of `foretouch calibrate`: offset, lag and compliance are corrected.")
    ] = None,
    options: RecordingOptions,
    out: Annotated[Path | None, typer.Option(help="CSV or Parquet file for the parameters at every sample.")] = None,
) -> Answer:
    """Identify a contact model from a recording, sample by sample.

    Example: foretouch identify press.csv --position-unit mm --json
    """
    from foretouch import identification
    from foretouch.models import ContactMapModel, summarise_map
    from foretouch.recordings import write_columns
    from foretouch.report.numbers import finite_or_none

    recording = source.path()
    require_elsewhere(out, recording, name="out")
    learning = learning.with_estimator()
    data = read_and_say(recording, options)
    if options.map_file is None:
        say_what_is_left_out(recording)
    if sensor is not None:
        data, learning = learning.at_the_contact(data, sensor)
    compile_first()
    learner = learning.learner()
    result = pulsing(
        f"identifying from {plural(len(data), 'sample')}",
        identification.identify,
        data,
        learner(contact_floor=data.contact_floor),
        keep_history=out is not None,
    )
    memory = keep(learner.args[0], learning.remember)
    residual, contact = result.residual_rms, result.contact_force_rms
    percent = finite_or_none(100.0 * residual / contact) if contact > 0.0 else None
    status, hint = _verdict(data, percent)
    model = result.model
    content = {
        "model": learning.model,
        "estimator": learning.estimator,
        "parameters": result.parameters,
        "map": summarise_map(model).figures(result.standard_deviation) if isinstance(model, ContactMapModel) else None,
        "standard_errors": result.standard_errors,
        "standard_errors_with_surface": result.standard_errors_with_surface,
        "surface_m": result.surface,
        "surface_error_m": finite_or_none(result.surface_error),
        "force_offset_N": result.force_offset,
        "sensor_lag_s": result.sensor_lag,
        "sensor_lag_error_s": result.sensor_lag_error,
        "samples": len(data),
        "contact_samples": int(result.in_contact.sum()),
        "residual_rms_N": finite_or_none(residual),
        "residual_percent": percent,
        **({} if memory is None else {"memory": memory}),
        "status": status if math.isfinite(residual) else "no_residual",
        "hint": hint,
    }
    if out is not None:
        write_columns(out, {"time_s": data.time, "in_contact": result.in_contact, **result.history})
    return Answer(content, _lines(f"{source.name}: {learning.title}", content))


SCORES = (
    *("samples", "scored_samples", "contact_force_rms_N", "prediction_rmse_N", "prediction_error_percent"),
    *(
        "error_up_to_constant_percent",
        "delayed_force_error_percent",
        "within_jnd_percent",
        "phantom_force_rms_N",
        "missed_contact_percent",
        "force_zero_N",
        "force_zero_from",
    ),
)
"""Scores of a prediction that are printed."""


@command(source=Source, learning=Learning, options=recording_options, scored=ScoredOne)
def predict(
    *,
    source: Source,
    delay: Annotated[float, typer.Option(help="Of the forces [s].")] = 0.3,
    learning: Learning,
    options: RecordingOptions,
    scored: ScoredOne,
    out: Annotated[Path | None, typer.Option(help="CSV or Parquet file for the forces.")] = None,
    report_directory: ReportDirectory = None,
) -> Answer:
    """Predict the force of a recorded motion as a leader would, whose forces arrive late.

    Example: foretouch predict press.csv --delay 0.3 --json
    """
    from foretouch.errors.checks import require
    from foretouch.recordings import is_session, read_session, write_columns
    from foretouch.report import forces_under_delay, remarks, score_prediction

    require("delay", delay, at_least=0.0)
    recording = source.path()
    require_elsewhere(out, recording, name="out")
    require_folder(report_directory)
    learning = learning.with_estimator()
    of_session = options.map_file is None and is_session(recording)
    data: Any = read_session(recording) if of_session else read_and_say(recording, options)
    compile_first()
    learner, (zero, error) = learning.learner(), _with_error("force-offset", learning.force_offset)
    zero = zero if error == 0.0 else None
    if of_session:
        if learning.remember is None:
            begin_as(learner.args[0], data)
        result = pulsing("predicting", forces_under_delay, data, learner(), delay)
        say_what_is_left_out(recording, data)
    else:
        result = pulsing("predicting", forces_under_delay, data, learner(contact_floor=data.contact_floor), delay, zero)
    memory = keep(learner.args[0], learning.remember)
    floor = result.contact_floor if scored.contact_floor is None else scored.contact_floor
    scores = score_prediction(
        result.time,
        result.measured,
        result.predicted,
        result.delayed,
        contact_floor=floor,
        score_from=scored.score_from,
        score_to=scored.score_to,
        position=result.position,
        offset=zero,
        delayed_offset=0.0,
        skipped=result.skipped,
    )
    content = {
        "delay_s": delay,
        **{name: getattr(scores, name) for name in SCORES},
        **result.honesty(scores),
        **result.perception(scores),
        **({} if memory is None else {"memory": memory}),
        "status": scores.status,
        "remarks": remarks(result, scores, delay, scored.score_from),
    }
    forces = {
        "time_s": result.time,
        "measured_force_N": scores.measured_force,
        "predicted_force_N": result.predicted,
        "delayed_force_N": result.delayed,
        "in_contact": scores.in_contact,
    }
    if out is not None:
        write_columns(out, forces)
    if report_directory is not None:
        from foretouch.report import write_prediction_page

        made = made_by(
            [recording],
            dataset=source.dataset,
            law=learning.model,
            estimator=learning.estimator,
            delay=f"{delay:g} s",
            surface=learning.surface,
            force_offset=learning.force_offset,
            sensor_lag=f"{learning.sensor_lag:g} s",
            position_unit=options.position_unit,
            force_unit=options.force_unit,
            flipped=options.flip or None,
            force_flipped=options.flip_force or None,
            map=options.map_file,
            scored=scored,
            contact_floor=f"{floor:g} N",
        )
        write_prediction_page(report_directory, source.dataset or recording.name, forces, content, made)
        say(f"report: {report_directory / 'index.html'}")
    return Answer(content, _lines(f"{source.name}: {learning.title}", content))


@command()
def report(
    recording: Annotated[Path, typer.Argument(help="MCAP of a session.")], directory: ReportDirectory = None
) -> Answer:
    """Print the report of a recorded session again, and write its page.

    Example: foretouch report session.mcap --report out
    """
    from foretouch.cli.commands.sessions import report_of
    from foretouch.recordings import read_session

    return report_of(read_session(recording), recording, directory)


def _verdict(data: Recording, residual_percent: float | None) -> tuple[str, str | None]:
    """Status of an identification that has a residual, and what to try; None where there is nothing to mend."""
    from foretouch.identification.force_calibration import is_zero_unobservable
    from foretouch.recordings import falls_with_depth

    if falls_with_depth(data):
        return "falls_with_depth", (
            "the force falls where it is pressed deeper, and what was learnt is no material: give --flip-force if "
            "forces are negative under load, --flip if positions shrink with depth; in a map, sign = -1"
        )
    hint = None
    if residual_percent is not None and residual_percent > WORTHLESS:
        hint = (
            f"the law does not describe this recording: its residual is {residual_percent:.0f} % of the force in "
            "contact; check the signs of force and position (--flip-force, --flip), or try another law (--model)"
        )
    return "offset_unobservable" if is_zero_unobservable(data) else "ok", hint


def _number_or_auto(name: str, text: str) -> float | None:
    if text == "auto":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise SettingError(name, text, "must be auto or a number")
    return value


def _with_error(name: str, text: str) -> tuple[float | None, float]:
    """A number and its standard deviation, which is 0 without one."""
    value, sign, error = text.replace("+-", "±").partition("±")
    if not sign:
        return _number_or_auto(name, text), 0.0
    try:
        number, deviation = float(value), float(error)
    except ValueError:
        number = deviation = math.nan
    if not (math.isfinite(number) and 0.0 <= deviation < math.inf):
        raise SettingError(name, text, "must be auto, a number, or two as in 0.3±0.05 (or 0.3+-0.05)")
    return number, deviation


def _lines(title: str, content: dict[str, Any]) -> Iterator[str]:
    """A result as aligned lines: what is known with an error has as many digits as that allows."""
    from foretouch.quantities import in_words, measured
    from foretouch.report import IDLE_LAW, law_is_idle, map_lines
    from foretouch.report.numbers import parameter_text

    yield title
    for name, value in content.items():
        partner = name.rpartition("_")  # for instance surface_m and surface_error_m
        error = f"{partner[0]}_error_{partner[2]}"
        if name.startswith("standard_errors") or ("_error_" in name and name.replace("_error_", "_") in content):
            continue  # stands behind what it is of
        if name in ("hint", "remarks"):
            yield from (f"  {line}" for line in ([value] if isinstance(value, str) else value or ()))
            continue
        if name == "map":
            yield from (f"  {'map':<28} {line}" for line in (() if value is None else map_lines(value)))
            continue
        words, unit = in_words(name)
        if name == "parameters":
            errors, alone = content["standard_errors_with_surface"], content["standard_errors"]
            text = parameter_text(value, errors or alone)
            if alone and content["surface_error_m"] != 0.0:
                holds = "holds that of the surface too" if errors else "takes the surface for right: see surface"
                text += f"\n  {'':<28} (each ± {holds})"
            if content["map"] is not None and law_is_idle(content["map"]):
                text += f"\n  {'':<28} ({IDLE_LAW})"
        elif error in content:
            text = measured(value, content[error], unit)
            if name == "surface_m" and content[error] is None:
                text += ", where contact was noticed: this recording does not tell where it begins"
        elif value is None:
            text = "-"
        else:
            text = f"{value:.4g} {unit}" if isinstance(value, float) else str(value)
        yield f"  {words:<28} {text}"
