"""The header of C: constants, the records as structs, and the functions, with what Python says of them."""

from __future__ import annotations

from collections.abc import Iterator

from foretouch.export.entries import Entry, entries_of, structs
from foretouch.export.lowering import Function, Lowered, Parameter
from foretouch.export.structs import PREFIX, TYPES, checked, comment, declared, records_in, sentence
from foretouch.export.targets import Target
from foretouch.messages import STATUS_SENTENCES, Status

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


def header(target: Target, version: str, lowered: Lowered) -> str:
    """The text of ``foretouch.h``.

    Args:
        target: The processor.
        version: Of foretouch.
        lowered: The functions.
    """
    names = {struct.kind: struct.name for struct in structs()}
    taken = {kind for function in lowered.functions for _, kind in function.parameters}
    inside = {kind for struct in structs() if struct.name in taken for kind in records_in(struct.kind)}
    shown = [struct for struct in structs() if struct.kind in inside]
    introduction = comment(INTRODUCTION.format(version=version, target=target.name))
    parts = [TOP.format(top=introduction, version=version), _statuses(), *(declared(one, names) for one in shown)]
    parts += [_begins(*one) for one in lowered.begins]
    parts += map(_declared, entries_of(target), lowered.functions)
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
    return f"{comment(entry.text)}\n{_signature(f'{kind} {PREFIX}{function.name}', given)}"


def _parameter(parameter: Parameter) -> str:
    name, kind = parameter
    return f"{kind} {name}" if kind in TYPES.values() else f"{PREFIX}{kind} *{name}"


def _pointer(result: Parameter) -> str:
    return f"{result[1]} *{result[0]}"


def _signature(begin: str, given: list[str]) -> str:
    return "\n".join(_lines(f"{begin}(", given))


def _lines(line: str, given: list[str]) -> Iterator[str]:
    for index, one in enumerate(given):
        word = one + (", " if index + 1 < len(given) else ");")
        if len(line) + len(word.rstrip()) > 120:
            yield line.rstrip()
            line = "    "
        line += word
    yield line
