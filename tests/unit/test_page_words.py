"""The page's texts: each is in a catalogue, and each compiled catalogue is its source's."""

from __future__ import annotations

import ast
import io
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from controller.cell.alarms import ALARMS, Severity
from controller.cell.custody import Custody
from controller.cell.machine.pauses import SafePoint
from controller.cell.machine.table import COMPLETING, STAGES
from controller.cell.operator.questions import question_for
from controller.config.interlock_rules import SIGNALS
from controller.inspection import FindingKind
from controller.page.app import build_screens
from controller.page.frame import Setting
from controller.page.frame.words import (
    LANGUAGES,
    cell_words,
    chosen,
    count_in,
    every_word,
    teller,
    translator,
    value_in,
)

PAGE = Path(__file__).resolve().parents[2] / "controller" / "page"
TEXT = r'"((?:[^"\\]|\\.)*)"'
SCREENS = build_screens(Setting(Path("nowhere"), Path("nowhere")))
PACKAGES = ["frame", *(screen.name for screen in SCREENS)]
FOREIGN = sorted(set(LANGUAGES) - {"en"})


def read(package: str, pattern: str) -> str:
    found = sorted((PAGE / package).rglob(pattern))
    return "\n".join(
        path.read_text(encoding="utf-8") for path in found if "three" not in path.parts
    )


def texts(package: str) -> set[str]:
    """Return every text of a screen or of the frame, as the sources have it.

    In templates `_("...")`, in scripts `t("...")` and tables named `..._WORDS`, in Python
    `word("...")`.
    """
    script = read(package, "*.js")
    found = set(re.findall(rf"_\({TEXT}\)", read(package, "*.j2")))
    found |= set(re.findall(rf"\bt\({TEXT}", script))
    for table in re.findall(r"^const \w+_WORDS = \{(.*?)^\};", script, re.M | re.S):
        found |= set(re.findall(rf": {TEXT}", table))
    return found | set(re.findall(rf"\bword\(\s*{TEXT}", read(package, "*.py")))


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_every_text_is_in_the_catalogue(package: str, language: str) -> None:
    known = every_word(language, package)
    wanted = texts(package)
    assert len(wanted) > 5
    assert sorted(wanted - set(known)) == []
    assert [text for text in wanted if not known[text]] == []


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_a_screens_title_is_known_on_all_screens(package: str, language: str) -> None:
    assert package == "frame" or package.capitalize() in every_word(language)


@pytest.mark.parametrize("language", FOREIGN)
def test_what_the_cell_may_be_in_is_in_the_catalogue(language: str) -> None:
    known = every_word(language, "now")
    named = {one.value for one in Custody} | {*STAGES, COMPLETING}
    named |= {one.value for one in Severity}
    assert sorted(named - set(known)) == []
    script = (PAGE / "now" / "static" / "now.js").read_text(encoding="utf-8")
    assert [name for name in SIGNALS if f"{name}: " not in script] == []


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_a_text_keeps_its_blanks_to_fill_in(package: str, language: str) -> None:
    for text, word in every_word(language, package).items():
        assert set(re.findall(r"\{\w+\}", text)) == set(re.findall(r"\{\w+\}", word)), text


@pytest.mark.parametrize("language", FOREIGN)
@pytest.mark.parametrize("package", PACKAGES)
def test_the_compiled_catalogue_is_that_of_its_source(package: str, language: str) -> None:
    source = PAGE / package / "catalogues" / language / "LC_MESSAGES" / "page.po"
    read_ = read_po(io.BytesIO(source.read_bytes()))
    own = {one.id: one.string for one in read_ if one.id}
    shared = {} if package == "frame" else every_word(language)
    assert {**shared, **own} == dict(every_word(language, package))


def test_a_language_is_chosen_by_the_person_then_by_the_browser() -> None:
    assert chosen("de", "en") == "de"
    assert chosen(None, "fr-FR, de-AT;q=0.8, en;q=0.5") == "de"
    assert chosen("klingon", "fr") == "en"
    assert translator("de", "now")("Stop") == "Halt"
    assert translator("en", "now")("Stop") == "Stop"


def test_a_screen_without_a_text_has_that_of_the_frame() -> None:
    assert translator("de", "now")("Log out") == translator("de")("Log out") == "Abmelden"


CELL = Path(__file__).resolve().parents[2] / "controller" / "cell"
# Where the cell makes what a person reads: name of the call, place and name of the text.
SAYING = {
    "Choice": (1, "words"),
    "Question": (1, "text"),
    "NextMotion": (0, "words"),
    "PartProblemError": (1, "message"),
    "PartFaultError": (1, "message"),
    "show": (0, "label"),
    "_moving": (0, "words"),
}


def written(node: ast.expr | None) -> str:
    """Return a text as the catalogue has it, its blanks without names; empty for no literal."""
    match node:
        case ast.Constant(value=str() as text):
            return text
        case ast.JoinedStr(values=values):
            return "".join(written(one) or "{}" for one in values)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            both = written(left), written(right)
            return "".join(both) if all(both) else ""
    return ""


def said_by_the_cell() -> Iterator[str]:
    """Yield every text that the cell makes in place; commissioning speaks at a terminal alone."""
    for path in sorted(CELL.rglob("*.py")):
        if "commissioning" in path.parts:
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            func = node.func
            name = func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")
            if name in SAYING:
                place, key = SAYING[name]
                named = next((one.value for one in node.keywords if one.arg == key), None)
                yield written(node.args[place] if len(node.args) > place else named)


@pytest.mark.parametrize("language", FOREIGN)
def test_every_alarm_has_its_words_in_each_language(language: str) -> None:
    known, told = cell_words(language), teller(language)
    for alarm in ALARMS:
        texts_ = (alarm.words, alarm.unknown, alarm.action)
        assert [text for text in texts_ if not known.get(text)] == [], alarm.code
        assert [text for text in texts_ if told(text) == text] == [], alarm.code
    assert [alarm.device for alarm in ALARMS if alarm.device not in known] == []


@pytest.mark.parametrize("language", FOREIGN)
def test_every_question_of_a_part_has_its_choices_in_each_language(language: str) -> None:
    known, told = cell_words(language), teller(language)
    for alarm in ALARMS:
        for custody in Custody:
            question = question_for(alarm.code, "no part <here>", custody.value)
            named = [*(one.words for one in question.choices), *(w for _, w in question.preview)]
            assert [text for text in named if text not in known] == []
            frame = question.text.partition("no part <here>.")[2].partition(" (by the")[0]
            assert not frame or frame not in told(question.text)
            assert "no part <here>" in told(question.text)


@pytest.mark.parametrize("language", FOREIGN)
def test_what_the_cell_says_is_in_the_catalogue_with_its_blanks(language: str) -> None:
    known = {re.sub(r"\{\w+\}", "{}", text) for text in cell_words(language)}
    wanted = {text for text in said_by_the_cell() if re.search("[a-z]{3}", text)}
    wanted -= {"{} and now waits for you)"}  # the end of a sentence that the catalogue has whole
    missing = wanted - known
    assert len(wanted) > 60
    assert missing == set()
    data = [one.value for one in (*SafePoint, *FindingKind)]
    assert [text for text in data if text not in cell_words(language)] == []


def test_a_text_with_names_and_figures_is_put_into_words_with_them() -> None:
    told = teller("de")
    assert told("place in tray accept") == "in die Ablage Gut legen"
    assert told("place in tray <b>") == "in die Ablage <b> legen"
    assert told("show with grasp A15, square to F2 plane") == (
        "zeigen mit Griff A15, gerade vor F2 plane"
    )
    why = "the object at x 12, y -3 mm: no such shape; take it away, or check the recipe's `part:`"
    assert told(f"{why}.") == (
        "der Gegenstand bei x 12, y -3 mm: no such shape; wegnehmen, oder `part:` des Rezepts "
        "prüfen."
    )
    assert told("whatever nobody has written") == "whatever nobody has written"
    assert teller("en")("place in tray accept") == "place in tray accept"


@pytest.mark.parametrize("language", FOREIGN)
def test_the_cells_catalogue_is_that_of_its_source_and_keeps_blanks(language: str) -> None:
    source = PAGE / "frame" / "catalogues" / language / "LC_MESSAGES" / "cell.po"
    read_ = read_po(io.BytesIO(source.read_bytes()))
    assert {one.id: one.string for one in read_ if one.id} == dict(cell_words(language))
    for text, word in cell_words(language).items():
        assert sorted(re.findall(r"\{\w+\}", text)) == sorted(re.findall(r"\{\w+\}", word)), text


@pytest.mark.parametrize(
    ("language", "number", "signed", "tally"),
    [("en", "1234.50", "+0.025", "100,000"), ("de", "1234,50", "+0,025", "100.000")],
)
def test_numbers_are_written_as_the_language_does(
    language: str, number: str, signed: str, tally: str
) -> None:
    assert value_in(language, 1234.5, 2) == number
    assert value_in(language, 0.025, is_signed=True) == signed
    assert value_in(language, None) == "–"
    assert count_in(language, 100_000) == tally
