"""Commands about recordings of sessions, measured files and materials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from foretouch.cli.options import Answer, command, require_recording, require_writable, say
from foretouch.cli.progress import progress_bar, pulsing
from foretouch.cli.reading import RECORDING_HELP, read_and_say, recording_options, say_what_is_left_out
from foretouch.errors import RecordingError, SettingError, UnknownNameError, plural, printable

if TYPE_CHECKING:
    from foretouch.recordings import Contents, RecordingOptions


datasets = typer.Typer(help="Measured recordings: what is here, and fetching the originals.", no_args_is_help=True)
materials = typer.Typer(help="What the simulated follower can press.", no_args_is_help=True)


@datasets.command("list")
@command()
def list_datasets() -> Answer:
    """The measured recordings, and whose they are; time, position and force of all of them are here.

    Example: foretouch datasets list
    """
    from foretouch import recordings

    entries = recordings.list_datasets()
    content = {
        entry.name: {
            "kind": entry.kind,
            "licence": entry.origin.licence,
            "url": entry.url,
            "excerpt": str(recordings.excerpt(entry.name)),
            "seen": entry.seen,
        }
        for entry in entries
    }
    lines = (f"{entry.name:<20} {entry.kind:<8} {entry.file:<34} {entry.origin.licence}" for entry in entries)
    return Answer(content, lines)


@datasets.command("fetch")
@command()
def fetch_dataset(
    name: Annotated[str, typer.Argument(help="A name from `foretouch datasets list`, or all.")],
) -> Answer:
    """Make the originals of measured recordings available here, with all that they hold, and print where they lie.

    They come from the folder that FORETOUCH_DATA_DIR names, from the cache, or from their public origin.

    Example: foretouch datasets fetch tue/b-foam
    """
    from foretouch import recordings

    names = [entry.name for entry in recordings.list_datasets()] if name == "all" else [name]
    paths: dict[str, str] = {}
    with progress_bar(f"fetching {name}") as bar:
        bar.pulse()
        for done, each in enumerate(names):
            bar.update(done, len(names), f"fetching {each}")
            paths[each] = str(recordings.fetch_dataset(each))
    return Answer({"files": paths}, paths.values())


@materials.command("list")
@command()
def list_materials() -> Answer:
    """The materials, and where their numbers come from.

    Example: foretouch materials list
    """
    from foretouch.plugins import PluginError, plugin_names
    from foretouch.robot import MATERIALS, make_material

    entries = {name: make_material(name) for name in MATERIALS}
    for name in plugin_names("material"):
        try:
            entries.setdefault(name, make_material(name))
        except PluginError as error:
            say(f"left out: {error}")
    content = {
        name: {"description": one.description, "provenance": one.provenance, "press_depth_m": one.press_depth}
        for name, one in entries.items()
    }
    lines = (f"{name:<19} to {1e3 * one.press_depth:4.1f} mm   {one.description}" for name, one in entries.items())
    return Answer(content, lines)


@materials.command("fit")
@command()
def fit_material(
    name: Annotated[str, typer.Argument(help="foam-measured: the material that comes from measured files.")],
    out: Annotated[Path | None, typer.Option(help="JSON file for the coefficients.")] = None,
) -> Answer:
    """Fit a measured material again from its recordings, and print how well the law describes each.

    Example: foretouch materials fit foam-measured --out foam.json
    """
    from foretouch.errors import UnknownNameError
    from foretouch.recordings import atomic_path, excerpt, read_recording
    from foretouch.robot import FOAM_DATASETS, fit_foam, foam_fit_json

    if name != "foam-measured":
        raise UnknownNameError("fitted material", name, ["foam-measured"])
    pressed = [replace(read_recording(excerpt(dataset)), name=dataset) for dataset in FOAM_DATASETS]
    fit = pulsing("fitting", fit_foam, pressed)
    if out is not None:
        require_writable(out.parent)
        with atomic_path(out) as part:
            part.write_bytes(foam_fit_json(fit))
    lines = (f"{one.name:<16} residual {one.residual_percent:5.1f} % of the contact-force RMS" for one in fit.files)
    return Answer({one.name: {"residual_percent": one.residual_percent} for one in fit.files}, lines)


MOST_SHOWN = 40  # Topics or columns that are shown unless all are asked for

recordings = typer.Typer(
    help="Recordings: what is in them, other formats, making whole what was cut.", no_args_is_help=True
)


@recordings.command("repair")
@command()
def repair(
    path: Annotated[Path, typer.Argument(metavar="FILE", help="MCAP of a session.")],
    output: Annotated[
        Path | None, typer.Option("--output", help="Where the whole recording goes; without it, in FILE's place.")
    ] = None,
) -> Answer:
    """Make a recording whole whose recorder was killed, or whose disk was full, and say what it holds.

    Every block that can be read stays as it is, byte by byte; the index is written anew.

    Example: foretouch recordings repair session.mcap
    """
    from foretouch.recordings import repair_session

    require_recording(output)
    result = repair_session(path, output)
    damaged = result.damaged_blocks
    left_out = f"{damaged} damaged blocks left out" if damaged else "no block was damaged"
    first = f"{result.bytes_cut} bytes cut behind the last whole block; {left_out}"
    if result.was_whole:
        first = "is whole"
    held = ", ".join(f"{count} {topic}" for topic, count in result.messages.items())
    second = f"{result.path}: holds {result.duration:.3f} s in {result.bytes_kept} bytes: {held}"
    return Answer(asdict(result) | {"path": str(result.path)}, [f"{path}: {first}", second])


@recordings.command("inspect")
@command()
def inspect(
    path: Annotated[Path, typer.Argument(metavar="FILE", help=RECORDING_HELP)],
    save: Annotated[
        Path | None, typer.Option("--save", help="TOML file for the guessed map, to be completed and given with --map.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Let --save replace a file that says something else.")
    ] = False,
    topic: Annotated[str | None, typer.Option("--topic", help="Show the fields of this topic's messages.")] = None,
    show_all: Annotated[bool, typer.Option("--all", help=f"Show all topics, not the first {MOST_SHOWN}.")] = False,
) -> Answer:
    """Show what a recording holds, topics or columns, and the map that can be guessed.

    Example: foretouch recordings inspect press.csv --save map.toml
    """
    from foretouch.recordings import atomic_path, inspect_recording

    if save is not None:
        _require_elsewhere("save", save, path)
        if save.suffix.lower() != ".toml":
            raise SettingError("save", str(save), "must end with .toml")
    result = pulsing(f"looking into {path.name}", inspect_recording, path, topic)
    if save is not None:
        if result.guess is None:
            raise SettingError("save", str(save), f"{path} is {result.stated}")
        text = result.guess.text()
        if save.is_file() and not overwrite and save.read_text(encoding="utf-8", errors="replace") != text:
            completed = "says something else already: name another file, or give --overwrite"  # perhaps by hand
            raise SettingError("save", str(save), completed)
        with atomic_path(save) as part:
            part.write_text(text, encoding="utf-8")
        say(f"map: {save}")
    return Answer(result.as_json(), _lines(result, topic, show_all))


@dataclass(frozen=True)
class AsLerobot:
    """What is said of a LeRobot dataset; nothing of it is for another format."""

    to: Annotated[
        str | None, typer.Option("--to", help="lerobot: a LeRobotDataset, each recording an episode of it.")
    ] = None
    output: Annotated[Path | None, typer.Option("--output", help="Its folder, which must not be there.")] = None
    fps: Annotated[int | None, typer.Option("--fps", help="Its frames a second: 30.")] = None
    task: Annotated[str | None, typer.Option("--task", help="What is done in it, in words for policies.")] = None

    def check(self) -> None:
        """A SettingError or UnknownNameError where one option contradicts another."""
        if self.to is None:
            for name, value in (("output", self.output), ("fps", self.fps), ("task", self.task)):
                if value is not None:
                    raise SettingError(name, str(value), "is for --to lerobot alone: leave it out")
        elif self.to != "lerobot":
            raise UnknownNameError("format", self.to, ["lerobot"])
        elif self.output is None:
            raise SettingError("output", "nothing", "name the folder of the dataset: --output DIR")


@recordings.command("convert")
@command(options=recording_options, dataset=AsLerobot)
def convert(
    *,
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help=f"A recording, {RECORDING_HELP[:-1]}, and the file to write, which ends with .mcap, .parquet or .csv; "
            "with --to lerobot recordings alone.",
        ),
    ],
    options: RecordingOptions,
    dataset: AsLerobot,
) -> Answer:
    """Write position and force of a recording in another format, in SI units, or recordings as a LeRobot dataset.

    Example: foretouch recordings convert press.csv press.mcap
    """
    dataset.check()
    if dataset.output is not None:
        return _as_lerobot(paths, options, dataset, dataset.output)
    if len(paths) != 2:
        given = " ".join(map(str, paths[1:])) or "nothing"
        raise SettingError("OUT", given, "give one recording, and behind it one file to write")
    path, written = paths
    return _as_file(path, written, options)


def _as_file(path: Path, output: Path, options: RecordingOptions) -> Answer:
    from foretouch.recordings import OUTPUTS, write_recording

    if output.suffix.lower() not in OUTPUTS:
        raise RecordingError(output, f"cannot be written: its name must end with one of {', '.join(OUTPUTS)}")
    _require_elsewhere("OUT", output, path)
    recording = read_and_say(path, options)
    for note in pulsing(f"writing {output.name}", write_recording, output, recording):
        say(f"{output}: {note}")
    seconds = float(recording.time[-1] - recording.time[0])
    content = {"path": str(output), "samples": len(recording), "duration_s": seconds}
    content["velocity"] = recording.velocity is not None
    return Answer(content, f"{output}: {plural(len(recording), 'sample')} in {seconds:.3f} s")


def _as_lerobot(paths: Sequence[Path], options: RecordingOptions, asked: AsLerobot, output: Path) -> Answer:
    from foretouch.recordings import Episode, read_episode, write_lerobot

    fps = 30 if asked.fps is None else asked.fps
    task = {} if asked.task is None else {"task": asked.task}
    notes: list[str] = []

    def episodes() -> Iterator[Episode]:
        for path in paths:
            episode = read_episode(path, options, fps=fps)
            notes.extend(f"{path}: {note}" for note in episode.notes)
            yield episode

    for path in paths:
        _require_elsewhere("output", output, path)
    require_writable(output.resolve().parent)
    written = pulsing(f"writing {output.name}", partial(write_lerobot, output, episodes(), **task))
    for note in notes:
        say(note)
    for path in paths:
        say_what_is_left_out(path)
    content = asdict(written) | {"path": str(output), "features": list(written.features)}
    made = f"{plural(written.episodes, 'episode')}, {plural(written.frames, 'frame')}, {written.fps} a second"
    return Answer(content, f"{output}: {made}")


def _require_elsewhere(name: str, output: Path, path: Path) -> None:
    """Refuse an output that is the recording, or stands in its folder where that is a bag."""
    written, read = output.resolve(), path.resolve()
    if written == read or (read.is_dir() and read in written.parents):
        raise SettingError(name, str(output), "is the recording itself, or within it: name another file")


def _lines(result: Contents, topic: str | None, show_all: bool) -> Iterator[str]:
    span = "" if result.duration_s is None else f", {result.duration_s:.3f} s"
    rate = "" if result.rate is None else f", {result.rate:.5g} samples a second"
    begin = "" if not result.begin_ns else f", from {_date(result.begin_ns)}"
    what = plural(len(result.topics), "topic") if result.topics else plural(len(result.columns), "column")
    yield f"{result.path}: {result.format}, {what}{span}{rate}{begin}"
    beside_the_map = () if result.guess is None else result.guess.notes
    yield from (f"  {note}" for note in result.notes if note not in beside_the_map)
    most = None if show_all else MOST_SHOWN
    topics, columns = result.topics[:most], result.columns[:most]
    if topics:
        rows = [(one.name, one.type_name, str(one.count), _cell(result.rate_of(one), ".5g", " /s")) for one in topics]
        yield from _table(("topic", "type", "messages", "rate"), rows)
    if left := len(result.topics) - len(topics):
        yield f"  ... and {plural(left, 'topic')} more: --all shows them, --topic NAME its fields"
    if columns:
        cells = [(one.name, one.kind, _cell(one.count, "d")) for one in columns]
        title: tuple[str, ...] = ("column", "type", "values", "unit")
        more: list[tuple[str, ...]] = [(one.unit,) for one in columns]
        if topic is not None:
            title = ("field", "type", "messages", "first", "smallest", "largest")
            ranges = ((one.example, one.smallest, one.largest) for one in columns)
            more = [tuple(_cell(value, ".6g") for value in three) for three in ranges]
        yield from _table(title, [(*cell, *others) for cell, others in zip(cells, more, strict=True)])
    if left := len(result.columns) - len(columns):
        yield f"  ... and {left} more: --all shows them"
    if result.stated:
        yield f"  {result.stated}"
    elif result.guess is not None:
        whole = "the map as guessed" if not result.guess.open else "the map as far as it can be guessed"
        yield f"\n# {whole}: --save FILE.toml writes it, --map FILE.toml reads by it"
        yield result.guess.text().removesuffix("\n")


def _table(title: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Columns as wide as they must be; an empty last one leaves no blanks."""
    rows = [title, *(tuple(map(printable, row)) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  " + "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()


def _cell(value: float | None, form: str, unit: str = "") -> str:
    return "" if value is None else f"{value:{form}}{unit}"


def _date(time_ns: int) -> str:
    """A log time as a date where it is one, else as seconds: some clocks begin when their machine did."""
    seconds = time_ns / 1e9
    if not 3e8 < seconds < 4e9:
        return f"{seconds:.3f} s"
    return datetime.fromtimestamp(seconds, tz=UTC).isoformat(timespec="milliseconds")
