"""Find words that `docs/glossary.md` replaces, in texts and in names."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "glossary.md"
PACKAGES = ("controller", "drivers", "emulators", "messages")
FORCES = {"force", "weight", "friction", "load", "per"}  # `_per_n` is a quotient


@dataclass(frozen=True)
class Word:
    """A replaced word, and the one to use."""

    text: str
    use: str


@dataclass(frozen=True)
class Finding:
    """A replaced word in a text."""

    where: str
    line: int
    word: Word
    excerpt: str

    def __str__(self) -> str:
        return f"{self.where}:{self.line}: `{self.word.text}` ({self.word.use}): {self.excerpt}"


def words(page: str) -> list[Word]:
    """Return the bold words of the table's right column."""
    rows = (line.strip().strip("|").split("|") for line in page.splitlines() if line[:1] == "|")
    return [
        Word(text.lower(), row[0].strip())
        for row in rows
        if len(row) == 3
        for text in re.findall(r"\*\*([^*]+)\*\*", row[2])
    ]


def in_text(text: str, replaced: Iterable[Word], where: str = "") -> list[Finding]:
    """Return each replaced word in a text, with the line it stands in."""
    findings = []
    for word in replaced:
        spaced = r"\s+".join(re.escape(part) for part in word.text.split())
        for match in re.finditer(rf"(?<!\w){spaced}(?:e?s)?(?!\w)", text, re.IGNORECASE):
            line = text.count("\n", 0, match.start()) + 1
            excerpt = text.splitlines()[line - 1].strip()
            findings.append(Finding(where, line, word, excerpt))
    return findings


def comments_of(yaml: str) -> str:
    """Return the comments of a YAML text, each in its line."""
    return "\n".join(
        match[1] if (match := re.search(r"(?:^|\s)#(.*)$", line)) else ""
        for line in yaml.splitlines()
    )


def messages_of(source: str) -> str:
    """Return the texts of the errors a module raises, each in its line, without code spans."""
    lines = [""] * (source.count("\n") + 2)
    for raised in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Raise)):
        for node in ast.walk(raised):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                lines[node.lineno - 1] += " " + " ".join(node.value.split())
    return "\n".join(re.sub(r"`[^`]*`", "", line) for line in lines)


@cache
def tokens(name: str) -> tuple[str, ...]:
    """Return the words a name is made of: `T_world_partPose` -> t, world, part, pose."""
    parts = re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)
    return tuple(part.lower() for part in parts)


def replaced_in_name(name: str, replaced: Iterable[Word]) -> list[Word]:
    """Return the replaced words that a name holds."""
    own = " ".join(tokens(name))
    return [
        word for word in replaced if re.search(rf"\b{' '.join(tokens(word.text))}(?:e?s)?\b", own)
    ]


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
