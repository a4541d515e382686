"""Kernels as machine code of another processor: one object file, which needs the C library's mathematics and no more.

Numba compiles a kernel to the language of LLVM, as it always does. Here the kernels' modules become one, so that what
several of them call is in it once; each gets an entry with a plain C signature, and everything else becomes internal
and may be left out or inlined. LLVM then makes code for the target of it.

It is done in a process of its own (`lowered`), for what Numba does depends on its settings when it is imported: there
it begins with nothing compiled, knows nothing of this machine's processor, and makes small code. So the bytes are the
same on every machine.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from typing import Any

from foretouch.errors import ForetouchError, SettingError
from foretouch.export.targets import Target
from foretouch.identification import ContactMap
from foretouch.models import ContactMapModel
from foretouch.session.settings import SessionSettings
from foretouch.settings import is_simulated

SETTINGS = {
    "NUMBA_OPT": "1",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
    "NUMBA_DISABLE_JIT": "0",
}
"""How Numba compiles what is exported."""

LONGEST = 900  # Time that compiling may take [s]
RAISES = "foretouch_raises_"
"""Beginning of a name that is left in the code where a kernel may raise."""

Parameter = tuple[str, str]
"""Name of a parameter of C, and its type: ``"double"``, ``"int64_t"``, ``"bool"``, or the name of a struct."""


@dataclass(frozen=True, slots=True)
class Function:
    """An entry as a function of C.

    Attributes:
        name: In C, without the prefix.
        parameters: In their order; a struct is given by its address.
        results: One is returned; several are written where pointers say.
    """

    name: str
    parameters: tuple[Parameter, ...]
    results: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class Lowered:
    """What was made for a target.

    Attributes:
        content: The object file.
        functions: Those of the entries, in their order.
        begins: Those that begin a struct: name, name of the struct, and what is said of it.
    """

    content: bytes
    functions: tuple[Function, ...]
    begins: tuple[tuple[str, str, str], ...]


def lowered(*targets: Target, settings: SessionSettings | None = None) -> list[Lowered]:
    """All entries for each of some targets, compiled in a process of its own.

    Args:
        *targets: Processors.
        settings: Of the leader and the follower.

    Raises:
        ForetouchError: They could not be compiled; the line says why.
    """
    # What structs begin with is computed by the same functions with nothing compiled, which gives the same bits.
    chosen = SessionSettings() if settings is None else settings
    begins = _done_apart("beginnings", chosen, {"NUMBA_DISABLE_JIT": "1"})
    return list(_done_apart("emitting", ([target.name for target in targets], begins), SETTINGS))


def require_exportable(settings: SessionSettings) -> None:
    """Refuse settings of a leader or a follower that are not in C."""
    for name, there, rule in (
        ("scene", "", "sessions along a line alone are exported: leave it out"),
        ("baseline", "none", "the code renders from the model: leave it out"),
        ("model", ContactMapModel.law, f"the follower of C learns {ContactMapModel.law}: leave it out"),
        ("estimator", ContactMap.name, f"the follower of C learns by {ContactMap.name}: leave it out"),
        ("calibration", "", "the follower of C reads no calibration: give it the force as it is calibrated"),
        ("budget", 0.0, "the messages of C are each sent whole: leave it out"),
    ):
        if (value := getattr(settings, name)) != there:
            raise SettingError(name, value, rule)
    if not is_simulated(settings.robot):
        rule = "is a real one: name a simulated one that is like it, and set what your robot has otherwise in C"
        raise SettingError("robot", settings.robot, rule)


def _done_apart(module: str, given: Any, settings: dict[str, str]) -> Any:
    """What `main` of a module of this room makes of something, in a process with these settings of Numba."""
    command = [sys.executable, "-c", f"from foretouch.export.{module} import main; main()"]
    with tempfile.TemporaryDirectory(prefix="foretouch-export-") as folder:
        surroundings = os.environ | settings | {"NUMBA_CACHE_DIR": folder}
        try:
            made = subprocess.run(
                command, input=pickle.dumps(given), env=surroundings, capture_output=True, timeout=LONGEST, check=False
            )
        except subprocess.TimeoutExpired:
            raise ForetouchError(
                f"export: compiling took longer than {LONGEST} s: try it on a quieter machine"
            ) from None
    if made.returncode:
        last = made.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise ForetouchError(f"export: the kernels cannot be compiled: {last}")
    return pickle.loads(made.stdout)
