"""The languages of the page: English in the sources, others in catalogues made with Babel.

The catalogue of this package has the texts that screens share; each screen has a catalogue of its
own for the rest. ``pybabel compile -d controller/page/SCREEN/catalogues -D page`` compiles one
after a change (`frame` for the shared one).

The cell's own sentences are in a catalogue beside the shared one (``-D cell``): alarms, questions
with their choices, steps, motions, names of faces and characteristics, reasons of verdicts
(ADR 87). The cell writes them in English, with names and figures filled in; in the catalogue these
are blanks, as in ``place in tray {tray}``, and a text is looked up by the entry that it matches.
The content of a blank depends on its name:

- a letter, or a letter and a digit: a figure alone, which is written as the language does;
- ``..._id``: a name without blanks in it;
- one of `KNOWN_NAMES`: only what the catalogue knows;
- one of `SEPARATED`: several texts, each looked up; of lines also those that are known alone;
- all else: any text, looked up again.
"""

import gettext
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Final

LANGUAGES: Final[Mapping[str, str]] = {"en": "English", "de": "Deutsch"}
DOMAIN: Final = "page"
CELL_DOMAIN: Final = "cell"
POINT_AND_COMMA: Final = str.maketrans(".,", ",.")
BLANK: Final = re.compile(r"\{(\w+)\}")
NESTED_MAX_COUNT: Final = 8  # largest depth to which a text in a blank may itself have blanks
KEPT_MAX_COUNT: Final = 4096  # number of texts remembered in a language
FIGURE: Final = re.compile(r"[-+]?(?:\d+(?:\.\d+)?(?:e[-+]?\d+)?|inf|nan)")
FIGURE_NAME: Final = re.compile(r"[a-z]\d?")
ID_NAME: Final = re.compile(r"\w+_id\d?")
KNOWN_NAMES: Final = frozenset({"feature", "said"})
_CLAUSES, _NAMES = re.compile("(; )"), re.compile("( and |, )")
_LINES = re.compile(r"(^  - |\n(?:  - )?)")
SEPARATED: Final[Mapping[str, re.Pattern[str]]] = {
    "items": _CLAUSES, "where": _CLAUSES, "faces": _NAMES, "things": _NAMES,
    "lines": _LINES, "more_lines": _LINES,
}  # fmt: skip
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


@cache
def cell_words(language: str) -> Mapping[str, str]:
    """Return the cell's sentences by their English, blanks in both; empty for English."""
    if language == "en":
        return {}
    place = files(f"controller.page.{SHARED}") / "catalogues" / language / "LC_MESSAGES"
    with (place / f"{CELL_DOMAIN}.mo").open("rb") as file:
        found = getattr(gettext.GNUTranslations(file), "_catalog", {})
    return {text: word for text, word in found.items() if isinstance(text, str) and text}


@dataclass(frozen=True, slots=True)
class _Pattern:
    """A text of the catalogue: the words between its blanks, its pattern, its translation.

    Most texts lack the longest of these words, which spares nearly all patterns the rest.
    """

    chunks: tuple[str, ...]
    longest: str
    fits: re.Pattern[str]
    word: str

    @classmethod
    def of(cls, text: str, word: str) -> "_Pattern":
        chunks = BLANK.split(text)
        pattern = "".join(
            f"(?P<{chunk}>{_taken(chunk)})" if k % 2 else re.escape(chunk)
            for k, chunk in enumerate(chunks)
        )
        own = tuple(filter(None, chunks[::2]))
        longest = max(own, key=len, default="")
        return cls(own, longest, re.compile(pattern, re.DOTALL), word)

    @property
    def own_length(self) -> int:
        """Length of its fixed words."""
        return sum(map(len, self.chunks))

    def found(self, text: str) -> Mapping[str, str]:
        """Return the content of its blanks in a text; None where it does not match."""
        at = 0
        for chunk in self.chunks:  # spares nearly all patterns their expression
            at = text.find(chunk, at) + len(chunk)
            if at < len(chunk):
                return {}
        match = self.fits.fullmatch(text)
        return {} if match is None else match.groupdict()


def _filled(word: str, parts: Mapping[str, str | None]) -> str:
    return BLANK.sub(lambda blank: parts[blank[1]] or "", word)


def _taken(name: str) -> str:
    """Return the regular expression for a blank of this name."""
    if FIGURE_NAME.fullmatch(name):
        return FIGURE.pattern
    return r"\S+?" if ID_NAME.fullmatch(name) else ".+?"


@cache
def teller(language: str) -> Callable[[str], str]:
    """Return the translator of the cell's texts into a language; unknown texts stay unchanged."""
    words = cell_words(language)
    # the one that says most by itself comes first
    patterns = sorted(
        (_Pattern.of(text, word) for text, word in words.items() if BLANK.search(text)),
        key=lambda one: -one.own_length,
    )

    @lru_cache(KEPT_MAX_COUNT)
    def told(text: str, depth: int = 0) -> str:
        if text in words:
            return words[text]
        if depth == NESTED_MAX_COUNT:
            return text
        if text.endswith(".") and (whole := told(text[:-1], depth + 1)) != text[:-1]:
            return f"{whole}."
        for pattern in patterns:
            if pattern.longest not in text:
                continue
            parts = {
                name: in_blank(name, part, depth + 1) for name, part in pattern.found(text).items()
            }
            if parts and None not in parts.values():
                return _filled(pattern.word, parts)
        return in_pieces(text, _CLAUSES, depth) or text

    def in_pieces(text: str, separator: re.Pattern[str], depth: int) -> str:
        """Return several texts translated; empty where one of them is unknown."""
        pieces = separator.split(text)
        if len(pieces) == 1:
            return ""
        each = [told(piece, depth + 1) for piece in pieces]
        is_known = separator is _LINES or all(
            a != b for a, b in zip(pieces[::2], each[::2], strict=True)
        )
        return "".join(each) if is_known else ""

    def in_blank(name: str, part: str, depth: int) -> str | None:
        """Return the content of a blank translated; None where that blank cannot take it."""
        if FIGURE_NAME.fullmatch(name):
            return _written(language, part)
        found = told(part, depth)
        if name in KNOWN_NAMES:
            return None if found == part else found
        # "A 5; B 7" is not one B of 7 whose name is "A 5; B"
        return (name in SEPARATED and in_pieces(part, SEPARATED[name], depth)) or found

    return told


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
    return _written(language, f"{value:{'+' if is_signed else ''}.{digits}f}")


def count_in(language: str, count: int) -> str:
    """Return a tally as a language writes it, its thousands apart."""
    return _written(language, f"{count:,}")


def _written(language: str, number: str) -> str:
    return number.translate(POINT_AND_COMMA) if language == "de" else number


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
