"""The command that compares laws and estimators."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from foretouch.cli.options import (
    Cluster,
    Flip,
    FlipForce,
    ForceChannel,
    ForceUnit,
    Json,
    PositionUnit,
    ReportDirectory,
    made_by,
    make_folder,
    print_json,
    say,
    show,
)
from foretouch.cli.progress import compile_first, progress_bar
from foretouch.cli.reading import RECORDING_HELP, MapFile, say_how_it_is_read

__all__ = ["COMMANDS", "compare"]


def compare(
    recordings: Annotated[list[Path] | None, typer.Argument(help=f"{RECORDING_HELP} Any number.")] = None,
    datasets: Annotated[
        list[str] | None,
        typer.Option("--dataset", help="One of `foretouch datasets list`; may be given more than once."),
    ] = None,
    simulated: Annotated[
        bool, typer.Option("--simulated", help="On simulated recordings too, whose truth is known.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulated recordings; everything was chosen on seed 0.")] = 0,
    models: Annotated[
        list[str] | None, typer.Option("--models", help="Contact law; may be given more than once. Without it, all.")
    ] = None,
    estimators: Annotated[
        list[str] | None, typer.Option("--estimators", help="Estimator; may be given more than once. Without it, all.")
    ] = None,
    delay: Annotated[
        list[float] | None, typer.Option(help="Of the forces [s], 0.3; may be given more than once.")
    ] = None,
    sweep: Annotated[
        bool, typer.Option("--sweep", help="At 0, 50, 100, 200, 300, 500 and 1000 ms too: error against delay.")
    ] = False,
    position_unit: PositionUnit = None,
    force_unit: ForceUnit = None,
    flip: Flip = False,
    flip_force: FlipForce = False,
    force_channel: ForceChannel = "raw",
    map_file: MapFile = None,
    score_from: Annotated[
        float | None, typer.Option(help="Scoring begins [s after the first sample]: 1.5, simulated recordings 3.")
    ] = None,
    score_to: Annotated[float | None, typer.Option(help="Scoring ends [s after the first sample].")] = None,
    contact_floor: Annotated[
        float | None,
        typer.Option(help="Least force that counts as contact [N]; TU/e 0.3, Aurora 0.005, others 0.05."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes at a time; without it, one for each core.")] = None,
    cluster: Cluster = None,
    report_directory: ReportDirectory = None,
    json_output: Json = False,
) -> None:
    """Compare contact laws and estimators on recordings: every law by every estimator that it has.

    Example: foretouch compare press.csv session.mcap --delay 0.1 --delay 0.3 --report comparison
    """
    from foretouch import comparison
    from foretouch.recordings import excerpt

    if report_directory is not None:
        make_folder(report_directory)
    units: dict[str, Any] = {
        "position_unit": position_unit,
        "force_unit": force_unit,
        "flip": flip,
        "flip_force": flip_force,
        "force_channel": force_channel,
        "map_file": map_file,
    }
    cases = []
    for path in recordings or []:
        say_how_it_is_read(path, **units)
        cases.append(comparison.file_case(path, **units))
    cases += [replace(comparison.file_case(excerpt(name), **units), name=name) for name in datasets or []]
    if simulated:
        cases += comparison.simulated_cases(seed)

    def progress(done: int, total: int, result: comparison.Result) -> None:
        failed = "" if result.status == "ok" else f"  failed: {result.reason}"
        bar.update(done, total)
        if failed or not bar.shown:
            job = f"{result.recording}: {result.model} by {result.estimator}"
            bar.say(f"{done:{len(str(total))}} of {total}  {job}{failed}")

    delays = sorted({*(delay or ()), *comparison.SWEEP}) if sweep else delay or [0.3]
    compile_first()
    with progress_bar("comparing") as bar:
        bar.pulse()
        results = comparison.compare(
            cases,
            models=models or (),
            estimators=estimators or (),
            scoring=comparison.Scoring(tuple(delays), score_from, score_to, contact_floor),
            processes=jobs,
            cluster=cluster,
            progress=progress,
            say=bar.say,
        )
    if json_output:
        print_json({"results": [result.as_row() for result in results]})
    else:
        show(comparison.render_table(results))
    if report_directory is not None:
        said = made_by(
            recordings or [],
            datasets=", ".join(datasets or []) or None,
            simulated=f"seed {seed}" if simulated else None,
            laws=", ".join(dict.fromkeys(row.model for row in results)),
            estimators=", ".join(dict.fromkeys(row.estimator for row in results)),
            delays=", ".join(f"{one:g} s" for one in delays),
            **{name: value or None for name, value in units.items()},
        )
        say(f"report: {comparison.write_comparison_page(report_directory, results, said)}")
    if all(result.status != "ok" for result in results):
        raise typer.Exit(1)


COMMANDS = (compare,)
