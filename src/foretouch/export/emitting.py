"""How `foretouch.export.lowering` makes one object file of several kernels, in the process that it starts."""

from __future__ import annotations

import pickle
import re
import sys
from collections.abc import Iterator
from typing import Any

import llvmlite.binding as llvm
import numba
from numba import types
from numba.core import sigutils
from numba.core.funcdesc import FunctionDescriptor
from numba.core.registry import CPUDispatcher

from foretouch.core.compiling import interpreted, types_of
from foretouch.errors import ForetouchError
from foretouch.export.beginnings import Beginning, packed
from foretouch.export.entries import Entry, entries_of, structs
from foretouch.export.lowering import RAISES, Function, Lowered
from foretouch.export.structs import PREFIX
from foretouch.export.targets import TARGETS, Target

WORDS = {"double": "double", "int64_t": "i64", "bool": "i8"}
"""LLVM's types of numbers in memory, by C's."""
NAMES = {types.float64: "double", types.int64: "int64_t", types.boolean: "bool"}
"""C's types of numbers, by Numba's."""

LINE, IMPOSSIBLE = "\n  ", "call void @llvm.assume(i1 false)"
OPTIONS = {
    "nopython": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "no_cpython_wrapper": True,
    "_nrt": False,
}
UNPACK = """
define internal i64 @both(ptr %at) {
  %low = load i16, ptr %at
  %behind = getelementptr i16, ptr %at, i64 1
  %high = load i16, ptr %behind
  %a = zext i16 %low to i64
  %b = zext i16 %high to i64
  %c = shl i64 %b, 16
  %d = or i64 %a, %c
  ret i64 %d
}
define internal void @unpack(ptr %place, ptr %words, ptr %pieces, ptr %end) noinline {
entry:
  br label %next
next:
  %to = phi ptr [ %place, %entry ], [ %behind, %after ]
  %piece = phi ptr [ %pieces, %entry ], [ %then, %after ]
  %few = load i16, ptr %piece
  %count = zext i16 %few to i64
  %at_length = getelementptr i16, ptr %piece, i64 1
  %at_distance = getelementptr i16, ptr %piece, i64 3
  %length = call i64 @both(ptr %at_length)
  %distance = call i64 @both(ptr %at_distance)
  %told_at = getelementptr i16, ptr %piece, i64 5
  %then = getelementptr i16, ptr %told_at, i64 %count
  %back = sub i64 0, %distance
  %there = getelementptr i64, ptr %to, i64 %count
  %behind = getelementptr i64, ptr %there, i64 %length
  %source = getelementptr i64, ptr %there, i64 %back
  br label %tell
tell:
  %k = phi i64 [ 0, %next ], [ %k1, %told ]
  %more = icmp ult i64 %k, %count
  br i1 %more, label %told, label %copy
told:
  %a = getelementptr i16, ptr %told_at, i64 %k
  %short = load i16, ptr %a
  %index = zext i16 %short to i64
  %word = getelementptr i64, ptr %words, i64 %index
  %v = load i64, ptr %word
  %b = getelementptr i64, ptr %to, i64 %k
  store i64 %v, ptr %b
  %k1 = add i64 %k, 1
  br label %tell
copy:
  %m = phi i64 [ 0, %tell ], [ %m1, %copied ]
  %left = icmp ult i64 %m, %length
  br i1 %left, label %copied, label %after
copied:
  %c = getelementptr i64, ptr %source, i64 %m
  %w = load i64, ptr %c
  %d = getelementptr i64, ptr %there, i64 %m
  store i64 %w, ptr %d
  %m1 = add i64 %m, 1
  br label %copy
after:
  %done = icmp eq ptr %then, %end
  br i1 %done, label %out, label %next
out:
  ret void
}
"""
"""Writes a record from what `packed` makes of it."""


def main() -> None:
    """Write what is made for the targets that the input names, with the beginnings there, to the output."""
    names, begins = pickle.loads(sys.stdin.buffer.read())
    sys.stdout.buffer.write(pickle.dumps(emitted([TARGETS[name] for name in names], begins)))


def emitted(targets: list[Target], begins: list[Beginning]) -> list[Lowered]:
    """The object files of all entries and beginnings for targets."""
    _inline_little()
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    compiled = {entry: _compiled(entry) for target in targets for entry in entries_of(target)}
    return [_lowered(target, [compiled[entry] for entry in entries_of(target)], begins) for target in targets]


def _lowered(target: Target, compiled: list[tuple[Function, str, str]], begins: list[Beginning]) -> Lowered:
    """The object file for a target, of what is compiled for it, and of what its structs begin with."""
    functions = tuple(function for function, *_ in compiled)
    begun = [one for one in begins if target.simulates or not one.simulated]
    texts = [text for _, *two in compiled for text in two] + ["\n".join([UNPACK, *map(_initial, begun)])]
    kept = {PREFIX + name for name in (*(one.name for one in functions), *(one.name for one in begun))}
    said = tuple((one.name, one.struct, one.text) for one in begun)
    return Lowered(_object(target, texts, kept), functions, said)


def _object(target: Target, texts: list[str], kept: set[str]) -> bytes:
    """The object file of modules for a target, of which these names can be linked to."""
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.processor, features=target.features, opt=2, reloc="pic", codemodel="default"
    )
    heading = f'target datalayout = "{machine.target_data}"\ntarget triple = "{target.triple}"\n'
    module = llvm.parse_assembly(heading)
    for text in texts:
        module.link_in(_parsed(heading, text))
    _hide(module, kept)
    _optimise(module, machine)
    for name in sorted(one.name for one in module.functions):
        if name.startswith(RAISES):
            raise ForetouchError(f"{name.removeprefix(RAISES)} may raise, which no function of C does")
        if name.startswith("NRT_"):
            raise ForetouchError("a kernel makes an array, which no function of C does")
    content: bytes = machine.emit_object(module)
    return content


def _inline_little() -> None:
    """Leave it to LLVM what is inlined, whatever kernels ask of Numba for speed: the code is a third as large."""
    FunctionDescriptor.inline = property(lambda _: False, lambda *_: None)


def _parsed(heading: str, text: str) -> Any:
    """A module of the target.

    An index that a tuple does not have, which Numba would raise for, is taken for impossible: LLVM proves it, where it
    inlines as much as for Python, and here it would have to be tested at each access.
    """
    beyond = re.findall(r"@\.const\.pickledata\.(\w+)\S* = .*tuple index out of range", text)
    for digest in dict.fromkeys(beyond):
        text = re.sub(rf"store ptr @\.const\.picklebuf\.{digest}\S*, ptr \S+(, align \d+)?", IMPOSSIBLE, text)
    plain = re.sub(r"(?m)^target .*\n|^declare void @llvm\.assume.*\n", "", text)
    plain = plain.replace("@numba_frexp(", "@frexp(")  # which is the C library's, by another name
    return llvm.parse_assembly(f"{heading}{plain}\ndeclare void @llvm.assume(i1)\n")


def _compiled(entry: Entry) -> tuple[Function, str, str]:
    """An entry as a function of C; the kernel with all that it calls, and that function, as modules' texts."""
    kernel = entry.kernel
    # Compiled once more without what Python calls it by, and never taken from what is kept, which has no text.
    function = CPUDispatcher(interpreted(kernel.function), targetoptions=OPTIONS)
    given = types_of(kernel)
    function.compile(given)
    made = function.overloads[sigutils.normalize_signature(given)[0]]
    own = function.py_func.__code__.co_varnames
    leaves = [leaf for name, kind in zip(own, made.signature.args, strict=False) for leaf in _leaves(name, kind)]
    results = [kind for _, kind, _ in _leaves("result", made.signature.return_type)]
    parameters = [(name, kind) for name, kind, _ in leaves]
    if entry.parameters:
        parameters = [(name, kind) for name, (_, kind) in zip(entry.parameters, parameters, strict=True)]
    wanted = Function(
        entry.name, tuple(parameters), tuple(zip(entry.results or ("result",) * len(results), results, strict=True))
    )
    wrapper = _wrapper(wanted, made.fndesc.llvm_func_name, leaves, made.signature.return_type)
    return wanted, made.library.get_llvm_str(), wrapper


def _leaves(name: str, kind: Any) -> Iterator[tuple[str, Any, Any]]:
    """What a parameter of a kernel is for C: records and numbers, those of tuples one by one, with Numba's types."""
    bare = kind.dtype if isinstance(kind, types.Array) else kind
    if isinstance(bare, types.Record):
        yield _struct_name(bare), _struct_name(bare), kind
    elif isinstance(kind, types.BaseTuple):
        for index, part in enumerate(kind.types):
            yield from _leaves(f"{name}_{index}", part)
    elif kind != types.none:
        yield name, NAMES[kind], kind


def _struct_name(record: Any) -> str:
    """What a record is called in C, of Numba's type, which does not know its class."""
    names = {numba.from_dtype(struct.kind.layout): struct.name for struct in structs()}
    if record not in names:
        raise ForetouchError(f"entries.py has no Struct for a record of {', '.join(record.fields)}")
    return names[record]


def _memory(kind: Any) -> str:
    """LLVM's type of a result in memory."""
    if isinstance(kind, types.UniTuple):
        return f"[{kind.count} x {_memory(kind.dtype)}]"
    if isinstance(kind, types.BaseTuple):
        return f"{{ {', '.join(map(_memory, kind.types))} }}"
    return "ptr" if kind == types.none else WORDS[NAMES[kind]]


def _places(kind: Any, at: str = "") -> Iterator[str]:
    """Where the numbers of a result are, as indices."""
    if isinstance(kind, types.BaseTuple):
        for index, part in enumerate(kind.types):
            yield from _places(part, f"{at}, i32 {index}")
    elif kind != types.none:
        yield at


def _wrapper(function: Function, called: str, leaves: list[tuple[str, Any, Any]], result: Any) -> str:
    """A function with C's calling convention that calls a kernel with Numba's.

    Numba's takes where to put the result and the error, and of an array its size, steps and address. It returns 0, or
    -2 for None; anything else is an error.
    """
    given, passed, widened = [], [("ptr", "%result"), ("ptr", "%error")], []
    for index, (_, kind, typed) in enumerate(leaves):
        own = f"%p{index}"
        word = WORDS.get(kind, "ptr")
        if kind == "bool":
            given.append(f"i1 noundef zeroext {own}")
            widened.append(f"%b{index} = zext i1 {own} to i8")
            own = f"%b{index}"
        else:
            given.append(f"{word} noundef {own}")
        if isinstance(typed, types.Array):
            size = ("i64", str(typed.dtype.size))
            passed += [("ptr", "null"), ("ptr", "null"), ("i64", "1"), size, ("ptr", own), ("i64", "1"), size]
        else:
            passed.append((word, own))
    handed, returned, last = _handed_on(function, result)
    if returned == "void":
        given += [f"ptr noundef %r{index}" for index in range(len(function.results))]
    called_with = ", ".join(map(" ".join, passed))
    return f"""
declare i32 @{called}({", ".join(kind for kind, _ in passed)})
declare void @{RAISES}{function.name}()
define {returned} @{PREFIX}{function.name}({", ".join(given)}) {{
  %result = alloca {_memory(result)}
  %error = alloca ptr
  {LINE.join(widened)}
  %code = call i32 @{called}({called_with})
  %none = icmp eq i32 %code, -2
  %done = icmp eq i32 %code, 0
  %right = or i1 %done, %none
  br i1 %right, label %go, label %wrong
wrong:
  call void @{RAISES}{function.name}()
  unreachable
go:
  {LINE.join(handed)}
  ret {last}
}}
"""


def _handed_on(function: Function, result: Any) -> tuple[list[str], str, str]:
    """How a function hands on its results: the lines, its own type, and what it returns."""
    if len(function.results) == 1:
        word, kind = WORDS[function.results[0][1]], function.results[0][1]
        lines = [f"%r = load {word}, ptr %result"]
        if kind == "bool":
            return [*lines, "%t = icmp ne i8 %r, 0"], "zeroext i1", "i1 %t"
        return lines, word, f"{word} %r"
    lines = []
    for index, ((_, kind), place) in enumerate(zip(function.results, _places(result), strict=True)):
        lines.append(f"%a{index} = getelementptr {_memory(result)}, ptr %result, i32 0{place}")
        lines.append(f"%v{index} = load {WORDS[kind]}, ptr %a{index}")
        lines.append(f"store {WORDS[kind]} %v{index}, ptr %r{index}")
    return lines, "void", "void"


def _initial(begin: Beginning) -> str:
    """A function of C that writes what a new record holds, from tables."""
    words, pieces = packed(begin.record)
    size = f"[{len(pieces)} x i16]"
    return f"""
{_table(f"{begin.name}.words", 64, words)}
{_table(f"{begin.name}.pieces", 16, pieces)}
define void @{PREFIX}{begin.name}(ptr noundef %record) {{
  %end = getelementptr {size}, ptr @{begin.name}.pieces, i64 1
  call void @unpack(ptr %record, ptr @{begin.name}.words, ptr @{begin.name}.pieces, ptr %end)
  ret void
}}
"""


def _table(name: str, bits: int, values: list[int]) -> str:
    rows = ", ".join(f"i{bits} {value}" for value in values)
    return f"@{name} = internal constant [{len(values)} x i{bits}] [{rows}]"


def _hide(module: Any, kept: set[str]) -> None:
    """Make everything internal but what is kept, and call it what it is called in Python: Numba's names count up."""
    for index, one in enumerate([*module.functions, *module.global_variables]):
        if one.is_declaration or one.name in kept:
            continue
        one.linkage = "internal"
        one.name = f"{_plain(one.name)}.{index}"


def _plain(mangled: str) -> str:
    """A function's name in Python, of the one that Numba gives it: the lengths of its words, each before it."""
    words, rest = [], mangled.removeprefix("_ZN")
    while length := re.match(r"\d+", rest):
        end = length.end() + int(length[0])
        words.append(rest[length.end() : end])
        rest = rest[end:]
    return ".".join(words) or "of"


def _optimise(module: Any, machine: Any) -> None:
    """Leave out and inline what is small then."""
    for one in module.functions:
        if not one.is_declaration:
            one.add_function_attribute("minsize")
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, builder)
    builder.getModulePassManager().run(module, builder)
    passes.run(module, builder)
