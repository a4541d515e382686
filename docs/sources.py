"""What a piece of code is made of: the definitions that it reaches by name, read from the sources and not run.

From a function on, every name that its text uses is followed to where it is defined: in the same file, through imports
(those inside of functions, too) and through packages that only pass a name on. What is reached is a set of top-level
definitions: functions, classes and constants, each with a digest of its syntax. Comments, docstrings and layout do not
count; neither do the annotations of arguments, which are never run, nor guards (``if ...: raise ...``): what was
measured to its end ran into none.

Objects bring their methods with them, for a class counts as a whole and whoever makes an object names its class. What
is only found by a string is followed where the string is the full name of a module or the name of a file beside the
text that holds it; where a name is put together while running, the caller says what it may become.
"""

from __future__ import annotations

import ast
import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

__all__ = ["Definition", "Sources"]

Definition = tuple[str, str]
"""Module and name; the name `` is what a module does when it is imported, ``*`` all of it."""

IMPORTED, WHOLE = "", "*"
DATA_FILE = re.compile(r"'(\w+\.json)'")
MODULE = re.compile(r"\w+(\.\w+)+", re.ASCII)
IMPORTS = (ast.Import, ast.ImportFrom)
LEADING = frozenset((*IMPORTS, ast.Attribute, ast.Name, ast.Constant))
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


class Module:
    """One file: which statement defines which name, and what each uses.

    Args:
        name: With dots.
        path: Of the file; ``__init__.py`` for a package.
        text: Its content.
    """

    def __init__(self, name: str, path: Path, text: str) -> None:
        self.name, self.path = name, path
        self.package = name if path.name == "__init__.py" else name.rpartition(".")[0]
        self.statements: dict[str, list[ast.stmt]] = {}
        self.imports: dict[str, Definition] = {}
        self._read: dict[str, tuple[str, list[ast.AST]]] = {}
        for statement in what_counts(ast.parse(text)).body:
            self._sort(statement)

    def _sort(self, statement: ast.stmt) -> None:
        """Under the names that a statement binds, or under the import of the module where it binds none."""
        if isinstance(statement, ast.If) and "TYPE_CHECKING" in ast.dump(statement.test):
            return
        if isinstance(statement, ast.If) and "__main__" in ast.dump(statement.test):
            return
        if isinstance(statement, IMPORTS):
            self.imports.update(self.imported(statement))
            return
        names = list(bound(statement))
        if names == ["__all__"]:
            return
        loops = isinstance(statement, ast.For | ast.While | ast.With | ast.Expr)
        for name in [IMPORTED] if loops or not names else names:
            self.statements.setdefault(name, []).append(statement)

    def imported(self, statement: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, Definition]]:
        """Each name that an import binds, and what it stands for."""
        if isinstance(statement, ast.Import):
            for alias in statement.names:
                whole = alias.name if alias.asname else alias.name.partition(".")[0]
                yield alias.asname or whole, (whole, WHOLE)
            return
        parents = self.package.split(".")[: len(self.package.split(".")) - statement.level + 1]
        module = ".".join([*(parents if statement.level else ()), *filter(None, [statement.module])])
        for alias in statement.names:
            yield alias.asname or alias.name, (module, alias.name)

    def digest(self, name: str) -> str:
        """Of the syntax of what defines a name, and of the data files beside the module that it names."""
        return self._reading(name)[0]

    def followed(self, name: str) -> list[ast.AST]:
        """The nodes of what defines a name that may lead elsewhere."""
        return self._reading(name)[1]

    def _reading(self, name: str) -> tuple[str, list[ast.AST]]:
        if name not in self._read:
            nodes: list[ast.AST] = []
            text = "\n".join([syntax(statement, nodes) for statement in self.statements.get(name, ())])
            digest = hashlib.sha256(text.encode())
            for file in DATA_FILE.findall(text):
                if (path := self.path.parent / file).is_file():
                    digest.update(path.read_bytes())
            self._read[name] = digest.hexdigest(), nodes
        return self._read[name]


class Sources:
    """The sources below some folders, read when they are asked for.

    Args:
        folders: In which modules are looked for, in this order.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = tuple(folders)
        self._modules: dict[str, Module | None] = {}
        self._uses: dict[Definition, frozenset[Definition]] = {}

    def module(self, name: str) -> Module | None:
        """A module; None where it is not below the folders."""
        if name not in self._modules:
            self._modules[name] = self._read(name)
        return self._modules[name]

    def _read(self, name: str) -> Module | None:
        for folder in self._folders:
            place = folder.joinpath(*name.split("."))
            for path in (place.with_suffix(".py"), place / "__init__.py"):
                if path.is_file():
                    return Module(name, path, path.read_text(encoding="utf-8"))
        return None

    def reached(self, roots: Iterable[str], ignored: Iterable[str] = ()) -> dict[Definition, str]:
        """Digest of every definition that is reached from some roots.

        Args:
            roots: Each ``module:name``, or ``module`` for all of it, or ``package.*`` for all modules of a package.
            ignored: Modules and packages that are not followed from others; as roots they are. A definition of one,
                ``module:name``, is not followed from anywhere.

        Raises:
            LookupError: There is no such root.
        """
        waiting = [definition for root in roots for definition in self._root(root)]
        left_out, alone = tuple(f"{one}." for one in ignored), {tuple(one.split(":")) for one in ignored if ":" in one}
        found: dict[Definition, str] = {}
        while waiting:
            definition = waiting.pop()
            if definition in found:
                continue
            module = self.module(definition[0])
            assert module is not None  # only such are resolved to
            found[definition] = module.digest(definition[1])
            for one in self.uses(definition):
                if one in found or one in alone:
                    continue
                if one[0] == definition[0] or not f"{one[0]}.".startswith(left_out):
                    waiting.append(one)
        return found

    def _root(self, root: str) -> list[Definition]:
        name, _, part = root.partition(":")
        package = self.module(name.removesuffix(".*"))
        if name.endswith(".*") and package is not None:
            inner = sorted(path.stem for path in package.path.parent.glob("*.py") if path != package.path)
            return [(f"{package.name}.{one}", WHOLE) for one in inner]
        resolved = self._resolve((name, part or WHOLE))
        if resolved is None:
            raise LookupError(f"there is no {root} in the sources, on which a measured table is said to depend")
        return [resolved]

    def uses(self, definition: Definition) -> frozenset[Definition]:
        """What a definition needs directly."""
        if definition not in self._uses:
            module = self.module(definition[0])
            assert module is not None
            resolved = {self._resolve(one) for one in self._named(module, definition[1])}
            self._uses[definition] = frozenset(one for one in resolved if one is not None)
        return self._uses[definition]

    def _named(self, module: Module, name: str) -> Iterator[Definition]:
        """What the text of a definition names, not yet followed to where that is defined."""
        yield module.name, IMPORTED
        if name == WHOLE:
            yield from ((module.name, one) for one in module.statements)
            if module.package == module.name:
                yield from module.imports.values()
        nodes, imports = module.followed(name), dict(module.imports)
        for node in nodes:
            if isinstance(node, IMPORTS):
                imports.update(module.imported(node))
        for node in nodes:
            if isinstance(node, ast.Constant):
                yield node.value, WHOLE
            elif words := dotted(node):
                if words[0] in imports:
                    yield self._through(imports[words[0]], words[1:])
                elif words[0] in module.statements:
                    yield module.name, words[0]

    def _through(self, target: Definition, words: list[str]) -> Definition:
        """What is asked of something that was imported, as far as that is a module."""
        name, part = target
        for word in words:
            inner = name if part == WHOLE else f"{name}.{part}"
            if self.module(inner) is None:
                break
            name, part = inner, word
        return name, part

    def _resolve(self, definition: Definition) -> Definition | None:
        """Where something is defined, through packages that only pass it on; None where that is outside."""
        name, part = definition
        module = self.module(name)
        if module is None:
            return None
        if part in (IMPORTED, WHOLE) or part in module.statements:
            return definition
        if part in module.imports:
            return self._resolve(module.imports[part])
        return (inner, WHOLE) if self.module(inner := f"{name}.{part}") is not None else None


def digest_of(reached: Mapping[Definition, str]) -> str:
    """Ten letters for everything that is reached, whichever module it stands in: what is moved computes the same."""
    text = "\n".join(sorted({f"{name} {digest}" for (_, name), digest in reached.items()}))
    return hashlib.sha256(text.encode()).hexdigest()[:10]


def syntax(node: object, leading: list[ast.AST] | None = None) -> str:
    """A tree as text, alike on every version of Python: what is empty is left out, for newer ones have more of that.

    Args:
        node: The tree, or a list of trees.
        leading: Takes every name, import and name of a module in it that is run, so not those of annotations of
            arguments; of ``a.b.c`` the whole and not its parts.
    """
    if isinstance(node, list):
        return f"[{','.join([syntax(one, leading) for one in node])}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    kind, inner = type(node), leading
    if leading is not None and kind in LEADING:
        if kind is not ast.Constant or (isinstance(node.value, str) and MODULE.fullmatch(node.value)):  # type: ignore[attr-defined]
            leading.append(node)
        inner = None if dotted(node) else leading
    parts = []
    for name in node._fields:
        value = getattr(node, name, None)
        if value is None or value == [] or name in ("ctx", "kind", "module"):  # an import is followed to its module
            continue
        unread = name == "returns" or (name == "annotation" and kind is ast.arg)
        read: list[ast.AST] | None = None if unread or inner is None else []
        parts.append(f"{name}={syntax(value, read)}")
        if read and inner is not None:
            inner += [one for one in read if name != "body" or not is_argument(one, node)]
    return f"{kind.__name__}({','.join(parts)})"


def what_counts(tree: ast.Module) -> ast.Module:
    """The tree without statements that are nothing but a string, and without guards, in place."""
    waiting: list[ast.AST] = [tree]
    while waiting:
        node = waiting.pop()
        for name in ("body", "orelse", "finalbody", "handlers"):
            inner = getattr(node, name, None)
            if isinstance(inner, list):
                setattr(node, name, kept := [one for one in inner if not (is_string(one) or is_guard(one))])
                waiting.extend(kept)
    return tree


def is_string(node: ast.AST) -> bool:
    """Whether a statement is a string and nothing else."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def is_guard(node: ast.AST) -> bool:
    """Whether a statement does nothing, or raises an error; what is assigned before that is for the error."""
    if not isinstance(node, ast.If) or node.orelse or not isinstance(node.body[-1], ast.Raise):
        return False
    return all(isinstance(one, ast.Assign) for one in node.body[:-1])


def bound(statement: ast.stmt) -> Iterator[str]:
    """Names that a top-level statement gives a value."""
    if isinstance(statement, (*FUNCTIONS, ast.ClassDef)):
        yield statement.name
    elif isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        for target in targets:
            yield from (node.id for node in ast.walk(target) if isinstance(node, ast.Name) and not loads(node))
    elif isinstance(statement, ast.If | ast.Try):
        for node in ast.walk(statement):
            if isinstance(node, ast.stmt) and node is not statement and not isinstance(node, ast.Expr):
                yield from bound(node)


def is_argument(one: ast.AST, node: ast.AST) -> bool:
    """Whether a name in the body of a function is that of one of its arguments, and so leads nowhere."""
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
        return False
    every = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
    return next(iter(dotted(one)), None) in {argument.arg for argument in every}


def loads(node: ast.Name) -> bool:
    """Whether a name is read and not written."""
    return isinstance(node.ctx, ast.Load)


def dotted(node: ast.AST) -> list[str]:
    """The words of ``a.b.c``; none where it begins with something else than a name."""
    words: list[str] = []
    while isinstance(node, ast.Attribute):
        words.append(node.attr)
        node = node.value
    return [node.id, *reversed(words)] if isinstance(node, ast.Name) else []
