"""The page's texts: each is in the catalogue, and the compiled catalogue is its source's."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest
from babel.messages.pofile import read_po

from controller.cell.alarms import Severity
from controller.cell.custody import Custody
from controller.cell.machine.table import COMPLETING, STAGES
from controller.config.interlock_rules import SIGNALS
from controller.page.words import LANGUAGES, chosen, every_word, translator

PAGE = Path(__file__).resolve().parents[2] / "controller" / "page"
TEXT = r'"((?:[^"\\]|\\.)*)"'


def texts() -> set[str]:
    """Return every text of the page, as the sources have it."""
    found: set[str] = set()
    for template in (PAGE / "templates").glob("*.j2"):
        found |= set(re.findall(rf"_\({TEXT}\)", template.read_text(encoding="utf-8")))
    script = (PAGE / "static" / "now.js").read_text(encoding="utf-8")
    found |= set(re.findall(rf"\bt\({TEXT}", script))
    for table in re.findall(r"^const (?:MODES|LIGHTS|SIGNALS) = \{(.*?)^\};", script, re.M | re.S):
        found |= set(re.findall(rf": {TEXT}", table))
    routes = (PAGE / "routes.py").read_text(encoding="utf-8")
    found |= set(re.findall(rf"text = {TEXT}", routes))
    return found


@pytest.mark.parametrize("language", sorted(set(LANGUAGES) - {"en"}))
def test_every_text_is_in_the_catalogue(language: str) -> None:
    known = every_word(language)
    wanted = texts()
    assert len(wanted) > 80
    assert sorted(wanted - set(known)) == []
    assert [text for text in wanted if not known[text]] == []


@pytest.mark.parametrize("language", sorted(set(LANGUAGES) - {"en"}))
def test_what_the_cell_may_be_in_is_in_the_catalogue(language: str) -> None:
    known = every_word(language)
    named = {one.value for one in Custody} | {*STAGES, COMPLETING}
    named |= {one.value for one in Severity}
    assert sorted(named - set(known)) == []
    script = (PAGE / "static" / "now.js").read_text(encoding="utf-8")
    assert [name for name in SIGNALS if f"{name}: " not in script] == []


@pytest.mark.parametrize("language", sorted(set(LANGUAGES) - {"en"}))
def test_a_text_keeps_its_blanks_to_fill_in(language: str) -> None:
    for text, word in every_word(language).items():
        assert set(re.findall(r"\{\w+\}", text)) == set(re.findall(r"\{\w+\}", word)), text


@pytest.mark.parametrize("language", sorted(set(LANGUAGES) - {"en"}))
def test_the_compiled_catalogue_is_that_of_its_source(language: str) -> None:
    source = PAGE / "catalogues" / language / "LC_MESSAGES" / "page.po"
    read = read_po(io.BytesIO(source.read_bytes()))
    assert {one.id: one.string for one in read if one.id} == dict(every_word(language))


def test_a_language_is_chosen_by_the_person_then_by_the_browser() -> None:
    assert chosen("de", "en") == "de"
    assert chosen(None, "fr-FR, de-AT;q=0.8, en;q=0.5") == "de"
    assert chosen("klingon", "fr") == "en"
    assert translator("de")("Stop") == "Halt"
    assert translator("en")("Stop") == "Stop"
