"""Commands that work on recordings."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.commands.recordings import say_what_is_left_out
from foretouch.cli.options import (
    EstimatorName,
    Flip,
    FlipForce,
    ForceChannel,
    ForceOffset,
    ForceUnit,
    Json,
    ModelName,
    PositionUnit,
    ReportDirectory,
    SensorLag,
    Surface,
    made_by,
    make_folder,
    print_json,
    say,
    show,
)
from foretouch.cli.progress import compile_first, pulsing
from foretouch.cli.reading import RECORDING_HELP, DatasetName, MapFile, chosen_recording, read_and_say
from foretouch.errors import SettingError, plural

if TYPE_CHECKING:
    from foretouch.identification import Identification, Learner
    from foretouch.quantities import Recording

WORTHLESS = 50.0
"""Residual from which on a law is said not to describe a recording [% of the force in contact]."""

RecordingPath = Annotated[Path | None, typer.Argument(help=RECORDING_HELP)]


def identify(
    recording: RecordingPath = None,
    dataset: DatasetName = None,
    model: ModelName = "contact-map",
    estimator: EstimatorName = None,
    surface: Surface = "auto",
    force_offset: ForceOffset = "auto",
    sensor_lag: SensorLag = 0.0,
    sensor: Annotated[
        Path | None, typer.Option(help="TOML of `foretouch calibrate`: offset, lag and compliance are corrected.")
    ] = None,
    position_unit: PositionUnit = None,
    force_unit: ForceUnit = None,
    flip: Flip = False,
    flip_force: FlipForce = False,
    force_channel: ForceChannel = "raw",
    map_file: MapFile = None,
    out: Annotated[Path | None, typer.Option(help="CSV or Parquet file for the parameters at every sample.")] = None,
    json_output: Json = False,
) -> None:
    """Identify a contact model from a recording, sample by sample.

    Example: foretouch identify press.csv --position-unit mm --json
    """
    from foretouch import identification
    from foretouch.recordings import write_columns

    recording, shown = chosen_recording(recording, dataset)
    _refuse_to_replace(recording, out)
    estimator = _estimator_for(model, estimator)
    data = read_and_say(
        recording,
        position_unit=position_unit,
        force_unit=force_unit,
        flip=flip,
        flip_force=flip_force,
        force_channel=force_channel,
        map_file=map_file,
    )
    if map_file is None:
        say_what_is_left_out(recording)
    if sensor is not None:
        data, force_offset, sensor_lag = _at_the_contact(data, sensor, force_offset, sensor_lag)
    compile_first()
    learner = _learner(model, estimator, surface, force_offset, sensor_lag)
    result = pulsing(
        f"identifying from {plural(len(data), 'sample')}",
        identification.identify,
        data,
        learner(contact_floor=data.contact_floor),
        keep_history=out is not None,
    )
    residual, contact = result.residual_rms, result.contact_force_rms
    percent = _finite(100.0 * residual / contact) if contact > 0.0 else None
    content = {
        "model": model,
        "estimator": estimator,
        "parameters": result.parameters,
        "map": _map_of(result),
        "standard_errors": result.standard_errors,
        "standard_errors_with_surface": result.standard_errors_with_surface,
        "surface_m": result.surface,
        "surface_error_m": _finite(result.surface_error),
        "force_offset_N": result.force_offset,
        "sensor_lag_s": result.sensor_lag,
        "sensor_lag_error_s": result.sensor_lag_error,
        "samples": len(data),
        "contact_samples": int(result.in_contact.sum()),
        "residual_rms_N": _finite(residual),
        "residual_percent": percent,
        "status": _identified(data) if math.isfinite(residual) else "no_residual",
        "hint": _hint(data, percent),
    }
    if out is not None:
        write_columns(out, {"time_s": data.time, "in_contact": result.in_contact, **result.history})
    if json_output:
        print_json(content)
    else:
        _print_lines(f"{shown}: {model} by {estimator}", content)


def predict(
    recording: RecordingPath = None,
    dataset: DatasetName = None,
    delay: Annotated[float, typer.Option(help="Of the forces [s].")] = 0.3,
    model: ModelName = "contact-map",
    estimator: EstimatorName = None,
    surface: Surface = "auto",
    force_offset: ForceOffset = "auto",
    sensor_lag: SensorLag = 0.0,
    position_unit: PositionUnit = None,
    force_unit: ForceUnit = None,
    flip: Flip = False,
    flip_force: FlipForce = False,
    force_channel: ForceChannel = "raw",
    map_file: MapFile = None,
    score_from: Annotated[float, typer.Option(help="Scoring begins [s after the first sample].")] = 1.5,
    score_to: Annotated[float | None, typer.Option(help="Scoring ends [s after the first sample].")] = None,
    contact_floor: Annotated[
        float | None,
        typer.Option(help="Least force that counts as contact [N]; TU/e 0.3, Aurora 0.005, others 0.05."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="CSV or Parquet file for the forces.")] = None,
    report_directory: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """Predict the force of a recorded motion as a leader would, whose forces arrive late.

    Example: foretouch predict press.csv --delay 0.3 --json
    """
    from foretouch.errors.checks import require
    from foretouch.recordings import is_session, read_session, write_columns
    from foretouch.report import forces_under_delay, remarks, score

    require("delay", delay, at_least=0.0)
    recording, shown = chosen_recording(recording, dataset)
    _refuse_to_replace(recording, out)
    if report_directory is not None:
        make_folder(report_directory)
    estimator = _estimator_for(model, estimator)
    compile_first()
    learner = _learner(model, estimator, surface, force_offset, sensor_lag)
    log = None
    if map_file is None and is_session(recording):
        log = read_session(recording)
        found = pulsing("predicting", forces_under_delay, log, learner(), delay)
    else:
        data = read_and_say(
            recording,
            position_unit=position_unit,
            force_unit=force_unit,
            flip=flip,
            flip_force=flip_force,
            force_channel=force_channel,
            map_file=map_file,
        )
        found = pulsing("predicting", forces_under_delay, data, learner(contact_floor=data.contact_floor), delay)
    if log is not None:
        say_what_is_left_out(recording, log)
    floor = found.contact_floor if contact_floor is None else contact_floor
    scores = score(
        found.time,
        found.measured,
        found.predicted,
        found.delayed,
        contact_floor=floor,
        score_from=score_from,
        score_to=score_to,
        position=found.position,
        delayed_offset=0.0,
        skipped=found.skipped,
    )
    names = (
        "samples",
        "scored_samples",
        "contact_force_rms_N",
        "prediction_rmse_N",
        "prediction_error_percent",
        "delayed_force_error_percent",
        "within_jnd_percent",
        "phantom_force_rms_N",
        "missed_contact_percent",
    )
    content = {
        "delay_s": delay,
        **{name: getattr(scores, name) for name in names},
        **found.perception(scores),
        "status": scores.status,
        "remarks": remarks(found, scores, delay, score_from),
    }
    forces = {
        "time_s": found.time,
        "measured_force_N": scores.measured_force,
        "predicted_force_N": found.predicted,
        "delayed_force_N": found.delayed,
        "in_contact": scores.in_contact,
    }
    if out is not None:
        write_columns(out, forces)
    if report_directory is not None:
        from foretouch.report import write_prediction_page

        made = made_by(
            [recording],
            dataset=dataset,
            law=model,
            estimator=estimator,
            delay=f"{delay:g} s",
            surface=surface,
            force_offset=force_offset,
            sensor_lag=f"{sensor_lag:g} s",
            position_unit=position_unit,
            force_unit=force_unit,
            flipped=flip or None,
            force_flipped=flip_force or None,
            map=map_file,
            scored=f"from {score_from:g} s" + (f" to {score_to:g} s" if score_to is not None else ""),
            contact_floor=f"{floor:g} N",
        )
        write_prediction_page(report_directory, dataset or recording.name, forces, content, made)
        say(f"report: {report_directory / 'index.html'}")
    if json_output:
        print_json(content)
    else:
        _print_lines(f"{shown}: {model} by {estimator}", content)


def report(
    recording: Annotated[Path, typer.Argument(help="MCAP of a session.")],
    directory: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """Print the report of a recorded session again, and write its page.

    Example: foretouch report session.mcap --report out
    """
    from foretouch.cli.commands.sessions import print_report
    from foretouch.recordings import read_session

    print_report(read_session(recording), recording, directory, json_output)


def _estimator_for(model: str, estimator: str | None) -> str:
    """The estimator that was named, or the law's own."""
    from foretouch.identification import default_estimator

    return default_estimator(model) if estimator is None else estimator


def _learner(model: str, estimator: str, surface: str, force_offset: str, sensor_lag: float) -> Callable[..., Learner]:
    """Makes the learner that the options ask for, once the recording's contact floor is known."""
    from foretouch import identification
    from foretouch.errors.checks import require
    from foretouch.identification.conditioning.conditioner import LONGEST_LAG

    require("sensor_lag", sensor_lag, at_least=0.0, at_most=LONGEST_LAG)
    return functools.partial(
        identification.Learner,
        identification.make_estimator(model, estimator),
        surface=_number_or_auto("surface", surface),
        force_offset=_number_or_auto("force-offset", force_offset),
        sensor_lag=sensor_lag,
    )


def _at_the_contact(data: Recording, path: Path, force_offset: str, sensor_lag: float) -> tuple[Recording, str, float]:
    """The recording as its sensor's calibration corrects it, its force in free air and the sensor's lag."""
    from foretouch.identification import correct_recording
    from foretouch.recordings import read_calibration

    calibration = read_calibration(path)
    known = calibration.force_offset
    if known is not None and force_offset != "auto":
        raise SettingError("force-offset", force_offset, f"{path} has it too: give one of them")
    if calibration.sensor_lag is not None and sensor_lag != 0.0:
        raise SettingError("sensor-lag", sensor_lag, f"{path} has it too: give one of them")
    given = _number_or_auto("force-offset", force_offset)
    data = correct_recording(data, calibration, force_offset=given)
    return data, force_offset if known is None else repr(known), calibration.sensor_lag or sensor_lag


def _map_of(result: Identification) -> dict[str, object] | None:
    """A contact map in a few numbers, None for other models."""
    from foretouch.models import ContactMap, summarise_map

    if not isinstance(result.model, ContactMap):
        return None
    return summarise_map(result.model).figures(result.standard_deviation)


def _identified(data: Recording) -> str:
    """Status of an identification: whether the recording's signs can be right, and its force has a zero to be known."""
    from foretouch.identification.force_calibration import is_zero_unobservable
    from foretouch.recordings import falls_with_depth

    if falls_with_depth(data):
        return "falls_with_depth"
    return "offset_unobservable" if is_zero_unobservable(data) else "ok"


def _hint(data: Recording, residual_percent: float | None) -> str | None:
    """What to try where a sign is wrong, or the law describes next to nothing of a recording; None elsewhere."""
    from foretouch.recordings import falls_with_depth

    if falls_with_depth(data):
        return (
            "the force falls where it is pressed deeper, and what was learnt is no material: give --flip-force if "
            "forces are negative under load, --flip if positions shrink with depth; in a map, sign = -1"
        )
    if residual_percent is None or residual_percent <= WORTHLESS:
        return None
    return (
        f"the law does not describe this recording: its residual is {residual_percent:.0f} % of the force in contact; "
        "check the signs of force and position (--flip-force, --flip), or try another law (--model)"
    )


def _refuse_to_replace(recording: Path, out: Path | None) -> None:
    """Results never take the place of what they come from."""
    if out is not None and out.resolve() == recording.resolve():
        raise SettingError("out", str(out), "is the recording itself: name another file")


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


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _print_lines(title: str, content: dict[str, Any]) -> None:
    """A result as aligned lines: what is known with an error has as many digits as that allows."""
    from foretouch.quantities import measured
    from foretouch.report import IDLE_LAW, law_is_idle
    from foretouch.report.numbers import parameter_text

    show(title)
    for name, value in content.items():
        partner = name.rpartition("_")  # surface_m and surface_error_m, say
        error = f"{partner[0]}_error_{partner[2]}"
        if name.startswith("standard_errors") or ("_error_" in name and name.replace("_error_", "_") in content):
            continue  # stands behind what it is of
        if name == "hint":
            if value is not None:
                show(f"  {value}")
            continue
        if name == "remarks":
            show("".join(f"  {remark}\n" for remark in value), end=False)
            continue
        if name == "map":
            _print_map(value)
            continue
        if name == "parameters":
            errors, alone = content["standard_errors_with_surface"], content["standard_errors"]
            text = parameter_text(value, errors or alone)
            if alone and content["surface_error_m"]:
                holds = "holds that of the surface too" if errors else "takes the surface for right: see surface_m"
                text += f"\n  {'':<28} (each ± {holds})"
            if content["map"] is not None and law_is_idle(content["map"]):
                text += f"\n  {'':<28} ({IDLE_LAW})"
        elif error in content:
            text = measured(value, content[error])
        elif isinstance(value, float):
            text = f"{value:.6g}"
        else:
            text = "-" if value is None else str(value)
        show(f"  {name:<28} {text}")


def _print_map(figures: dict[str, Any] | None) -> None:
    """A contact map as aligned lines, nothing for other models."""
    from foretouch.report import map_lines

    for line in () if figures is None else map_lines(figures):
        show(f"  {'map':<28} {line}")
