"""The one way in which kernels are compiled, what Python calls into them, and when compiled code is still good.

Numba keeps compiled code for the next process, and compiles again where the file of a function has changed. It does not
see what a kernel takes from other files: a function that is inlined, a constant. So what is kept here lies in a folder
that is named by a digest of the kernel's module and of every module of foretouch that it imports, straight or through
others: with one changed character in any of them, nothing that was compiled before is found. The folder is the user's,
so that another copy of the same sources finds it, too.
"""

from __future__ import annotations

import hashlib
import math
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar, overload

import numba
import numpy as np
from llvmlite import ir
from numba import config, types
from numba.core import caching, cgutils, sigutils
from numba.core.registry import cpu_target
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin
from numba.np.arrayobj import make_array, populate_array
from numpy.typing import NDArray

from foretouch.core.records import Record

Function = TypeVar("Function", bound=Callable[..., Any])
Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

PACKAGE = Path(__file__).resolve().parents[1]

IMPORT = re.compile(r"^(?:from|import) +(foretouch[\w.]*)(?: +import +(\([^)]*\)|[^\n]*))?", re.MULTILINE)
"""An import at the margin: a kernel has no other, for it cannot import while it runs."""

DECORATED = re.compile(r"^@(compiled|inlined|kernel)\b", re.MULTILINE)
"""A function that is compiled where it is defined."""

KEPT = 8
"""Versions of what is compiled of a module that stay: for some copies and branches on one machine. Each is at most a
few megabytes."""


@overload
def compiled(function: Function, /) -> Function: ...
@overload
def compiled(**options: Any) -> Callable[[Function], Function]: ...
def compiled(function: Any = None, /, *, allocates: bool = False, **options: Any) -> Any:
    """A compiled function, or a decorator that compiles: loaded where it was compiled of the same sources before.

    It is compiled for the types of each call: see `Kernel` for those that Python calls in a loop. Where there is no
    folder to keep it in, it is compiled in each process.

    Args:
        function: A function of numbers, arrays, tuples and records.
        allocates: Whether it may make arrays, as no function of a tick does: what a tick needs is in its records, or
            is `scratch`. A function that makes one and does not say so is refused when it is compiled. To assign an
            array to a slice of another, and to compute with whole arrays, makes one too: write a loop.
        **options: Of `numba.njit`, such as ``forceinline``. Never ``fastmath``: tests for NaN go. A division by zero
            gives what IEEE 754 says, and raises nothing, unless ``error_model="python"`` is asked for.
    """
    if function is None:
        return partial(compiled, allocates=allocates, **options)
    options = {"error_model": "numpy"} | options
    kept = compiled_folder(function.__code__.co_filename) is not None
    # A wrapper for callers in C is compiled with each function otherwise, and there are none.
    return numba.njit(cache=kept, no_cfunc_wrapper=True, _nrt=allocates, **options)(function)


def scratch(kind: Any, *shape: int) -> NDArray[Any]:
    """An array for a compiled function's own use while it runs, on its stack: nothing is allocated.

    Its values are not set. It must not be returned. Interpreted it is an array like any other.

    Args:
        kind: NumPy's type of the values.
        *shape: Constants, known when the function is compiled: their product is at most some thousands.
    """
    return np.empty(shape, kind)


@infer_global(scratch)
class _ScratchType(AbstractTemplate):  # type: ignore[misc]  # Numba is not typed
    prefer_literal = True

    def generic(self, given: Any, _: Any) -> Any:
        """The type of a call with these types of arguments; None where a size is not known."""
        kind, *shape = given
        if all(isinstance(size, types.IntegerLiteral) for size in shape):
            return signature(types.Array(kind.dtype, len(shape), "C"), *given)
        return None


@lower_builtin(scratch, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
def _lower_scratch(context: Any, builder: Any, typed: Any, _: Any) -> Any:
    """The space is taken where the function begins, so that a loop does not take it again and again."""
    sizes = [size.literal_value for size in typed.args[1:]]
    kind = context.get_data_type(typed.return_type.dtype)
    width = context.get_abi_sizeof(kind)
    data = cgutils.alloca_once(builder, ir.ArrayType(kind, math.prod(sizes)))
    made = make_array(typed.return_type)(context, builder)
    word = context.get_constant
    populate_array(
        made,
        data=builder.bitcast(data, kind.as_pointer()),
        shape=[word(types.intp, size) for size in sizes],
        strides=[word(types.intp, width * math.prod(sizes[axis + 1 :])) for axis in range(len(sizes))],
        itemsize=word(types.intp, width),
        meminfo=None,
    )
    return made._getvalue()


def _signature(written: str, function: Callable[..., Any], records: tuple[type[Record], ...] = ()) -> Any:
    """The types of a function, with those of these records, and of those and the named tuples that its module knows."""
    known = [kind for kind in function.__globals__.values() if _is_record(kind)]
    named = {kind.__name__: numba.from_dtype(kind.layout) for kind in (*known, *records)}
    tuples = {name: kind for name, kind in function.__globals__.items() if hasattr(kind, "_fields")}
    return eval(written, vars(numba.types) | tuples | named)


def _is_record(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Record) and kind is not Record


class Kernel(Generic[Arguments, Result]):
    """What Python calls of compiled code: its types are stated, so that an integer from a driver compiles nothing anew.

    It is compiled, or loaded, where its `entry` is first asked for, which is before any loop.

    Args:
        function: A compiled function.
        types: In Numba's terms, where a `foretouch.core.Record` that the function's module knows is named as its class:
            those of the result and the arguments, ``"f8(Peak[::1], f8)"``, or of the arguments, ``"(Peak[::1], f8)"``.
        *records: More records to name.
    """

    def __init__(self, function: Callable[Arguments, Result], types: str, *records: type[Record]) -> None:
        self.__name__, self.function, self.types, self.records = function.__name__, function, types, records
        self._entry: Callable[Arguments, Result] | None = None

    @property
    def entry(self) -> Callable[Arguments, Result]:
        """The function for a loop: of arguments in their order; to look at their types would be most of a call."""
        if self._entry is None:
            self._entry = self._load()
        return self._entry

    def __call__(self, *arguments: Arguments.args, **named: Arguments.kwargs) -> Result:
        """Call it outside of a loop."""
        return self.entry(*arguments, **named)

    def _load(self) -> Any:
        function: Any = self.function
        if config.DISABLE_JIT:
            return np.errstate(all="ignore")(function)
        types = types_of(self)
        function.compile(types)
        return function.overloads[sigutils.normalize_signature(types)[0]].entry_point


def types_of(kernel: Kernel[..., Any]) -> Any:
    """Numba's types of a kernel that is compiled: of its arguments, or of its result and them."""
    function: Any = kernel.function
    return _signature(kernel.types, function.py_func, kernel.records)


def kernel(
    types: str, /, *records: type[Record], **options: Any
) -> Callable[[Callable[Arguments, Result]], Kernel[Arguments, Result]]:
    """A decorator: `compiled`, with these options, and its `Kernel` of these types and records."""
    return lambda function: Kernel(compiled(**options)(function), types, *records)


def inlined(function: Function) -> Function:
    """A compiled function that becomes part of each compiled caller; its arithmetic is that of IEEE 754.

    Args:
        function: A function of numbers, arrays and tuples.
    """
    return compiled(error_model="numpy", forceinline=True)(function)


def interpreted(function: Function) -> Function:
    """The function as Python runs it, of one that is compiled; itself where nothing is."""
    compiled_one = getattr(function, "function", function)
    plain: Function = getattr(compiled_one, "py_func", compiled_one)
    return plain


def compiled_root() -> Path | None:
    """The folder of all folders of compiled code; None where there is none of this user's own."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    root = Path(numba.config.CACHE_DIR or Path(home, "foretouch", "compiled"))
    try:
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        return root if _is_ours(root) else None
    except OSError:
        return None


def complete_mark() -> Path | None:
    """The folder that is there once everything was compiled of these sources, for this processor and Python.

    None where nothing can be kept.
    """
    root = compiled_root()
    if root is None:
        return None
    digest = hashlib.sha256(repr((sys.version, cpu_target.target_context.codegen().magic_tuple())).encode())
    for source in sorted(PACKAGE.rglob("*.py")):
        if has_kernels(source):
            digest.update(digest_of(source).encode())
    return root / f"complete-{digest.hexdigest()[:16]}"


def mark_complete() -> None:
    """Say to later processes that everything was compiled."""
    mark = complete_mark()
    if mark is not None:
        mark.mkdir(mode=0o700, exist_ok=True)
        _forget_old(mark.parent, "complete")


@cache
def compiled_folder(source: str) -> Path | None:
    """The folder where is kept what is compiled of a source file; None where there is none of this user's own.

    What lies there is loaded and run. So a folder that is another user's, or in which others may write, is not used:
    one warning is given, and every process compiles for itself. It is below ``NUMBA_CACHE_DIR``, where that is set, or
    the user's cache folder.
    """
    name, root = _name(Path(source)), compiled_root()
    if root is None:
        return None
    folder = root / f"{name}-{digest_of(Path(source))}"
    try:
        if not folder.is_dir():
            folder.mkdir(mode=0o700, exist_ok=True)
            _forget_old(root, name)
        if not _is_ours(folder):
            return None
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError:
        return None


def _is_ours(folder: Path) -> bool:
    """Whether only this user and root can have written what a folder holds; reports why not."""
    state = folder.stat()
    if state.st_uid != os.geteuid():
        problem = "is another user's"
    elif state.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        problem = "can be written by others (chmod go-w mends it)"
    else:
        return True
    _say_once(f"{folder} {problem}: no compiled code is kept there or taken from it, so that each start compiles anew")
    return False


@cache
def _say_once(line: str) -> None:
    sys.stderr.write(f"foretouch: {line}\n")


def _forget_old(root: Path, name: str) -> None:
    """Remove what was compiled of versions of a module before the newest."""
    with suppress(OSError):  # another process may remove the same
        versions = sorted(root.glob(f"{name}-{'[0-9a-f]' * 16}"), key=lambda folder: folder.stat().st_mtime)
        for folder in versions[:-KEPT]:
            shutil.rmtree(folder, ignore_errors=True)


@cache
def digest_of(source: Path) -> str:
    """Hash of a module's source, of all modules of foretouch that it imports at top level, and of Numba's version.

    Compiled code names the modules that it needs: a module that is moved has another digest.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(_closure(source)):
        digest.update(_name(path).encode() + _text(path).encode())
    return digest.hexdigest()[:16]


def _name(source: Path) -> str:
    """The module's name below the package."""
    inside = source.relative_to(PACKAGE) if source.is_relative_to(PACKAGE) else Path(source.name)
    return ".".join(inside.with_suffix("").parts)


def _closure(source: Path) -> set[Path]:
    seen, waiting = {source, Path(__file__)}, [source]  # how it is compiled counts, too
    while waiting:
        fresh = set(imported(waiting.pop())) - seen
        seen |= fresh
        waiting += fresh
    return seen


@cache
def imported(source: Path) -> frozenset[Path]:
    """The sources of the modules of foretouch that a module imports at its margin."""
    return frozenset(_named(_text(source)))


def has_kernels(source: Path) -> bool:
    """Whether a module defines compiled functions."""
    return DECORATED.search(_text(source)) is not None


def _named(text: str) -> Iterator[Path]:
    for statement in IMPORT.finditer(text):
        module, names = statement[1], statement[2] or ""
        path = PACKAGE.joinpath(*module.split(".")[1:])
        yield path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        for name in re.findall(r"\w+", names) if path.is_dir() else ():
            if (path / f"{name}.py").is_file():
                yield path / f"{name}.py"


@cache
def _text(path: Path) -> str:
    return path.read_text()


class _KeptByDigest(caching._CacheLocator):  # type: ignore[misc]  # Numba is not typed
    """Where Numba keeps what it compiled of foretouch, and only of foretouch."""

    def __init__(self, line: int, folder: Path) -> None:
        self._line, self._folder = line, folder

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, function: Any, source: str) -> _KeptByDigest | None:
        if not Path(source).is_relative_to(PACKAGE):
            return None
        folder = compiled_folder(source)
        return None if folder is None else cls(function.__code__.co_firstlineno, folder)


caching.CacheImpl._locator_classes.insert(0, _KeptByDigest)


@inlined
def squared(x: float) -> float:
    """x^2 as a product, which is rounded alike everywhere; `x ** 2` of Python without compiling is the C library's."""
    return x * x
