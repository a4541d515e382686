"""The tuned numbers of the learner, and the errors with one of them halved or doubled.

They are read from the modules where they stand: every number, alone or in a tuple, that is assigned at the margin.
Compiled code has such numbers in it, and to compile it for each of them would take hours. So these modules are loaded
with numbers of a class of their own, which Numba is told to read from a fixed address of memory: one compilation serves
all variants. Those that set the size or the place of the knots are compiled anew.

As a script, of `docs/sensitivities.py`, it predicts recordings with one number times a factor after another.
"""

from __future__ import annotations

import ast
import ctypes
import importlib.util
import os
import pickle
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType
from typing import Any

SOURCES = Path(__file__).resolve().parents[2] / "src"
ROOM = "foretouch.identification"
MODULES = (
    *(f"{ROOM}.contact_map.{name}" for name in ("bank", "kernel", "learning", "prior", "regression", "scores")),
    *(f"{ROOM}.exact.{name}" for name in ("law", "belief")),
    "foretouch.models.contact_map.layout",
    *(f"{ROOM}.conditioning.{name}" for name in ("air", "kernel")),
)

LAYOUT = "foretouch.models.contact_map.layout"

NOT_TUNED = {
    f"{ROOM}.contact_map.learning:LARGEST": "the largest number there is",
    f"{ROOM}.contact_map.learning:LONGEST_PERIOD": "no recording has such pauses",
    f"{ROOM}.exact.law:LARGEST_S": "the paper's bound",
    f"{ROOM}.exact.belief:LARGEST_DAMPING": "a bound that nothing here reaches",
    f"{ROOM}.exact.belief:SMALLEST_FORCE": "a bound that nothing here reaches",
    f"{ROOM}.exact.belief:LARGEST_FORCE": "a bound that nothing here reaches",
    f"{LAYOUT}:LARGEST_FORCE": "a bound of what is sent",
    f"{LAYOUT}:UNCERTAINTIES": "a size",
    f"{LAYOUT}:EXPERTS": "a size",
    f"{ROOM}.conditioning.air:UNKNOWNS": "a size",
    f"{ROOM}.conditioning.kernel:FIRST_CAPACITY": "a size",
    f"{ROOM}.conditioning.kernel:CONTACT_FLOOR": "of the sensor: each recording has its own",
}
"""Numbers at the margin that nobody chose by an error, and why."""

COMPILED = (
    f"{LAYOUT}:COARSENESS",
    f"{LAYOUT}:GRIDS:0",
    f"{LAYOUT}:GRIDS:1",
    f"{LAYOUT}:BEYOND",
    *(f"{ROOM}.exact.belief:{name}" for name in ("FEWEST_UPDATES", "FIRST_ERROR", "LEARNING_TIME", "DRIFT")),
    f"{ROOM}.exact.belief:SURFACE_NOISE",
    f"{ROOM}.contact_map.scores:LONGEST_HORIZON",
    f"{ROOM}.conditioning.air:SURE",
    f"{ROOM}.conditioning.air:START_WINDOW",
)
"""Those that make the compiled code another one: whole numbers, the distances of the knots, and those that others are
computed from."""

ADDRESS, PAGE = 0x5F0000000000, 4096
"""Where the numbers lie for compiled code, and how many bytes there are."""


def numbers(module: str) -> Iterator[tuple[str, ast.expr]]:
    """Every tuned number of a module by its key, and where it stands in the module's tree."""
    yield from _numbers(module, ast.parse(_path(module).read_text()))


def _path(module: str) -> Path:
    return SOURCES.joinpath(*module.split(".")).with_suffix(".py")


def _numbers(module: str, tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    for statement in tree.body:
        if not isinstance(statement, ast.Assign):
            continue
        target, value = statement.targets[0], statement.value
        values = value.elts if isinstance(value, ast.Tuple) else [value]
        names = [one.id for one in target.elts] if isinstance(target, ast.Tuple) else [target.id]  # type: ignore
        for index, one in enumerate(values):
            alone = len(names) == len(values)
            key = f"{module}:{names[index]}" if alone else f"{module}:{names[0]}:{index}"
            if isinstance(one, ast.Call) and isinstance(one.func, ast.Name) and one.func.id == "_grid":
                yield key, one.args[0]
            elif _is_number(one) and key not in NOT_TUNED:
                yield key, one


def _is_number(value: ast.expr) -> bool:
    allowed = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
    if not all(isinstance(node, allowed) for node in ast.walk(value)):
        return False
    constants = [node.value for node in ast.walk(value) if isinstance(node, ast.Constant)]
    return all(type(one) is float for one in constants) or (len(constants) == 1 and type(constants[0]) is int)


def keys() -> list[str]:
    """Of all tuned numbers: module, name and, in a tuple, place. Whole numbers only where they are of `COMPILED`."""
    found = [(key, node) for module in MODULES for key, node in numbers(module)]
    whole = [isinstance(node, ast.Constant) and type(node.value) is int for _, node in found]
    return [key for (key, _), integer in zip(found, whole, strict=True) if not integer or key in COMPILED]


class Tuned(float):
    """A number that compiled code reads from memory."""

    key: str


class Loader(SourceFileLoader):
    """Loads a module with its tuned numbers replaced; never from or to what Python keeps of modules."""

    def get_code(self, fullname: str) -> CodeType:
        tree = ast.parse(self.get_data(self.path))
        for key, node in list(_numbers(fullname, tree)):
            if key not in _slots():
                continue
            value = eval(compile(ast.Expression(node), self.path, "eval"))
            call = ast.parse(f"__import__('foretouch_tuned').tuned({key!r}, {value!r})", mode="eval").body
            _replace(tree, node, ast.copy_location(call, node))
        return compile(ast.fix_missing_locations(tree), self.path, "exec")


def _replace(tree: ast.AST, old: ast.expr, new: ast.expr) -> None:
    class Put(ast.NodeTransformer):
        def visit(self, node: ast.AST) -> Any:
            return new if node is old else self.generic_visit(node)

    Put().visit(tree)


def address_of(key: str) -> int:
    """Where a number lies."""
    return ADDRESS + 8 * _slots()[key]


@cache
def _slots() -> dict[str, int]:
    return {key: slot for slot, key in enumerate(keys())}


class Finder(MetaPathFinder):
    """Finds the modules that have tuned numbers."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: Any = None) -> ModuleSpec | None:
        if fullname not in MODULES:
            return None
        return importlib.util.spec_from_file_location(
            fullname, _path(fullname), loader=Loader(fullname, str(_path(fullname)))
        )


_factors: dict[str, float] = {}


def tuned(key: str, value: float) -> Any:
    """What a module gets in place of a number."""
    value = type(value)(value * _factors.get(key, 1.0) + (0.5 if isinstance(value, int) else 0.0))
    if key in COMPILED:
        return value
    number = Tuned(value)
    number.key = key
    ctypes.c_double.from_address(address_of(key)).value = value
    return number


def install(factors: dict[str, float]) -> None:
    """Before anything of the package is imported: let its modules have numbers times these factors."""
    assert not any(module in sys.modules for module in MODULES)
    libc = ctypes.CDLL(None)
    libc.mmap.restype, libc.mmap.argtypes = (
        ctypes.c_void_p,
        [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long],
    )
    private, anonymous, fixed = 0x02, 0x20, 0x100000
    if libc.mmap(ADDRESS, PAGE, 3, private | anonymous | fixed, -1, 0) != ADDRESS:
        raise SystemExit("the memory for the tuned numbers is taken")
    _factors.update(factors)
    sys.modules["foretouch_tuned"] = sys.modules[__name__]
    sys.meta_path.insert(0, Finder())

    from llvmlite import ir
    from numba.core.base import BaseContext

    plain = BaseContext.get_constant_generic

    def constant(self: Any, builder: Any, kind: Any, value: Any) -> Any:
        if type(value) is not Tuned:
            return plain(self, builder, kind, value)
        address = ir.Constant(ir.IntType(64), address_of(value.key))
        return builder.load(builder.inttoptr(address, ir.DoubleType().as_pointer()))

    BaseContext.get_constant_generic = constant


def change(key: str, factor: float) -> None:
    """Multiply a number wherever a module has it, and forget what was computed of it."""
    for module in [one for name, one in sys.modules.items() if name.startswith("foretouch.")]:
        for name, value in list(vars(module).items()):
            if hasattr(value, "cache_clear"):
                value.cache_clear()
            elif type(value) is Tuned and value.key == key:
                setattr(module, name, tuned(key, value * factor))
            elif type(value) is tuple and any(type(one) is Tuned and one.key == key for one in value):
                parts = [tuned(key, one * factor) if getattr(one, "key", None) == key else one for one in value]
                setattr(module, name, tuple(parts))


def predict_all(recordings: dict[str, Any], forces: Path) -> None:
    """Write the late prediction of each recording [N], with the numbers as they are in this process."""
    from foretouch.identification import Learner, predict

    found = {}
    for name, (recording, delay, zero) in recordings.items():
        learner = Learner(force_offset=zero, contact_floor=recording.contact_floor)
        found[name] = predict(recording, learner, delay=delay).force
    forces.write_bytes(pickle.dumps(found))


def serve(recordings: dict[str, Any]) -> None:
    """For each line, a key, a factor and a file: change the number and predict, in a copy of this process."""
    name = next(iter(recordings))
    predict_all({name: recordings[name]}, Path(os.devnull))  # all is compiled before there are copies
    for line in sys.stdin:
        key, factor, forces = line.rstrip("\n").split(" ", 2)
        copy = os.fork()
        if copy == 0:
            change(key, float(factor))
            predict_all(recordings, Path(forces))
            os._exit(0)
        print(os.waitpid(copy, 0)[1], flush=True)


if __name__ == "__main__":
    install(dict([(sys.argv[2], float(sys.argv[3]))] if sys.argv[2:] else ()))
    serve(pickle.loads(Path(sys.argv[1]).read_bytes()))
