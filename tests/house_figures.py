"""Figures of the house: how large it is, who imports whom, what stands twice, what is documented.

python tests/house_figures.py [CHECKOUT] [--json]

Reads the sources of a checkout and runs none of them. A room is a package two levels deep
(`controller.cad`), within `controller.planning` one of three. An arrow is one room that imports
another, however often; of n rooms n (n - 1) / 2 arrows are possible without a circle. A room's
own face (`__init__`) counts as one.

Duplicates: windows of eight lines and more that two places have alike, without comments,
docstrings, imports, `__all__` and layout. `same` keeps names and ignores literals; `alike` ignores
both, and looks into functions only: tables of constants are all alike.
Parameters: public functions and methods of three parameters and more (`self` is none), that have a
Parameters section. A command of the command line is documented by its help: each of its options
and arguments must have one, and its errors are messages, so that it needs no sections.
Raises: exceptions that a public function raises by name in its own body and does not catch there,
and whether its Raises section names them or a class above them that is defined in the checkout.
Returns: public functions that return a value, and whether the docstring says which: "Return" or
"Yield" in its first line, or a section. Commands, fields checked by pydantic and names like
`__len__` apart. A property is named like a thing: its docstring does not begin with "Return".
Lines by kind: code, docstrings, comments, empty. Classes are equal if their fields have the same
names, three at least.
Underscores: modules, or names of modules, with a leading underscore that tests, benchmarks, or a
package other than their own imports; or that a test names in a string, to replace it.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grimp

PRODUCTION = ("controller", "drivers", "emulators", "messages")
READERS = ("tests", "benchmarks")
PLANNING = "controller.planning"
WINDOW_LINES = 8
MAX_MODULES = 8
MIN_PARAMETERS = 3
# beyond which a function is listed: it may do more than one thing
MAX_LINES = 100
MAX_PARAMETERS = 12
KINDS = ("code", "docstrings", "comments", "empty")
MIN_FIELDS = 3  # fields that two classes have alike by chance

PROPERTIES = {"property", "cached_property"}
CHECKED_BY_OTHERS = {"overload", "field_validator", "model_validator", "field_serializer"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True, slots=True)
class Source:
    """A file of the checkout."""

    path: Path
    module: str
    is_package: bool
    text: str
    tree: ast.Module

    @property
    def package(self) -> str:
        """The package whose private modules it may import."""
        return self.module if self.is_package else self.module.rpartition(".")[0]


def read_sources(root: Path, tops: Iterable[str]) -> list[Source]:
    found = []
    for top in tops:
        for file in sorted((root / top).rglob("*.py")):
            path = file.relative_to(root)
            if "__pycache__" in path.parts or any(p.startswith(".") for p in path.parts):
                continue
            parts = path.with_suffix("").parts
            is_package = parts[-1] == "__init__"
            module = ".".join(parts[:-1] if is_package else parts)
            text = file.read_text(encoding="utf-8")
            found.append(Source(path, module, is_package, text, ast.parse(text)))
    return found


# -- size


def sizes(sources: list[Source]) -> dict[str, Any]:
    """Return files and lines of each folder, the lines by kind as well."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for source in sources:
        own = found[source.module.split(".")[0]]
        own["files"] += 1
        own["lines"] += source.text.count("\n")
        own.update(_kinds(source))
    return {top: dict.fromkeys(("files", "lines", *KINDS), 0) | own for top, own in found.items()}


def _kinds(source: Source) -> Counter[str]:
    """Return the number of a file's lines of each kind; one with code and a comment is code."""
    texts = source.text.splitlines()
    kinds = ["empty" if not t.strip() else "code" for t in texts]
    for number, text in enumerate(texts):
        if text.lstrip().startswith("#"):
            kinds[number] = "comments"
    for node in ast.walk(source.tree):
        if isinstance(node, Function | ast.ClassDef | ast.Module) and ast.get_docstring(node):
            first = node.body[0]
            end = first.end_lineno or first.lineno
            kinds[first.lineno - 1 : end] = ["docstrings"] * (end - first.lineno + 1)
    return Counter(kinds)


def longest(sources: list[Source]) -> dict[str, Any]:
    production = [s for s in sources if s.module.split(".")[0] in PRODUCTION]
    file = max(production, key=lambda s: s.text.count("\n"))
    functions = sorted(
        (
            {
                "lines": (node.end_lineno or node.lineno) - node.lineno + 1,
                "parameters": len([*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]),
                "where": f"{s.path}:{node.lineno} {node.name}",
            }
            for s in production
            for node in ast.walk(s.tree)
            if isinstance(node, Function)
        ),
        key=lambda one: -int(one["lines"]),
    )
    return {
        "file": {"path": str(file.path), "lines": file.text.count("\n")},
        "function": functions[0],
        "above_limits": [
            one
            for one in functions
            if int(one["lines"]) > MAX_LINES or int(one["parameters"]) > MAX_PARAMETERS
        ],
    }


def large_packages(sources: list[Source]) -> dict[str, int]:
    """Return the packages of more modules than one can look over, with their number.

    A room inside has a door of its own and is no module.
    """
    members: dict[str, set[str]] = defaultdict(set)
    for source in sources:
        if source.module.split(".")[0] in PRODUCTION and not source.is_package:
            members[source.module.rpartition(".")[0]].add(source.module)
    counts = {package: len(names) for package, names in members.items() if "." in package}
    return {p: n for p, n in sorted(counts.items()) if n > MAX_MODULES}


# -- who imports whom


def import_graph(root: Path) -> grimp.ImportGraph:
    """Return who imports whom in the production packages of a checkout."""
    sys.path.insert(0, str(root))
    try:
        return grimp.build_graph(*PRODUCTION, cache_dir=None)
    finally:
        sys.path.remove(str(root))


def _room_under(module: str, root: str) -> str:
    rest = module.removeprefix(root).lstrip(".")
    return rest.split(".")[0] or "__init__"


def arrows_within(graph: grimp.ImportGraph, root: str) -> dict[str, Any]:
    """Return rooms and arrows among the children of a package."""
    members = [m for m in graph.modules if m == root or m.startswith(f"{root}.")]
    rooms = {_room_under(m, root) for m in members}
    arrows: set[tuple[str, str]] = set()
    imports = 0
    for module in members:
        for other in graph.find_modules_directly_imported_by(module):
            if other != root and not other.startswith(f"{root}."):
                continue
            imports += 1
            arrow = (_room_under(module, root), _room_under(other, root))
            if arrow[0] != arrow[1]:
                arrows.add(arrow)
    return {
        "rooms": len(rooms),
        "arrows": len(arrows),
        "possible": len(rooms) * (len(rooms) - 1) // 2,
        "imports_between_modules": imports,
        "both_ways": sorted(f"{a} <-> {b}" for a, b in arrows if a < b and (b, a) in arrows),
    }


def arrows_between_rooms(graph: grimp.ImportGraph) -> dict[str, Any]:
    """Return rooms two levels deep and the arrows between them."""

    def room(module: str) -> str:
        return ".".join(module.split(".")[:2])

    rooms = {room(m) for m in graph.modules}
    arrows = {
        (room(m), room(other))
        for m in graph.modules
        for other in graph.find_modules_directly_imported_by(m)
        if room(m) != room(other)
    }
    return {
        "rooms": len(rooms),
        "arrows": len(arrows),
        "possible": len(rooms) * (len(rooms) - 1) // 2,
        "both_ways": sorted(f"{a} <-> {b}" for a, b in arrows if a < b and (b, a) in arrows),
    }


# -- what stands twice


def _code_lines(source: Source, keep_names: bool) -> list[tuple[int, str]]:
    """Return (line, its tokens) of a file; comments, docstrings, imports and `__all__` aside."""
    dropped: set[int] = set()
    for node in ast.walk(source.tree):
        is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        is_face = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
        if (
            isinstance(node, ast.Import | ast.ImportFrom)
            or is_face
            or (is_text and isinstance(node.value.value, str))
        ):
            dropped.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    if not keep_names:
        inside: set[int] = set()
        for node in ast.walk(source.tree):
            if isinstance(node, Function):
                inside.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
        dropped |= set(range(1, source.text.count("\n") + 2)) - inside
    by_line: dict[int, list[str]] = defaultdict(list)
    layout = {
        tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
        tokenize.ENDMARKER, tokenize.ENCODING,
    }  # fmt: skip
    keywords = {"def", "class", "return", "if", "for", "in", "else", "raise", "with", "not", "and"}
    for token in tokenize.generate_tokens(io.StringIO(source.text).readline):
        line = token.start[0]
        if token.type in layout or line in dropped:
            continue
        is_word = token.type == tokenize.NAME and (keep_names or token.string in keywords)
        by_line[line].append(token.string if is_word or token.type == tokenize.OP else "#")
    # a line of brackets says nothing, one of literals is a row of a table; neither is repetition
    return [
        (n, " ".join(tokens))
        for n, tokens in sorted(by_line.items())
        if any(t[0].isalpha() or t[0] == "_" or (t == "#" and not keep_names) for t in tokens)
    ]


def duplicates(sources: list[Source], keep_names: bool) -> dict[str, Any]:
    """Return how many pairs of places have eight lines and more alike, and the longest of them."""
    lines = [_code_lines(s, keep_names) for s in sources if s.module.split(".")[0] in PRODUCTION]
    paths = [s.path for s in sources if s.module.split(".")[0] in PRODUCTION]
    places: dict[tuple[str, ...], list[tuple[int, int]]] = defaultdict(list)
    for f, code in enumerate(lines):
        words = [text for _, text in code]
        for i in range(len(words) - WINDOW_LINES + 1):
            places[tuple(words[i : i + WINDOW_LINES])].append((f, i))
    pairs: set[tuple[int, int, int, int]] = set()
    for found in places.values():
        for k, (f, i) in enumerate(found):
            for g, j in found[k + 1 :]:
                if f != g or j - i >= WINDOW_LINES:
                    pairs.add((f, i, g, j))
    runs: list[tuple[int, str]] = []
    covered: set[tuple[int, int]] = set()
    for f, i, g, j in pairs:
        covered.update((f, i + k) for k in range(WINDOW_LINES))
        covered.update((g, j + k) for k in range(WINDOW_LINES))
        if (f, i - 1, g, j - 1) in pairs:
            continue
        more = 0
        while (f, i + more + 1, g, j + more + 1) in pairs:
            more += 1
        where = f"{paths[f]}:{lines[f][i][0]} {paths[g]}:{lines[g][j][0]}"
        runs.append((WINDOW_LINES + more, where))
    runs.sort(key=lambda run: (-run[0], run[1]))
    return {
        "pairs": len(runs),
        "lines_in_them": len(covered),
        "longest": [{"lines": n, "where": where} for n, where in runs[:10]],
    }


# -- what is documented


def public_functions(source: Source) -> Iterator[tuple[str, Function, bool]]:
    """Yield (name, function, is a method) of what others may call."""
    for node in source.tree.body:
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield node.name, node, False
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for member in node.body:
                if isinstance(member, Function) and not member.name.startswith("_"):
                    yield f"{node.name}.{member.name}", member, True


def _decorators(function: Function) -> set[str]:
    return {
        part.attr if isinstance(part, ast.Attribute) else part.id
        for decorator in function.decorator_list
        for part in ast.walk(decorator)
        if isinstance(part, ast.Attribute | ast.Name)
    }


def _parameter_count(function: Function, is_method: bool) -> int:
    a = function.args
    count = len(a.posonlyargs) + len(a.args) + len(a.kwonlyargs)
    count += (a.vararg is not None) + (a.kwarg is not None)
    return count - (is_method and "staticmethod" not in _decorators(function))


def _section(function: Function, title: str) -> str | None:
    """Return the text of a section of a NumPy docstring, None where it has none."""
    lines = (ast.get_docstring(function) or "").splitlines()
    for n, line in enumerate(lines[:-1]):
        if line.strip() == title and set(lines[n + 1].strip()) == {"-"}:
            rest = lines[n + 2 :]
            for k in range(len(rest) - 1):
                if rest[k + 1].strip() and set(rest[k + 1].strip()) == {"-"}:
                    return "\n".join(rest[:k])
            return "\n".join(rest)
    return None


def unlisted_parameters(sources: list[Source]) -> list[str]:
    """Return the parameters that a Parameters section of their function leaves out or hides."""
    missing = []
    for source in sources:
        if source.module.split(".")[0] not in PRODUCTION:
            continue
        for name, function, _ in public_functions(source):
            section = _section(function, "Parameters")
            if section is None:
                continue
            heads = re.findall(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*) :", section, re.MULTILINE)
            listed = {part.strip(" *") for head in heads for part in head.split(",")}
            every = function.args
            given = [*every.posonlyargs, *every.args, every.vararg, *every.kwonlyargs, every.kwarg]
            missing += [
                f"{source.path}:{function.lineno} {name}: {one.arg}"
                for one in given
                if one is not None and one.arg not in {"self", "cls", *listed}
            ]
    return missing


def _typer_calls(annotation: ast.expr | None) -> list[ast.Call]:
    """Return the `typer.Option(...)` and `typer.Argument(...)` within an annotation."""
    return [
        node
        for node in (ast.walk(annotation) if annotation is not None else ())
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr in ("Option", "Argument")
        and getattr(node.func.value, "id", "") == "typer"
    ]


def shared_options(sources: list[Source]) -> dict[str, list[ast.Call]]:
    """Return the options and arguments that have a name of their own, for several commands."""
    return {
        node.targets[0].id: calls
        for source in sources
        for node in source.tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        if (calls := _typer_calls(node.value))
    }


def command_options(
    function: Function, shared: dict[str, list[ast.Call]]
) -> list[list[ast.Call]] | None:
    """Return what typer is given for each parameter of a command, None for other functions.

    A command whose options are the fields of a dataclass has none among its parameters.
    """
    if "from_fields" in _decorators(function):
        return []
    parameters = [*function.args.args, *function.args.kwonlyargs]
    calls = [
        _typer_calls(p.annotation) or shared.get(getattr(p.annotation, "id", ""), [])
        for p in parameters
    ]
    return calls if calls and any(calls) else None


def has_help(option: list[ast.Call]) -> bool:
    """Return whether typer is given a help text for a parameter."""
    return any(word.arg == "help" for call in option for word in call.keywords)


def parameters_documented(sources: list[Source]) -> dict[str, Any]:
    shared = shared_options(sources)
    tally = _Tally()
    for source, name, function, is_method in _functions_of_production(sources):
        if "overload" in _decorators(function):
            continue
        options = command_options(function, shared)
        if options is None and _parameter_count(function, is_method) < MIN_PARAMETERS:
            continue
        if options is None:
            has_section = _section(function, "Parameters") is not None
        else:
            has_section = all(has_help(option) for option in options)
        tally.add(source, function, name, is_there=has_section)
    return tally.figures()


def _functions_of_production(
    sources: list[Source],
) -> Iterator[tuple[Source, str, Function, bool]]:
    """Yield (file, name, function, is a method) of what others may call in production."""
    for source in sources:
        if source.module.split(".")[0] in PRODUCTION:
            yield from ((source, *found) for found in public_functions(source))


class _Tally:
    """How many functions have something, package by package, and which have not."""

    def __init__(self) -> None:
        self._per_room: dict[str, Counter[str]] = defaultdict(Counter)
        self._missing: list[str] = []

    def add(self, source: Source, function: Function, words: str, *, is_there: bool) -> None:
        """Count one."""
        room = ".".join(source.module.split(".")[:2])
        self._per_room[room]["with" if is_there else "without"] += 1
        if not is_there:
            self._missing.append(f"{source.path}:{function.lineno} {words}")

    def figures(self) -> dict[str, Any]:
        """Return the sums, the figures of each package, and where something is missing."""
        rooms = sorted(self._per_room.items())
        return {
            "with": sum(c["with"] for _, c in rooms),
            "without": sum(c["without"] for _, c in rooms),
            "rooms": {room: {"with": c["with"], "without": c["without"]} for room, c in rooms},
            "missing": self._missing,
        }


def _own_raises(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield the classes raised by name under some nodes, but for functions and classes there.

    What a handler of the same name takes, and does not pass on by a bare `raise`, is not raised.
    """
    for node in nodes:
        if isinstance(node, Function | ast.ClassDef | ast.Lambda):
            continue
        if isinstance(node, ast.Try):
            caught: set[str] = set()
            for handler in node.handlers:
                inside = list(ast.walk(handler))
                if not any(isinstance(n, ast.Raise) and n.exc is None for n in inside):
                    caught |= _class_names(handler.type)
            yield from (name for name in _own_raises(node.body) if name not in caught)
            yield from _own_raises([*node.handlers, *node.orelse, *node.finalbody])
            continue
        if isinstance(node, ast.Raise) and node.exc is not None:
            yield from _class_names(node.exc.func if isinstance(node.exc, ast.Call) else node.exc)
        yield from _own_raises(ast.iter_child_nodes(node))


def _class_names(expression: ast.expr | None) -> set[str]:
    """Return the last names of what stands behind `raise` or `except`."""
    things = expression.elts if isinstance(expression, ast.Tuple) else [expression]
    return {t.attr if isinstance(t, ast.Attribute) else getattr(t, "id", "") for t in things}


def _raised(function: Function) -> set[str]:
    """Return the classes a function's own body raises by name; what it hands on is not its own."""
    names = set(_own_raises(function.body))
    return {name for name in names if name[:1].isupper() and name != "NotImplementedError"}


def _parents(sources: list[Source]) -> dict[str, set[str]]:
    """Return the names of the classes above each class of the checkout, itself included."""
    bases: dict[str, set[str]] = defaultdict(set)
    for source in sources:
        for node in ast.walk(source.tree):
            if isinstance(node, ast.ClassDef):
                bases[node.name] |= {
                    b.attr if isinstance(b, ast.Attribute) else getattr(b, "id", "")
                    for b in node.bases
                }
    above: dict[str, set[str]] = {}
    for name in bases:
        known, waiting = {name}, [name]
        while waiting:
            for base in bases.get(waiting.pop(), set()) - known:
                known.add(base)
                waiting.append(base)
        above[name] = known & set(bases)
    return above


def raises_documented(sources: list[Source]) -> dict[str, Any]:
    above = _parents(sources)
    shared = shared_options(sources)
    tally = _Tally()
    for source, name, function, _ in _functions_of_production(sources):
        if command_options(function, shared) is not None:
            continue
        section = _section(function, "Raises") or ""
        for error in sorted(_raised(function)):
            is_named = any(known in section for known in above.get(error, {error}))
            tally.add(source, function, f"{name}: {error}", is_there=is_named)
    return tally.figures()


def _returns_a_value(function: Function) -> bool:
    """Return whether the annotation promises a value; a block that yields nothing has none."""
    if function.returns is None:
        return False
    promised = ast.unparse(function.returns).strip("'")
    return promised not in {"None", "NoReturn", "Never"} and not promised.endswith("Iterator[None]")


def _says_what_it_returns(function: Function) -> bool:
    first = (ast.get_docstring(function) or "").partition("\n")[0]
    is_in_first = re.search(r"\b(return|yield)s?\b", first, re.IGNORECASE) is not None
    return is_in_first or any(_section(function, title) for title in ("Returns", "Yields"))


def returns_documented(sources: list[Source]) -> dict[str, Any]:
    """Return how many public functions say what they return, and the names of the others."""
    shared = shared_options(sources)
    tally = _Tally()
    for source, name, function, _ in _functions_of_production(sources):
        decorators = _decorators(function)
        if decorators & CHECKED_BY_OTHERS or not _returns_a_value(function):
            continue
        if command_options(function, shared) is not None:
            continue
        if decorators & PROPERTIES:
            first = ast.get_docstring(function) or ""
            is_said = not first.startswith(("Return", "Yield"))
        else:
            is_said = _says_what_it_returns(function)
        tally.add(source, function, name, is_there=is_said)
    return tally.figures()


# -- what an underscore promises


def _imported(source: Source) -> Iterator[tuple[int, str, str]]:
    """Yield (line, module, name) of what a file imports of the checkout; name "" for a module."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name, ""
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                own = source.package.split(".")
                kept = own[: len(own) - node.level + 1]
                base = ".".join([*kept, base] if base else kept)
            for alias in node.names:
                yield node.lineno, base, alias.name


def _quoted(source: Source) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted name) of what a file names of the checkout in strings."""
    for node in ast.walk(source.tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            top, _, rest = node.value.partition(".")
            if top in PRODUCTION and all(part.isidentifier() for part in rest.split(".")):
                yield node.lineno, node.value


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def underscores(sources: list[Source]) -> dict[str, Any]:
    """Return who imports private modules, or private names, that are not of its own package."""
    modules = {s.module for s in sources}
    by_readers: list[str] = []
    by_rooms: list[str] = []
    private: set[str] = set()
    for source in sources:
        top = source.module.split(".")[0]
        for line, base, name in _imported(source):
            if base.split(".")[0] not in PRODUCTION:
                continue
            full = f"{base}.{name}" if f"{base}.{name}" in modules else base
            parts = full.split(".")
            hidden = [k for k, part in enumerate(parts) if part.startswith("_")]
            owner = ".".join(parts[: hidden[0]]) if hidden else ""
            if hidden:
                is_own = f"{source.package}.".startswith(f"{owner}.")
            elif _is_private(name) and full == base:
                is_own = source.module == base
            else:
                continue
            if is_own:
                continue
            what = f"{source.path}:{line} {full}" + (f" {name}" if full == base else "")
            private.add(full)
            (by_readers if top in READERS else by_rooms).append(what)
        if top in READERS:
            for line, dotted in _quoted(source):
                if any(map(_is_private, dotted.split("."))):
                    private.add(dotted)
                    by_readers.append(f"{source.path}:{line} {dotted}")
    return {
        "by_tests_and_benchmarks": len(by_readers),
        "files_of_tests_and_benchmarks": len({w.split(":")[0] for w in by_readers}),
        "by_other_packages": len(by_rooms),
        "modules": sorted(private),
        "where": sorted({*by_readers, *by_rooms}),
    }


# -- names


def homonyms(sources: list[Source]) -> dict[str, list[str]]:
    """Return the files of each public class name of production that more than one file defines."""
    found: dict[str, list[str]] = {}
    for source in sources:
        if source.module.split(".")[0] == "controller":
            for node in source.tree.body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    found.setdefault(node.name, []).append(str(source.path))
    return {name: files for name, files in sorted(found.items()) if len(files) > 1}


def equal_classes(sources: list[Source]) -> list[dict[str, Any]]:
    """Return the classes of the controller whose fields have the same names."""
    found: dict[frozenset[str], list[str]] = defaultdict(list)
    for source in sources:
        if source.module.split(".")[0] != "controller":
            continue
        for node in ast.walk(source.tree):
            if isinstance(node, ast.ClassDef):
                fields = frozenset(
                    one.target.id
                    for one in node.body
                    if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)
                )
                if len(fields) >= MIN_FIELDS:
                    found[fields].append(f"{source.path}:{node.lineno} {node.name}")
    return [
        {"fields": len(fields), "classes": classes}
        for fields, classes in sorted(found.items(), key=lambda one: (-len(one[0]), one[1]))
        if len(classes) > 1
    ]


# -- all of it


def house_figures(root: Path) -> dict[str, Any]:
    """Return all figures of a checkout, ready for JSON."""
    sources = read_sources(root, (*PRODUCTION, *READERS))
    graph = import_graph(root)
    return {
        "sizes": sizes(sources),
        "longest": longest(sources),
        "packages_of_more_than_eight": large_packages(sources),
        "rooms": arrows_between_rooms(graph),
        "planning": arrows_within(graph, PLANNING),
        "duplicates": {
            "same": duplicates(sources, keep_names=True),
            "alike": duplicates(sources, keep_names=False),
        },
        "parameters": parameters_documented(sources),
        "raises": raises_documented(sources),
        "returns": returns_documented(sources),
        "underscores": underscores(sources),
        "homonyms": homonyms(sources),
        "equal_classes": equal_classes(sources),
    }


def print_table(figures: dict[str, Any]) -> None:
    for top, size in figures["sizes"].items():
        kinds = ", ".join(f"{size[kind]} {kind}" for kind in KINDS)
        print(f"{top:12} {size['files']:5} files {size['lines']:7} lines: {kinds}")
    file, function = figures["longest"]["file"], figures["longest"]["function"]
    print(f"longest file      {file['lines']:5} lines  {file['path']}")
    print(f"longest function  {function['lines']:5} lines  {function['where']}")
    print(f"functions of more than {MAX_LINES} lines or {MAX_PARAMETERS} parameters:")
    for one in figures["longest"]["above_limits"]:
        print(f"{one['lines']:7} lines {one['parameters']:3} parameters  {one['where']}")
    large = figures["packages_of_more_than_eight"]
    print(f"packages of more than {MAX_MODULES} modules: {len(large)}")
    for package, count in large.items():
        print(f"    {count:3} {package}")
    for what in ("rooms", "planning"):
        f = figures[what]
        name = "house" if what == "rooms" else PLANNING
        inside = f.get("imports_between_modules")
        print(
            f"{name}: {f['rooms']} rooms, {f['arrows']} arrows of {f['possible']}"
            + (f", {inside} imports between modules" if inside is not None else "")
            + (f"; both ways: {', '.join(f['both_ways'])}" if f["both_ways"] else "")
        )
    for kind, found in figures["duplicates"].items():
        print(
            f"duplicates of {WINDOW_LINES} lines and more, {kind}: {found['pairs']} pairs, "
            f"{found['lines_in_them']} lines"
        )
        for run in found["longest"][:3]:
            print(f"    {run['lines']:3} {run['where']}")
    for what in ("parameters", "raises", "returns"):
        f = figures[what]
        print(f"{what} documented: {f['with']} of {f['with'] + f['without']}")
        for room, c in f["rooms"].items():
            print(f"    {room:32} {c['with']:4} of {c['with'] + c['without']:4}")
    f = figures["underscores"]
    print(
        f"private modules and names imported from outside their package: "
        f"{f['by_tests_and_benchmarks']} times by {f['files_of_tests_and_benchmarks']} files of "
        f"tests and benchmarks, {f['by_other_packages']} times by other packages"
    )
    names = figures["homonyms"]
    print(f"class names of the controller that stand in two files and more: {len(names)}")
    for name, files in names.items():
        print(f"    {name:20} {', '.join(files)}")
    equal = figures["equal_classes"]
    print(f"classes of the controller with the same {MIN_FIELDS} fields and more: {len(equal)}")
    for one in equal:
        print(f"    {one['fields']:3} fields  {', '.join(one['classes'])}")


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    parser.add_argument(
        "checkout", type=Path, nargs="?", default=Path(__file__).resolve().parents[1]
    )
    args = parser.parse_args()
    figures = house_figures(args.checkout.resolve())
    if args.json:
        print(json.dumps(figures))
    else:
        print_table(figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
