"""The folder that a program of C or C++ is built against, and its header: structs and functions, as Python says."""

from __future__ import annotations

import contextlib
import importlib.metadata
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from foretouch.errors import SettingError
from foretouch.export.entries import Entry, entries_of, structs
from foretouch.export.lowering import Function, Lowered, Parameter, lowered
from foretouch.export.structs import PREFIX, TYPES, checked, comment, declared, records_in, sentence
from foretouch.export.targets import Target
from foretouch.export.wire import sources
from foretouch.identification import SENSOR_SENTENCES, ContactMap
from foretouch.messages import STATUS_SENTENCES, Status
from foretouch.models import ContactMapModel
from foretouch.models.law_kernel import LAW_NAMES

TEMPLATES = Path(__file__).with_name("c")
"""What is written by hand: it is copied as it is, but for version and target."""

PLACES = {".h": "include", ".hpp": "include", ".c": "src", ".txt": ""}
"""Folder of the package for each ending."""

HEADER, NAMES = "include/foretouch.h", "src/foretouch_names.inc"
OBJECT, LICENCE = "lib/foretouch_kernels.o", "LICENSE"

TOP = """{top}
#ifndef FORETOUCH_H
#define FORETOUCH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
#define FORETOUCH_CHECK(fact) static_assert(fact, #fact)
extern "C" {{
#else
#define FORETOUCH_CHECK(fact) _Static_assert(fact, #fact)
#endif

#define FORETOUCH_VERSION "{version}"
"""

END = """
#undef FORETOUCH_CHECK

#ifdef __cplusplus
}
#endif

#endif
"""

INTRODUCTION = """foretouch {version} in C, for {target}: made by `foretouch export c`; do not edit.

The functions are the code that Python runs, compiled for this processor. None allocates, waits, fails, or keeps
anything outside of the structs that it is given: several threads may call them at once, each with its own. Units are
SI. A struct begins with its init function; it may be copied, and is moved by copying its bytes."""


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
    with refused(out), beside(out) as folder:
        new = Path(folder, "new")
        _fill(new, target, version, made)
        new.chmod(0o755)
        if out.exists():
            out.rename(Path(folder, "old"))
        new.rename(out)
    return sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file())


def require_place(out: Path) -> None:
    """Refuse a folder that a package cannot be written to, before anything is compiled."""
    with refused(out):
        require_folder(out)
        if out.exists() and out.samefile(Path.cwd()):
            raise SettingError("out", str(out), "is the folder that you are in: name another")
        if out.exists() and any(out.iterdir()):
            _require_package(out)


def require_folder(out: Path) -> None:
    """Refuse what is no folder, and cannot become one."""
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise SettingError("out", str(out), "is there and is no folder: name another")
    if not out.resolve().parent.is_dir():
        raise SettingError("out", str(out), f"there is no folder {out.resolve().parent}: make it first")
    with beside(out):
        pass


@contextlib.contextmanager
def refused(out: Path) -> Iterator[None]:
    """Say of what the system refuses that the folder cannot be written."""
    try:
        yield
    except OSError as error:
        raise SettingError("out", str(out), f"cannot be written: {error.strerror or error}") from None


def beside(out: Path) -> tempfile.TemporaryDirectory[str]:
    """A folder beside another, in which what will be there is made, so that it comes there whole."""
    return tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.resolve().parent)


def _require_package(out: Path) -> None:
    """Refuse a folder with anything that no package has: it would be gone with the package that is replaced."""
    own = set(_made())
    others = (path for path in out.rglob("*") if not path.is_dir() and str(path.relative_to(out)) not in own)
    other = next(others, None) if Path(out, OBJECT).is_file() else next(out.iterdir())
    if other is not None:
        what = f"holds something else than such a package ({other.relative_to(out)}): name another folder"
        raise SettingError("out", str(out), what)


def _made() -> list[str]:
    """The files of a package."""
    return [HEADER, NAMES, OBJECT, LICENCE, *sources(), *_templates()]


def _templates() -> dict[str, Path]:
    """What is written by hand, by its path in a package."""
    found = (path for path in sorted(TEMPLATES.iterdir()) if path.suffix in PLACES)
    return {str(Path(PLACES[path.suffix], path.name)): path for path in found}


def _fill(folder: Path, target: Target, version: str, made: Lowered) -> None:
    texts = {HEADER: header(target, version, made), NAMES: names()}
    texts |= sources()
    words = {"@VERSION@": version, "@TARGET@": target.name}
    for name, template in _templates().items():
        text = template.read_text()
        for word, value in words.items():
            text = text.replace(word, value)
        texts[name] = text
    for name, text in texts.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    Path(folder, OBJECT).parent.mkdir(exist_ok=True)
    Path(folder, OBJECT).write_bytes(made.content)
    shutil.copyfile(_licence(), folder / LICENCE)


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


def header(target: Target, version: str, made: Lowered) -> str:
    """The text of ``foretouch.h``.

    Args:
        target: The processor.
        version: Of foretouch.
        made: The functions.
    """
    names = {struct.kind: struct.name for struct in structs()}
    taken = {kind for function in made.functions for _, kind in function.parameters}
    inside = {kind for struct in structs() if struct.name in taken for kind in records_in(struct.kind)}
    shown = [struct for struct in structs() if struct.kind in inside]
    introduction = comment(INTRODUCTION.format(version=version, target=target.name))
    parts = [TOP.format(top=introduction, version=version), _statuses(), *(declared(one, names) for one in shown)]
    parts += [_begins(*one) for one in made.begins]
    parts += map(_declared, entries_of(target), made.functions)
    placed = "\n".join(map(checked, shown))
    parts.append(f"{comment('This compiler places every field where the code expects it.')}\n{placed}")
    return "\n\n".join(part.strip("\n") for part in parts) + "\n" + END


def _statuses() -> str:
    lines = [comment(f"{sentence(Status).partition(';')[0]}."), f"typedef enum {PREFIX}follower_status {{"]
    for status in Status:
        said = comment(STATUS_SENTENCES[status], "    ")
        lines += [said, f"    FORETOUCH_{status.name} = {status.value},"]
    lines[-1] = lines[-1].rstrip(",")
    return "\n".join([*lines, f"}} {PREFIX}follower_status;"])


def _begins(name: str, struct: str, said: str) -> str:
    return f"{comment(said)}\nvoid {PREFIX}{name}({PREFIX}{struct} *{struct});"


def _declared(entry: Entry, function: Function) -> str:
    """The declaration of a function, with the kernel's own description."""
    several = len(function.results) != 1
    given = [*map(_parameter, function.parameters), *(map(_pointer, function.results) if several else ())]
    kind = "void" if several else function.results[0][1]
    return "\n".join([comment(entry.text), *_lines(f"{kind} {PREFIX}{function.name}(", given)])


def _parameter(parameter: Parameter) -> str:
    name, kind = parameter
    return f"{kind} {name}" if kind in TYPES.values() else f"{PREFIX}{kind} *{name}"


def _pointer(result: Parameter) -> str:
    return f"{result[1]} *{result[0]}"


def _lines(line: str, given: list[str]) -> Iterator[str]:
    for index, one in enumerate(given):
        word = one + (", " if index + 1 < len(given) else ");")
        if len(line) + len(word.rstrip()) > 120:
            yield line.rstrip()
            line = "    "
        line += word
    yield line
