"""Commands that calibrate a force sensor and what it is mounted on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from foretouch.cli.options import Answer, ReportDirectory, command, made_by, require_elsewhere, require_folder, say
from foretouch.cli.reading import read_and_say, recording_options
from foretouch.errors import SettingError, plural

if TYPE_CHECKING:
    from foretouch.identification import ToolLoadFit
    from foretouch.quantities import SensorCalibration
    from foretouch.recordings import RecordingOptions

calibrate = typer.Typer(help="Force sensor, tool and what gives way behind them.", no_args_is_help=True)

Output = Annotated[
    Path | None, typer.Option("--output", help="TOML file of the calibration; what it has of other kinds stays.")
]


@calibrate.command("sensor")
@command(options=recording_options)
def sensor(
    *,
    poses: Annotated[Path, typer.Argument(help="CSV of static poses: wrench and orientation, a row a measurement.")],
    output: Output = None,
    motion: Annotated[
        Path | None, typer.Option(help="Recording of presses or taps on a spring or a block, for the sensor's lag.")
    ] = None,
    axis: Annotated[str, typer.Option(help="X,Y,Z: along which the probe approaches, in the sensor's frame.")] = (
        "0,0,1"
    ),
    approach_gravity: Annotated[
        float, typer.Option(help="Gravity along the approach [m/s^2]; 0 where the probe approaches sideways.")
    ] = 9.80665,
    options: RecordingOptions,
    report_directory: ReportDirectory = None,
    figure: Annotated[Path | None, typer.Option(help="PNG of the residuals, pose by pose.")] = None,
) -> Answer:
    """Estimate force bias, tool mass and centre of mass from six or more static poses, and the sensor's lag.

    A pose in which the tool touched something is left out and named; a sensor that is turned, or whose signs are wrong,
    is found and said; so is another frame than that of the flange.

    Units and direction are those of the recording of `--motion`.

    Example: foretouch calibrate sensor poses.csv --output sensor.toml
    """
    import msgspec

    from foretouch.identification import check_orientations, find_sensor_lag, fit_tool_load
    from foretouch.recordings import read_poses

    direction = _unit_vector(axis)
    before = _before(output, poses, motion)
    _before_figure(figure, output, poses, motion)
    require_folder(report_directory)
    measured = read_poses(poses)
    if measured.orientation is not None:
        check_orientations(measured.orientation, measured.force)
    fit = fit_tool_load(measured.gravity, measured.force, measured.torque)
    weight, frame = fit.weight, fit.frame
    left_out = ", ".join(measured.names[number] for number in fit.left_out)
    for sentence in _sentences(fit, left_out):
        say(f"{poses}: {sentence}")
    kinds = ("force_bias", "torque_bias", "centre_of_mass")
    values: dict[str, Any] = {
        **{name: _triple(getattr(weight, name)) for kind in kinds for name in (kind, f"{kind}_error")},
        "force_noise": measured.force_noise,
        "torque_noise": measured.torque_noise,
        "tool_mass": weight.mass,
        "tool_mass_error": weight.mass_error,
        "sensor_turn": None if frame is None else _triple(frame.turn),
        "sensor_turn_error": None if frame is None else _triple(frame.turn_error),
        "approach_axis": direction,
        "approach_gravity": approach_gravity,
    }
    if motion is not None:
        recording = read_and_say(motion, options)
        values["sensor_lag"], values["sensor_lag_error"] = find_sensor_lag(recording)
    calibration = msgspec.structs.replace(before, **values)
    content = {
        **{f"{name}_{unit}": getattr(calibration, name) for name, unit in WEIGHT_UNITS.items()},
        "free_air_force_N": calibration.force_offset,
        "sensor_lag_s": calibration.sensor_lag,
        "sensor_lag_error_s": calibration.sensor_lag_error,
        "sensor_turn_deg": None if frame is None else _triple(frame.turn * 180.0 / math.pi),
        "sensor_turn_error_deg": None if frame is None else _triple(frame.turn_error * 180.0 / math.pi),
        "poses": weight.poses,
        "poses_left_out": left_out or None,
        "condition": fit.condition,
        "gravity_spread": _triple(weight.spread),
        "force_residual_rms_N": _rms(weight.force_residual),
        "force_residual_largest_N": float(abs(weight.force_residual).max()),
        "torque_residual_rms_Nm": None if weight.torque_residual is None else _rms(weight.torque_residual),
    }
    made = made_by([poses] if motion is None else [poses, motion], axis=axis)
    names = [name for number, name in enumerate(measured.names) if number not in fit.left_out]
    if figure is not None:
        from foretouch.report import write_weight_figure

        say(f"figure: {write_weight_figure(figure, weight, names)}")
    _write(output, calibration, report_directory, poses.name, weight, content, made, names)
    return Answer(content, _lines(f"{poses}: {plural(weight.poses, 'pose')}", content))


@calibrate.command("compliance")
@command(options=recording_options)
def compliance(
    *,
    recording: Annotated[Path, typer.Argument(help="Recording of presses on a rigid block.")],
    output: Output = None,
    options: RecordingOptions,
    report_directory: ReportDirectory = None,
) -> Answer:
    """Estimate the series stiffness of arm, sensor and tip, and the lost motion, from presses on a rigid block.

    A sensor lag that the output file already has is taken into account.

    Example: foretouch calibrate compliance block.csv --output sensor.toml
    """
    import msgspec

    from foretouch.identification import fit_series_compliance

    before = _before(output, recording)
    require_folder(report_directory)
    data = read_and_say(recording, options)
    result = fit_series_compliance(data, sensor_lag=before.sensor_lag or 0.0)
    calibration = msgspec.structs.replace(
        before,
        series_stiffness=result.stiffness,
        series_stiffness_error=result.stiffness_error,
        lost_motion=result.lost_motion,
    )
    content = {
        "series_stiffness_N_per_m": result.stiffness,
        "series_stiffness_error_N_per_m": result.stiffness_error,
        "lost_motion_m": result.lost_motion,
        "lost_motion_error_m": result.lost_motion_error,
        "force_offset_N": result.force_offset,
        "from_force_N": result.contact_floor,
        "to_force_N": float(result.force.max()),
        "residual_rms_m": _rms(result.residual),
    }
    made = made_by([recording], sensor_lag=f"{before.sensor_lag or 0.0:g} s")
    _write(output, calibration, report_directory, recording.name, result, content, made)
    return Answer(content, _lines(f"{recording}: {plural(result.force.size, 'sample')}", content))


def _before(output: Path | None, *read: Path | None) -> SensorCalibration:
    """What the output file already holds; refused where it is what is read, or could not be written."""
    from foretouch.quantities import SensorCalibration
    from foretouch.recordings import read_calibration

    if output is None:
        return SensorCalibration()
    if output.suffix.lower() != ".toml":
        raise SettingError("output", str(output), "must end with .toml")
    require_elsewhere(output, *read, name="output", why="is what is read")
    return read_calibration(output) if output.exists() else SensorCalibration()


def _before_figure(figure: Path | None, *others: Path | None) -> None:
    """Refuse a picture that would be none, or that would overwrite what is read or written."""
    if figure is None:
        return
    if figure.suffix.lower() != ".png":
        raise SettingError("figure", str(figure), "must end with .png")
    require_elsewhere(figure, *others, name="figure", why="is what is read or written")


def _unit_vector(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        x = y = z = math.nan
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        raise SettingError("axis", text, "must be X,Y,Z, three numbers that are not all 0; for example 0,0,1")
    return x / length, y / length, z / length


def _triple(values: Any) -> tuple[float, ...] | None:
    return None if values is None else tuple(float(value) for value in values)


WEIGHT_UNITS = {
    **dict.fromkeys(("force_bias", "force_bias_error", "force_noise"), "N"),
    **dict.fromkeys(("tool_mass", "tool_mass_error"), "kg"),
    **dict.fromkeys(("torque_bias", "torque_bias_error", "torque_noise"), "Nm"),
    **dict.fromkeys(("centre_of_mass", "centre_of_mass_error"), "m"),
}
"""Units of what is printed of a calibration, by field of `SensorCalibration`."""


def _sentences(fit: ToolLoadFit, left_out: str) -> Iterator[str]:
    """What is to be said of a fit before its numbers: a pose that was left out, and how the sensor stands."""
    if left_out:
        yield f"left out, as the others do not explain it: {plural(len(fit.left_out), 'pose')} ({left_out})"
    if fit.frame is None:
        yield "the sensor's frame stays open: turn the tool about a second axis, so that gravity pulls along all three"
    elif fit.frame.is_turned:
        yield fit.frame.sentence
    if fit.is_behind:
        yield (
            "the centre of mass lies behind the sensor, along -z of the flange: the sign of the torques is wrong, "
            "unless that axis points into the arm"
        )


def _rms(residual: Any) -> float:
    return math.sqrt((residual**2).mean())


def _write(output: Path | None, calibration: SensorCalibration, directory: Path | None, *page: Any) -> None:
    from foretouch.recordings import write_calibration

    if output is not None:
        write_calibration(output, calibration)
        say(f"calibration: {output}")
    if directory is not None:
        from foretouch.report import write_calibration_page

        say(f"report: {write_calibration_page(directory, *page)}")


def _lines(title: str, content: dict[str, Any]) -> Iterator[str]:
    yield title
    for name, value in content.items():
        values = value if isinstance(value, tuple) else (value,)
        shown = ", ".join("-" if part is None else part if isinstance(part, str) else f"{part:.5g}" for part in values)
        yield f"  {name:<32} {shown}"
