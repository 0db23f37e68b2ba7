"""Sentences in the languages of people, by catalogues made with Babel (docs/translating.md).

English is that of the sources. A template, or a whole text, that a catalogue does not have stays
English; the values in it are put into words all the same, figures as the language writes them.
"""

import gettext
from collections.abc import Callable, Mapping
from functools import cache, lru_cache
from importlib.resources import files
from typing import Final

from ._message import COUNT, Message, Value, filled
from .form import texts_in

LANGUAGES: Final[Mapping[str, str]] = {"en": "English", "de": "Deutsch"}
DOMAIN: Final = "messages"
POINT_AND_COMMA: Final = str.maketrans(".,", ",.")
KEPT_MAX_COUNT: Final = 4096  # number of sentences remembered in a language


@cache
def catalogue(language: str) -> gettext.NullTranslations:
    """Return the catalogue of a language; that of English has nothing in it.

    Raises
    ------
    FileNotFoundError : there is none
    """
    if language == "en":
        return gettext.NullTranslations()
    place = files("messages") / "catalogues" / language / "LC_MESSAGES"
    with (place / f"{DOMAIN}.mo").open("rb") as file:
        return gettext.GNUTranslations(file)


@cache
def teller(language: str) -> Callable[[str], str]:
    """Return the function that puts sentences, and texts without values, into a language."""
    if language == "en":
        return str.__str__
    found = catalogue(language)

    @lru_cache(KEPT_MAX_COUNT)
    def told(text: str, key: str, values: tuple[tuple[str, Value], ...], many: str) -> str:
        if not values:
            return found.gettext(text) if text else ""
        content = dict(values)
        template = found.ngettext(key, many, int(content[COUNT])) if many else found.gettext(key)
        return filled(template, content, written)

    def written(value: Value, spec: str) -> str:
        if isinstance(value, str):
            return format(in_words(value), spec)
        return number_in(language, format(value, spec))

    def in_words(text: str) -> str:
        if isinstance(text, Message):
            return told(str.__str__(text), text.key, tuple(text.values.items()), text.many)
        return told(text, "", (), "")

    return in_words


def number_in(language: str, number: str) -> str:
    """Return a number, written as English has it, in a language's notation."""
    if language == "de":
        return number.translate(POINT_AND_COMMA).replace("%", " %")
    return number


def words_in(language: str, content: object) -> dict[str, str]:
    """Return what JSON values say in a language, by its English; what stays English is left out.

    Parameters
    ----------
    language : one of `LANGUAGES`
    content : values with sentences among them; names of members left out
    """
    if language == "en":
        return {}
    told = teller(language)
    return {str.__str__(text): word for text in texts_in(content) if (word := told(text)) != text}
