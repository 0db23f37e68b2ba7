"""The page's languages: catalogues of gettext, kept compiled beside their sources.

``pybabel compile -d controller/page/catalogues -D page`` compiles them after a change.
"""

import gettext
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Final

LANGUAGES: Final[Mapping[str, str]] = {"en": "English", "de": "Deutsch"}
DOMAIN: Final = "page"


@cache
def catalogue(language: str) -> gettext.NullTranslations:
    """Return the catalogue of a language; English is its own."""
    if language == "en":
        return gettext.NullTranslations()
    place = files(__package__) / "catalogues" / language / "LC_MESSAGES" / f"{DOMAIN}.mo"
    with place.open("rb") as file:
        return gettext.GNUTranslations(file)


def translator(language: str) -> Callable[[str], str]:
    """Return what puts an English text into a language; unknown texts stay as they are."""
    return catalogue(language).gettext


@cache
def every_word(language: str) -> Mapping[str, str]:
    """Return all texts of a language by their English, for the browser."""
    found = getattr(catalogue(language), "_catalog", {})
    return {text: word for text, word in found.items() if isinstance(text, str) and text}


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
