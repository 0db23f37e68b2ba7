"""The languages of the page: English in the sources, others in catalogues made with Babel.

The catalogue of this package has the texts that screens share; each screen has a catalogue of its
own for the rest. ``pybabel compile -d controller/page/SCREEN/catalogues -D page`` compiles one
after a change (`frame` for the shared one). What the cell itself says comes from the catalogues of
`messages`.
"""

import gettext
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Final

from messages.words import LANGUAGES, number_in

DOMAIN: Final = "page"
SHARED: Final = "frame"


def word(text: str) -> str:
    """Return a text unchanged; the mark lets a test compare such texts with the catalogues."""
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
    """Return the translator of English texts into a language; unknown texts stay unchanged."""
    return catalogue(language, screen).gettext


@cache
def every_word(language: str, screen: str = SHARED) -> Mapping[str, str]:
    """Return all texts of a screen and the shared ones by their English, for the browser."""
    shared = {} if screen == SHARED else every_word(language)
    found = getattr(catalogue(language, screen), "_catalog", {})
    own = {text: word for text, word in found.items() if isinstance(text, str) and text}
    return {**shared, **own}


def value_in(
    language: str, value: float | None, digits: int = 3, *, is_signed: bool = False
) -> str:
    """Return a number in a language's notation, or a dash for an unknown one.

    Parameters
    ----------
    language : one of `LANGUAGES`
    value : the number
    digits : number of decimals
    is_signed : show a plus, too
    """
    if value is None:
        return "–"
    return number_in(language, f"{value:{'+' if is_signed else ''}.{digits}f}")


def count_in(language: str, count: int) -> str:
    """Return a tally as a language writes it, its thousands apart."""
    return number_in(language, f"{count:,}")


def chosen(wanted: str | None, accepted: str) -> str:
    """Return the language to use.

    Parameters
    ----------
    wanted : choice of the person, None without one
    accepted : preference of the browser, as its `Accept-Language` has it
    """
    if wanted is not None and wanted in LANGUAGES:
        return wanted
    for one in accepted.split(","):
        name = one.split(";")[0].strip().lower().partition("-")[0]
        if name in LANGUAGES:
            return name
    return "en"
