"""The folder that a program of C or C++ is built against."""

from __future__ import annotations

import importlib.metadata
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from foretouch.errors import SettingError
from foretouch.export.header import header
from foretouch.export.lowering import Lowered, lowered
from foretouch.export.targets import Target
from foretouch.export.wire import sources
from foretouch.identification import SENSOR_SENTENCES, ContactMap
from foretouch.models import ContactMapModel
from foretouch.models.law_kernel import LAW_NAMES

TEMPLATES = Path(__file__).with_name("c")
"""What is written by hand: it is copied as it is, but for the words in `_words`."""

PLACES = {".h": "include", ".hpp": "include", ".c": "src", ".txt": ""}
"""Folder of the package for each ending."""

OBJECT = "lib/foretouch_kernels.o"


def write_package(out: Path, target: Target, lower: Callable[[Target], list[Lowered]] = lowered) -> list[str]:
    """Write the package; nothing is left of one that could not be written whole.

    Args:
        out: A folder that is not there yet, is empty, or holds such a package, which is replaced.
        target: What the code is for.
        lower: Makes the code.

    Returns:
        Its files.

    Raises:
        SettingError: The folder cannot be that.
        ForetouchError: The kernels cannot be compiled for the target.
    """
    require_place(out)
    (made,), version = lower(target), importlib.metadata.version("foretouch")
    try:
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.resolve().parent) as beside:
            new = Path(beside, "new")
            _fill(new, target, version, made)
            new.chmod(0o755)
            if out.exists():
                out.rename(Path(beside, "old"))
            new.rename(out)
    except OSError as error:
        raise SettingError("out", str(out), f"cannot be written: {error.strerror or error}") from None
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


def require_place(out: Path) -> None:
    """Refuse a folder that a package cannot be written to, before anything is compiled."""
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise SettingError("out", str(out), "is there and is no folder: name another")
    try:
        if out.exists() and any(out.iterdir()) and not Path(out, OBJECT).is_file():
            raise SettingError("out", str(out), "holds something else than such a package: name another folder")
        with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.resolve().parent):
            pass
    except FileNotFoundError:
        raise SettingError("out", str(out), f"there is no folder {out.resolve().parent}: make it first") from None
    except OSError as error:
        raise SettingError("out", str(out), f"cannot be written: {error.strerror or error}") from None


def _fill(folder: Path, target: Target, version: str, made: Lowered) -> None:
    texts = {"include/foretouch.h": header(target, version, made), "src/foretouch_names.inc": names()}
    texts |= sources()
    words = {"@VERSION@": version, "@TARGET@": target.name}
    for template in sorted(TEMPLATES.iterdir()):
        if template.suffix in PLACES:
            text = template.read_text()
            for word, value in words.items():
                text = text.replace(word, value)
            texts[str(Path(PLACES[template.suffix], template.name))] = text
    for name, text in texts.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    Path(folder, OBJECT).parent.mkdir(exist_ok=True)
    Path(folder, OBJECT).write_bytes(made.content)
    shutil.copyfile(_licence(), folder / "LICENSE")


def names() -> str:
    """Tables of the names and sentences that ``foretouch_session.c`` reads and writes."""
    sentences = [f"nothing is learnt: {said}" for said in SENSOR_SENTENCES.values()]
    return (
        f"/* Made by foretouch.export.package. */\n\n{_table('law_names', LAW_NAMES)}\n"
        f'{_table("sensor_sentences", sentences)}\n#define ESTIMATOR "{ContactMap.name}"\n'
        f'#define LEARNT_LAW "{ContactMapModel.law}"\n'
    )


def _table(name: str, texts: Iterable[str]) -> str:
    rows = "".join(f'    "{text}",\n' for text in texts)
    return f"static const char *const {name}[] = {{\n{rows}}};\n"


def _licence() -> Path:
    """The licence, which lies with the installed package or, in a checkout, at its top."""
    files = importlib.metadata.files("foretouch") or []
    found = [Path(str(file.locate())) for file in files if file.name == "LICENSE" and "licenses" in file.parts]
    return next((path for path in found if path.is_file()), Path(__file__).resolve().parents[3] / "LICENSE")
