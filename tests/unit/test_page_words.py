"""The page's texts: each is in a catalogue, and each compiled catalogue is its source's."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from controller.cell.alarms import Severity
from controller.cell.custody import Custody
from controller.cell.machine.table import WORK
from controller.config.interlock_rules import SIGNALS
from controller.page.app import build_screens
from controller.page.frame import Setting
from controller.page.frame.words import (
    chosen,
    count_in,
    every_word,
    translator,
    value_in,
)
from messages.words import LANGUAGES

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
    if package == "now":  # what it answers when a start is refused
        code = (PAGE.parent / "launching" / "launcher.py").read_text(encoding="utf-8")
        found |= set(re.findall(rf"LaunchRefusedError\(\s*\d+, {TEXT}", code))
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
    named = {one.value for one in Custody} | set(WORK)
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
