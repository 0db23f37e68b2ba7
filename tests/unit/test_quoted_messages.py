"""What the documents quote of the messages is what the code says."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("operating/*", "commissioning", "planning", "parts")  # a guide by all its chapters
HEADS = {
    "message begins with", "the start reports", "reason in the report", "the sentence says",
    "message", "message says", "end", "answer",
}  # fmt: skip
COLUMN = {"end": 1}  # of the quotation; 0 otherwise
COMPOSED = {  # sentences that the code puts together from pieces
    "The fixed gripper holds a part", "its journal knew of this cell, but it is gone",
}  # fmt: skip
MIN_LENGTH = 5
VALUE = r"\.\.\.|\bN\b|\d[\d,.]*| / "  # what a message fills in, and what parts two messages


def literals() -> list[str]:
    """Return the texts in the code; a zero stands for what is filled in."""
    found = []
    for room in ("controller", "drivers"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.JoinedStr):
                    parts = (v.value if isinstance(v, ast.Constant) else "\0" for v in node.values)
                    found.append("".join(map(str, parts)))
                elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                    found.append(node.value)
    return found


def quotations(text: str) -> Iterator[str]:
    """Return the messages in a page's tables: its code spans, or the whole cell if it has none."""
    head: str | None = None
    for line in text.splitlines():
        if not line.startswith("|"):
            head = None
            continue
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line.strip().strip("|"))]
        if head is None:
            head = cells[0]
        elif head in HEADS and not cells[0].startswith("--"):
            cell = cells[COLUMN.get(head, 0)]
            spans = re.findall(r"`([^`]*)`", cell)
            if spans or head != "answer":
                yield from spans or [cell]


def pieces(quotation: str) -> list[str]:
    """Return what of a quotation stands in the code as it is."""
    found = (piece.strip(" ,.;:()%") for piece in re.split(rf"{VALUE}|[:;()]", quotation))
    return [piece for piece in found if len(piece) >= MIN_LENGTH]


def unknown(text: str, known: list[str]) -> list[str]:
    """Return the pieces that no text of the code holds."""
    return [
        piece
        for quotation in quotations(text)
        for piece in pieces(quotation)
        if piece not in COMPOSED and not any(piece in literal for literal in known)
    ]


@pytest.fixture(scope="module")
def known() -> list[str]:
    return literals()


@pytest.mark.parametrize("page", PAGES)
def test_documents_quote_messages_as_they_are(page: str, known: list[str]) -> None:
    found = sorted((ROOT / "docs").glob(f"{page}.md"))
    text = "\n".join(path.read_text(encoding="utf-8") for path in found)
    assert len(list(quotations(text))) > 3  # a pattern that finds nothing proves nothing
    assert not unknown(text, known)


def test_a_message_that_has_changed_is_noticed() -> None:
    text = (
        "| message | what to do |\n|---|---|\n| `the jaws met ... at 3 mm` | look |\n| old | - |\n"
    )
    assert unknown(text, ["the jaws met \0 at \0 mm"]) == []
    assert unknown(text, ["the jaws hit \0"]) == ["the jaws met"]
