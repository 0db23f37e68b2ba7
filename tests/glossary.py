"""Find words that `docs/glossary.md` replaces: in prose, help texts, docstrings, public names.

python tests/glossary.py              what is found now
python tests/glossary.py --shrink     take names that are gone off tests/data/names_to_rename.toml
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "glossary.md"
TO_RENAME = ROOT / "tests" / "data" / "names_to_rename.toml"
PACKAGES = ("controller", "drivers", "emulators")
ANY = "any"
FORCES = {"force", "weight", "friction", "load", "per"}  # `_per_n` is a quotient

NOTE = """\
# Public names that hold a word `docs/glossary.md` replaces, by room. The list only gets
# shorter: rename one, then run `python tests/glossary.py --shrink`. A new name with such a word
# fails tests/unit/test_glossary.py.
"""


@dataclass(frozen=True)
class Word:
    """A word of the right column, and the phrases in which it is right.

    ``in_prose`` and ``in_names`` are None where no test looks for the word.
    """

    text: str
    use: str
    in_prose: tuple[str, ...] | None = ()
    in_names: tuple[str, ...] | None = ()


@dataclass(frozen=True)
class Finding:
    """A replaced word in prose."""

    where: str
    line: int
    word: Word
    excerpt: str

    def __str__(self) -> str:
        return f"{self.where}:{self.line}: `{self.word.text}` ({self.word.use}): {self.excerpt}"


def _rows(text: str, heading: str) -> Iterator[list[str]]:
    """Return the cells of the table whose first heading is ``heading``."""
    lines = iter(text.splitlines())
    for line in lines:
        if line.startswith(f"| {heading} |"):
            break
    next(lines, None)
    for line in lines:
        if not line.startswith("|"):
            return
        yield [cell.strip() for cell in line.strip().strip("|").split("|")]


def _listed(cell: str) -> tuple[str, ...]:
    plain = re.sub(r"\([^)]*\)", "", cell).replace("`", "").replace('"', "")
    return tuple(word.strip().lower() for word in plain.split(",") if word.strip())


def words(page: str) -> list[Word]:
    """Return the words of the right column.

    Raises
    ------
    ValueError
        The second table names a word that the first does not have.
    """
    right: dict[str, tuple[str, str]] = {}
    for word, prose, names, _ in _rows(page, "word"):
        right[word] = (prose, names)
    found = []
    for use, _, instead in _rows(page, "use"):
        for text in _listed(instead):
            allowed = (None if cell == ANY else _listed(cell) for cell in right.get(text, ("", "")))
            found.append(Word(text, use, *allowed))
    strays = set(right) - {word.text for word in found}
    if strays:
        raise ValueError(f"not in the right column: {', '.join(sorted(strays))}")
    return found


def _pattern(phrase: str, plural: bool) -> str:
    spaced = r"\s+".join(re.escape(part) for part in phrase.split())
    return rf"(?<![\w-]){spaced}{'(?:e?s)?' if plural else ''}(?![\w-])"


def in_prose(text: str, replaced: Iterable[Word], where: str = "") -> list[Finding]:
    """Return each replaced word in a text, with the line it stands in."""
    findings = []
    lowered = text.casefold()
    for word in replaced:
        # most texts have no part of most words: a plain search is far quicker than a pattern
        if word.in_prose is None or not all(p.casefold() in lowered for p in word.text.split()):
            continue
        allowed = [
            match.span()
            for phrase in word.in_prose
            for match in re.finditer(_pattern(phrase, plural=False), text, re.IGNORECASE)
        ]
        # a hyphen joins: `hand-eye` is `hand` and `eye`, `hand-off` is allowed by name
        pattern = _pattern(word.text, plural=True).replace("(?<![\\w-])", r"(?<!\w)")
        pattern = pattern.replace("(?![\\w-])", r"(?!\w)")
        for match in re.finditer(pattern, text, re.IGNORECASE):
            if any(a <= match.start() and match.end() <= b for a, b in allowed):
                continue
            line = text.count("\n", 0, match.start()) + 1
            excerpt = text.splitlines()[line - 1].strip()
            findings.append(Finding(where, line, word, excerpt))
    return findings


def prose_of(markdown: str) -> str:
    """Return a document without code, targets of links and comments; lines keep their numbers."""

    def blank(match: re.Match[str]) -> str:
        return re.sub(r"[^\n]", "", match[0]) or " "

    text = re.sub(r"^```.*?^```", blank, markdown, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->", blank, text, flags=re.DOTALL)
    text = re.sub(r"`[^`]*`", lambda match: "`" + blank(match).strip(" ") + "`", text)
    return re.sub(r"\]\([^)]*\)", "]", text)


def comments_of(yaml: str) -> str:
    """Return the comments of a YAML text, each in its line."""
    return "\n".join(
        match[1] if (match := re.search(r"(?:^|\s)#(.*)$", line)) else ""
        for line in yaml.splitlines()
    )


def docstrings_of(source: str) -> str:
    """Return all docstrings of a module, each in its lines; without code spans and paths."""
    tree = ast.parse(source)
    written = source.splitlines()
    lines = [""] * (source.count("\n") + 2)
    for node in ast.walk(tree):
        kinds = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            text = node.body[0]
            for number in range(text.lineno, (text.end_lineno or text.lineno) + 1):
                lines[number - 1] = written[number - 1]
    plain = re.sub(r"\S+\.(?:md|py|yaml)\b", "", "\n".join(lines))
    return re.sub(r"(`+)[^`]*\1", lambda match: "`" + re.sub(r"[^\n]", "", match[0]), plain)


@cache
def tokens(name: str) -> tuple[str, ...]:
    """Return the words a name is made of: `T_world_partPose` -> t, world, part, pose."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    return tuple(part.lower() for part in parts)


def _contains(name: tuple[str, ...], phrase: tuple[str, ...], plural: bool) -> list[int]:
    ends = {phrase[-1], phrase[-1] + "s", phrase[-1] + "es"} if plural else {phrase[-1]}
    size = len(phrase)
    return [
        k
        for k in range(len(name) - size + 1)
        if name[k : k + size - 1] == phrase[:-1] and name[k + size - 1] in ends
    ]


def replaced_in_name(name: str, replaced: Iterable[Word]) -> list[Word]:
    """Return the words of the right column that a name holds."""
    own = tokens(name)
    found = []
    for word in replaced:
        if word.in_names is None:
            continue
        held = _contains(own, tokens(word.text), plural=True)
        if not held:
            continue
        covered = {
            at + step
            for phrase in word.in_names
            for at in _contains(own, tokens(phrase), plural=False)
            for step in range(len(tokens(phrase)))
        }
        if any(at not in covered for at in held):
            found.append(word)
    return found


def _arguments(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[str]:
    every = node.args
    for argument in (*every.posonlyargs, *every.args, *every.kwonlyargs, every.vararg, every.kwarg):
        if argument is not None:
            yield argument.arg


def _defined(body: list[ast.stmt]) -> Iterator[str]:
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            is_special = node.name.startswith("__")
            if is_special or not node.name.startswith("_"):
                yield node.name
                yield from _arguments(node)
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name
            yield from _defined(node.body)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.If):  # TYPE_CHECKING, versions
            yield from _defined(node.body)


def public_names(source: str) -> set[str]:
    """Return a module's public names: classes, functions, parameters, fields, constants."""
    return {name for name in _defined(ast.parse(source).body) if not name.startswith("_")}


def misnamed(source: str) -> set[str]:
    """Return the names a module gives that break the rules of names in the page's grammar.

    They end in `_n` and are no force, since a count ends in `_count`; or they are constants with
    MOST or LEAST, since a limit is MAX or MIN.
    """
    given = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            given.add(node.name)
        elif isinstance(node, ast.arg):
            given.add(node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            given.add(node.id)
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            given.add(node.attr)
    ending = {name for name in given if name.lower().endswith("_n")}
    counts = {name for name in ending if not FORCES & set(tokens(name))}
    return counts | {n for n in given if n.isupper() and {"most", "least"} & set(tokens(n))}


def names_found(root: Path, replaced: Iterable[Word]) -> dict[str, set[str]]:
    """Return the public names that hold a replaced word, by room."""
    known = list(replaced)
    found: dict[str, set[str]] = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            names = public_names(path.read_text(encoding="utf-8"))
            names |= {part for part in parts if not part.startswith("_")}
            bad = {name for name in names if replaced_in_name(name, known)}
            if bad:
                found.setdefault(".".join(parts[: min(2, len(parts) - 1)]), set()).update(bad)
    return found


def listed_names(text: str) -> dict[str, set[str]]:
    """Return the names still to be renamed, by room.

    Raises
    ------
    ValueError
        A room's count is not that of its names.
    """
    rooms = tomllib.loads(text)
    for room, row in rooms.items():
        if row["count"] != len(set(row["names"])):
            raise ValueError(
                f"{room}: {len(set(row['names']))} names, and a count of {row['count']}"
            )
    return {room: set(row["names"]) for room, row in rooms.items()}


def as_toml(rooms: Mapping[str, set[str]]) -> str:
    """Return the list as it is kept."""
    blocks = [NOTE]
    for room in sorted(rooms):
        names = "".join(f'    "{name}",\n' for name in sorted(rooms[room]))
        blocks.append(f'["{room}"]\ncount = {len(rooms[room])}\nnames = [\n{names}]\n')
    return "\n".join(blocks)


def shrunk(
    listed: Mapping[str, set[str]], found: Mapping[str, set[str]]
) -> tuple[dict[str, set[str]], set[str]]:
    """Take what is gone off the list; a name may move to another room, none may be new.

    Returns
    -------
    The list as it may be now, and the names that are new.
    """
    had = Counter(name for names in listed.values() for name in names)
    has = Counter(name for names in found.values() for name in names)
    new = {name for name in has if has[name] > had[name]}
    kept = {room: names - new for room, names in found.items()}
    return {room: names for room, names in kept.items() if names}, new


def _main(arguments: list[str]) -> int:
    found = names_found(ROOT, words(PAGE.read_text(encoding="utf-8")))
    if "--shrink" not in arguments:
        print(as_toml(found))  # noqa: T201 - its whole purpose
        return 0
    rooms, new = shrunk(listed_names(TO_RENAME.read_text(encoding="utf-8")), found)
    TO_RENAME.write_text(as_toml(rooms), encoding="utf-8")
    if new:
        print("new, to be renamed: " + ", ".join(sorted(new)))  # noqa: T201 - its whole purpose
    return 1 if new else 0


if __name__ == "__main__":
    raise SystemExit(_main(sys.argv[1:]))
