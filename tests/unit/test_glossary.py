"""The words of docs/glossary.md everywhere; the checker is checked with planted words."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from glossary import (
    PACKAGES,
    PAGE,
    TO_RENAME,
    Word,
    as_toml,
    comments_of,
    docstrings_of,
    in_prose,
    listed_names,
    misnamed,
    names_found,
    prose_of,
    public_names,
    replaced_in_name,
    shrunk,
    words,
)

from controller.cli.app import app

ROOT = Path(__file__).resolve().parents[2]

# Words that docstrings also use rightly, and why no list of phrases would do.
RIGHT_IN_DOCSTRINGS = {
    "way": "both ways, the other way round, on the way to: directions and progress",
    "tip": "the verb: a part tips; the end of a drilled hole or a finger",
    "hand": "hand off, hand out, hand the line over, in our hands",
    "hand over": "which board of the arm has the line",
    "handing": "the same; handing off",
}

TABLES = """
| use | meaning | not |
|---|---|---|
| TCP; `T_world_tcp` | a point | tip, hand frame |
| stable pose | way a part rests | way to lie, lying, "how it lies" |
| grasp | how a gripper holds | grip |
| characteristic | to be verified | check (a verb) |
| nominal | as drawn | |

| word | right in prose | right in names | since |
|---|---|---|---|
| tip | tips over, finger tips | tip energy | |
| check | any | any | |
"""


@pytest.fixture(scope="module")
def replaced() -> list[Word]:
    return words(PAGE.read_text(encoding="utf-8"))


@pytest.fixture
def planted() -> list[Word]:
    return words(TABLES)


def documents() -> list[Path]:
    """Return the pages that are checked; `docs/protocols` keeps the words of the manuals."""
    docs = ROOT / "docs"
    below = [
        page
        for folder in ("adr", "measurements", "operating")
        for page in (docs / folder).glob("*.md")
    ]
    pages = [*ROOT.glob("*.md"), *docs.glob("*.md"), *below]
    return sorted(page for page in pages if page != PAGE)


def helps(command: Any, name: str) -> Iterator[tuple[str, str]]:
    """Return each help text of a command and of those below it."""
    yield name, command.get_help(command.context_class(command, info_name=name))
    for below, one in getattr(command, "commands", {}).items():
        yield from helps(one, f"{name} {below}")


@pytest.mark.parametrize("page", documents(), ids=lambda page: str(page.relative_to(ROOT)))
def test_documents_use_the_glossarys_words(page: Path, replaced: list[Word]) -> None:
    text = prose_of(page.read_text(encoding="utf-8"))
    findings = in_prose(text, replaced, str(page.relative_to(ROOT)))
    assert not findings, "\n" + "\n".join(map(str, findings))


def test_help_texts_use_them(replaced: list[Word]) -> None:
    texts = dict(helps(typer.main.get_command(app), "cellctl"))
    assert len(texts) > 10  # a walk that found nothing would prove nothing
    findings = [f for name, text in texts.items() for f in in_prose(text, replaced, name)]
    assert not findings, "\n" + "\n".join(map(str, findings))


def test_comments_in_recipes_use_them(replaced: list[Word]) -> None:
    files = sorted((ROOT / "recipes").rglob("*.yaml"))
    assert len(files) > 5
    findings = [
        f
        for path in files
        for f in in_prose(comments_of(path.read_text(encoding="utf-8")), replaced, path.name)
    ]
    assert not findings, "\n" + "\n".join(map(str, findings))


def test_docstrings_use_them(replaced: list[Word]) -> None:
    looked_for = [word for word in replaced if word.text not in RIGHT_IN_DOCSTRINGS]
    assert len(looked_for) == len(replaced) - len(RIGHT_IN_DOCSTRINGS)
    files = [path for top in PACKAGES for path in sorted((ROOT / top).rglob("*.py"))]
    assert len(files) > 300
    findings = [
        f
        for path in files
        for f in in_prose(
            docstrings_of(path.read_text(encoding="utf-8")),
            looked_for,
            str(path.relative_to(ROOT)),
        )
    ]
    assert not findings, "\n" + "\n".join(map(str, findings))


def test_public_names_use_them_but_for_a_list_that_gets_shorter(replaced: list[Word]) -> None:
    found = names_found(ROOT, replaced)
    listed = listed_names(TO_RENAME.read_text(encoding="utf-8"))
    new = {room: names - listed.get(room, set()) for room, names in found.items()}
    gone = {room: names - found.get(room, set()) for room, names in listed.items()}
    assert not {room: names for room, names in new.items() if names}, "use the glossary's words"
    assert not {room: names for room, names in gone.items() if names}, (
        "renamed: run `python tests/glossary.py --shrink`"
    )


def test_the_right_column_is_read(planted: list[Word]) -> None:
    assert [word.text for word in planted] == [
        "tip", "hand frame", "way to lie", "lying", "how it lies", "grip", "check",
    ]  # fmt: skip


def test_the_glossary_has_words_to_look_for(replaced: list[Word]) -> None:
    looked_for = [word for word in replaced if word.in_prose is not None]
    assert len(looked_for) > 50


def test_an_exception_for_a_word_that_nothing_replaces_is_refused() -> None:
    with pytest.raises(ValueError, match="not in the right column: pawl"):
        words(TABLES + "| pawl | any | any | |\n")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("The tip is hot.", ["tip"]),
        ("Tips are hot.", ["tip"]),
        ("It tips over; the finger tips stay.", []),
        ("It tips over the tip.", ["tip"]),
        ("a tipping point, multiple, griped", []),
        ("the hand\nframe, the hand-frame", ["hand frame"]),
        ("ways to lie", []),  # plurals are listed where the s stands within
        ("underlying", []),
        ("tip-pose", ["tip"]),
        ("gripper", []),
        ("check all checks", []),
    ],
)
def test_planted_words_are_found_in_prose(text: str, found: list[str], planted: list[Word]) -> None:
    assert [finding.word.text for finding in in_prose(text, planted)] == found


def test_a_finding_names_file_line_and_the_word_to_use(planted: list[Word]) -> None:
    (finding,) = in_prose("one\ntwo\nits tip is hot", planted, "page")
    assert str(finding) == "page:3: `tip` (TCP; `T_world_tcp`): its tip is hot"


def test_code_is_no_prose(planted: list[Word]) -> None:
    text = "the `tip` in\n```sh\ntip\n```\n<!-- tip -->[a page](tip.html)\nthe tip\n"
    (finding,) = in_prose(prose_of(text), planted)
    assert finding.line == 6


def test_comments_are_read_and_values_are_not(planted: list[Word]) -> None:
    text = comments_of("# a tip\ngrip: 3   # how it lies\nname: tip#1\n")
    found = [(finding.line, finding.word.text) for finding in in_prose(text, planted)]
    assert found == [(1, "tip"), (2, "how it lies")]


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("T_world_tip", ["tip"]),
        ("tips_mm", ["tip"]),
        ("tip_energy_j", []),
        ("HandFrame", ["hand frame"]),
        ("hand_frame_of", ["hand frame"]),
        ("frame_hand", []),
        ("GripRules", ["grip"]),
        ("GRIP_COUNT", ["grip"]),
        ("gripper", []),
        ("check_all", []),
        ("stipple", []),
    ],
)
def test_planted_words_are_found_in_names(name: str, found: list[str], planted: list[Word]) -> None:
    assert [word.text for word in replaced_in_name(name, planted)] == found


def test_docstrings_are_read_and_code_is_not(planted: list[Word]) -> None:
    source = '''"""The tip, `tip`, parts/tip.yaml and ``a
tip``."""
tip = "the tip"  # the tip

def work():
    """Return.

    The grip.
    """
'''
    found = in_prose(docstrings_of(source), planted)
    assert [(finding.line, finding.word.text) for finding in found] == [(1, "tip"), (8, "grip")]


def test_public_names_are_those_others_see() -> None:
    source = """
TIP = 1
_HIDDEN = 2
class Grip:
    lying: bool
    _own: int
    RED = 3
    def __init__(self, tip_mm: float) -> None: ...
    def turn(self, *ways: int, by: int = 0, **rest: int) -> None:
        inner = 1
    def _private(self, secret: int) -> None: ...
class _Grip:
    other: int
async def go(there: int, /, then: int) -> None: ...
"""
    assert public_names(source) == {
        "TIP", "Grip", "lying", "RED", "self", "tip_mm", "turn", "ways", "by", "rest", "go",
        "there", "then",
    }  # fmt: skip


def test_names_are_found_by_room(tmp_path: Path, planted: list[Word]) -> None:
    for package in ("controller", "drivers", "emulators"):
        (tmp_path / package / "arm" / "tips").mkdir(parents=True)
        (tmp_path / package / "app.py").write_text("grip = 1\n", encoding="utf-8")
        (tmp_path / package / "arm" / "tips" / "_a.py").write_text("lying = 1\n", encoding="utf-8")
    found = names_found(tmp_path, planted)
    assert found["controller"] == {"grip"}
    assert found["drivers.arm"] == {"lying", "tips"}
    assert len(found) == 6


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


def test_the_list_only_gets_shorter() -> None:
    listed = {"a": {"tip", "grip"}, "b": {"tip"}}
    assert listed_names(as_toml(listed)) == listed
    rooms, new = shrunk(listed, {"a": {"tip"}, "c": {"tip", "lying"}})
    assert rooms == {"a": {"tip"}, "c": {"tip"}}  # one `tip` has moved to another room
    assert new == {"lying"}


def test_a_count_that_is_not_the_names_is_refused() -> None:
    with pytest.raises(ValueError, match="a: 1 names, and a count of 2"):
        listed_names('["a"]\ncount = 2\nnames = ["tip"]\n')
