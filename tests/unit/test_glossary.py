"""The glossary's words where users meet them; the checker is checked with planted words."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest
import typer
from babel.messages.pofile import read_po
from glossary import (
    PACKAGES,
    PAGE,
    ROOT,
    Word,
    comments_of,
    in_text,
    messages_of,
    misnamed,
    replaced_in_name,
    words,
)

from controller.cli.app import app

TABLE = """
| use | meaning | not |
|---|---|---|
| TCP; `T_world_tcp` | a point | **tip**, **hand frame** |
| stable pose | way a part rests | **way to lie**, lying |
| grasp | how a gripper holds | **grip** |
| nominal | as drawn | |
"""


@pytest.fixture(scope="module")
def replaced() -> list[Word]:
    return words(PAGE.read_text(encoding="utf-8"))


@pytest.fixture
def planted() -> list[Word]:
    return words(TABLE)


def helps(command: Any, name: str) -> Iterator[tuple[str, str]]:
    """Return each help text of a command and of those below it; it holds names and options."""
    yield name, command.get_help(command.context_class(command, info_name=name))
    for below, one in getattr(command, "commands", {}).items():
        yield from helps(one, f"{name} {below}")


def keys_of(schema: Any) -> Iterator[str]:
    """Return the keys that a JSON schema names."""
    for node in schema.values() if isinstance(schema, dict) else schema:
        if isinstance(node, dict | list):
            yield from keys_of(node)
    if isinstance(schema, dict):
        yield from schema.get("properties", {})


def report(findings: list[Any]) -> str:
    return "\n" + "\n".join(map(str, findings))


def test_commands_use_the_glossarys_words(replaced: list[Word]) -> None:
    texts = dict(helps(typer.main.get_command(app), "cellctl"))
    assert len(texts) > 10  # a walk that found nothing would prove nothing
    findings = [f for name, text in texts.items() for f in in_text(text, replaced, name)]
    assert not findings, report(findings)


def test_keys_of_files_use_them(replaced: list[Word]) -> None:
    schemas = sorted((ROOT / "docs" / "schemas").glob("*.json"))
    keys = {key for path in schemas for key in keys_of(json.loads(path.read_text("utf-8")))}
    assert len(keys) > 200
    findings = {key: found for key in keys if (found := replaced_in_name(key, replaced))}
    assert not findings


def test_comments_in_recipes_use_them(replaced: list[Word]) -> None:
    files = sorted((ROOT / "recipes").rglob("*.yaml"))
    assert len(files) > 5
    findings = [
        f
        for path in files
        for f in in_text(comments_of(path.read_text(encoding="utf-8")), replaced, path.name)
    ]
    assert not findings, report(findings)


def test_messages_use_them(replaced: list[Word]) -> None:
    sources = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    texts = {str(p.relative_to(ROOT)): messages_of(p.read_text(encoding="utf-8")) for p in sources}
    assert sum(map(bool, map(str.strip, texts.values()))) > 200
    findings = [f for name, text in texts.items() for f in in_text(text, replaced, name)]
    assert not findings, report(findings)


def test_sentences_of_the_page_use_them(replaced: list[Word]) -> None:
    catalogues = sorted((ROOT / "controller/page/frame/catalogues").rglob("*.po"))
    catalogues += sorted((ROOT / "messages/catalogues").rglob("*.po"))
    for path in catalogues:
        with path.open("rb") as file:
            texts = [str(message.id) for message in read_po(file)]
        assert len(texts) > 10
        findings = [f for text in texts for f in in_text(text, replaced, path.name)]
        assert not findings, report(findings)
    assert catalogues


def test_the_bold_words_of_the_right_column_are_read(planted: list[Word]) -> None:
    assert [word.text for word in planted] == ["tip", "hand frame", "way to lie", "grip"]


def test_the_glossary_has_words_to_look_for(replaced: list[Word]) -> None:
    assert len(replaced) > 30


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("The tip is hot.", ["tip"]),
        ("Tips are hot.", ["tip"]),
        ("a tipping point, multiple, griped", []),
        ("the hand\nframe", ["hand frame"]),
        ("it is lying there", []),
        ("tip-pose", ["tip"]),
        ("gripper", []),
    ],
)
def test_planted_words_are_found_in_texts(text: str, found: list[str], planted: list[Word]) -> None:
    assert [finding.word.text for finding in in_text(text, planted)] == found


def test_a_finding_names_file_line_and_the_word_to_use(planted: list[Word]) -> None:
    (finding,) = in_text("one\ntwo\nits tip is hot", planted, "page")
    assert str(finding) == "page:3: `tip` (TCP; `T_world_tcp`): its tip is hot"


def test_comments_are_read_and_values_are_not(planted: list[Word]) -> None:
    text = comments_of("# a tip\ngrip: 3   # way to lie\nname: tip#1\n")
    found = [(finding.line, finding.word.text) for finding in in_text(text, planted)]
    assert found == [(1, "tip"), (2, "way to lie")]


def test_messages_are_read_and_other_texts_are_not(planted: list[Word]) -> None:
    source = '''"""The tip."""
key = "tip"
raise ValueError(f"{key}: the tip of `grip`")
'''
    (finding,) = in_text(messages_of(source), planted)
    assert (finding.line, finding.word.text) == (3, "tip")


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("T_world_tip", ["tip"]),
        ("tips_mm", ["tip"]),
        ("HandFrame", ["hand frame"]),
        ("hand_frame_of", ["hand frame"]),
        ("frame_hand", []),
        ("GripRules", ["grip"]),
        ("gripper", []),
        ("stipple", []),
    ],
)
def test_planted_words_are_found_in_names(name: str, found: list[str], planted: list[Word]) -> None:
    assert [word.text for word in replaced_in_name(name, planted)] == found


def test_counts_end_in_count_and_limits_are_min_and_max() -> None:
    sources = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    assert len(sources) > 300
    found = {
        str(path.relative_to(ROOT)): names
        for path in sources
        if (names := misnamed(path.read_text(encoding="utf-8")))
    }
    assert not found


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("TURNS_N = 3", {"TURNS_N"}),
        ("_PIECES_N: Final = 3", {"_PIECES_N"}),
        ("def f(seeds_n): wrong_n, n = 1, 2", {"seeds_n", "wrong_n"}),
        ("class A:\n    def views_n(self): self.lost_n += 1", {"views_n", "lost_n"}),
        ("MAX_FORCE_N = min_force_n = weight_n = ma_per_n = 1", set()),
        ("turn_count = given.others_n", set()),
        ("MOST_BYTES, _LEAST_MM, CORE_MOST = 1, 2, 3", {"MOST_BYTES", "_LEAST_MM", "CORE_MOST"}),
        ("MAX_BYTES = least_moved = 3", set()),
    ],
)
def test_planted_misnomers_are_found(source: str, found: set[str]) -> None:
    assert misnamed(source) == found
