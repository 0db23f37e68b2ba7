"""The languages of the page: English in the sources, others in catalogues made with Babel.

The catalogue of this package has the texts that screens share; each screen has a catalogue of its
own for the rest. ``pybabel compile -d controller/page/SCREEN/catalogues -D page`` compiles one
after a change (`frame` for the shared one).

What the cell itself says is in a catalogue beside the shared one (``-D cell``): alarms, questions
with their choices, steps, motions. The cell says it in English, with names and figures in place;
in the catalogue these are blanks, as in ``place in tray {tray}``, and a text is looked up by which
of them it fits (ADR 85).
"""

import gettext
import re
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Final

LANGUAGES: Final[Mapping[str, str]] = {"en": "English", "de": "Deutsch"}
DOMAIN: Final = "page"
CELL_DOMAIN: Final = "cell"
POINT_AND_COMMA: Final = str.maketrans(".,", ",.")
BLANK: Final = re.compile(r"\{(\w+)\}")
NESTED_MAX_COUNT: Final = 4  # what stands in a blank may itself be a text with blanks, so often
SHARED: Final = "frame"


def word(text: str) -> str:
    """Return a text as it is; a test holds texts that are so marked against the catalogues."""
    return text


@cache
def catalogue(language: str, screen: str = SHARED) -> gettext.NullTranslations:
    """Return the catalogue of a screen with the shared one below it; English is its own.

    Parameters
    ----------
    language : one of `LANGUAGES`
    screen : name of the screen, or `frame` for the shared texts alone
    """
    if language == "en":
        return gettext.NullTranslations()
    place = files(f"controller.page.{screen}") / "catalogues" / language / "LC_MESSAGES"
    try:
        with (place / f"{DOMAIN}.mo").open("rb") as file:
            found = gettext.GNUTranslations(file)
    except FileNotFoundError:  # a screen without texts of its own
        return catalogue(language)
    if screen != SHARED:
        found.add_fallback(catalogue(language))
    return found


def translator(language: str, screen: str = SHARED) -> Callable[[str], str]:
    """Return what puts an English text into a language; unknown texts stay as they are."""
    return catalogue(language, screen).gettext


@cache
def every_word(language: str, screen: str = SHARED) -> Mapping[str, str]:
    """Return all texts of a screen and the shared ones by their English, for the browser."""
    shared = {} if screen == SHARED else every_word(language)
    found = getattr(catalogue(language, screen), "_catalog", {})
    own = {text: word for text, word in found.items() if isinstance(text, str) and text}
    return {**shared, **own}


@cache
def cell_words(language: str) -> Mapping[str, str]:
    """Return all that the cell says by its English, blanks in both; nothing for English."""
    if language == "en":
        return {}
    place = files(f"controller.page.{SHARED}") / "catalogues" / language / "LC_MESSAGES"
    with (place / f"{CELL_DOMAIN}.mo").open("rb") as file:
        found = getattr(gettext.GNUTranslations(file), "_catalog", {})
    return {text: word for text, word in found.items() if isinstance(text, str) and text}


@cache
def teller(language: str) -> Callable[[str], str]:
    """Return what puts a text of the cell into a language; unknown texts stay as they are."""
    words = cell_words(language)
    blanked = [(_fits(text), word) for text, word in words.items() if BLANK.search(text)]
    # the one that says most by itself comes first
    blanked.sort(key=lambda one: -len(BLANK.sub("", one[0].pattern)))

    def told(text: str, depth: int = 0) -> str:
        if text in words:
            return words[text]
        if depth == NESTED_MAX_COUNT:
            return text
        if text.endswith(".") and (whole := told(text[:-1], depth + 1)) != text[:-1]:
            return f"{whole}."
        for pattern, word in blanked:
            if found := pattern.fullmatch(text):
                parts = {name: told(part, depth + 1) for name, part in found.groupdict().items()}
                return BLANK.sub(lambda blank, parts=parts: parts[blank[1]], word)  # type: ignore[misc]
        return text

    return told


def value_in(
    language: str, value: float | None, digits: int = 3, *, is_signed: bool = False
) -> str:
    """Return a number as a language writes it, or a dash for what is not known.

    Parameters
    ----------
    language : one of `LANGUAGES`
    value : the number
    digits : behind the point
    is_signed : show a plus, too
    """
    if value is None:
        return "–"
    return _written(language, f"{value:{'+' if is_signed else ''}.{digits}f}")


def count_in(language: str, count: int) -> str:
    """Return a tally as a language writes it, its thousands apart."""
    return _written(language, f"{count:,}")


def _written(language: str, number: str) -> str:
    return number.translate(POINT_AND_COMMA) if language == "de" else number


def _fits(text: str) -> re.Pattern[str]:
    pattern = re.escape(text).replace(r"\{", "{").replace(r"\}", "}")
    return re.compile(BLANK.sub(r"(?P<\1>.+?)", pattern), re.DOTALL)


def chosen(wanted: str | None, accepted: str) -> str:
    """Return the language to use.

    Parameters
    ----------
    wanted : what the person chose, None if nothing
    accepted : what the browser prefers, as its `Accept-Language` has it
    """
    if wanted is not None and wanted in LANGUAGES:
        return wanted
    for one in accepted.split(","):
        name = one.split(";")[0].strip().lower().partition("-")[0]
        if name in LANGUAGES:
            return name
    return "en"
