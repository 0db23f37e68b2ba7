"""Parts and lists of them in words of a page."""

from collections.abc import Mapping
from typing import Any, Final

from starlette.responses import Response

from controller.history import HistoryError, NoSuchPartError

from ..frame.visit import Visit
from ..frame.words import word

CLASSES: Final[Mapping[str, str]] = {
    "pass": "good",
    "accept": "good",
    "fail": "bad",
    "reject": "bad",
    "indeterminate": "open",
}


def verdict_class(word: str) -> str:
    """Return the class of a verdict's mark; sign and word carry the same without colour."""
    return CLASSES.get(word, "none")


def part_key(part: Mapping[str, Any]) -> str:
    """Return the end of a part's address: its name, RUN/NUMBER or CELL/RUN/NUMBER."""
    return str(part["part"])


def page_asked(query: Mapping[str, str], most: int) -> int:
    """Return the page number that an address asks for; 1 for an invalid one.

    Parameters
    ----------
    query : query of the address
    most : largest number
    """
    text = query.get("page", "1")
    return min(max(int(text), 1), most) if text.isdecimal() and len(text) < 9 else 1


def page_count(count: int, listed: int) -> int:
    """Return the number of pages of a list, one at least.

    Parameters
    ----------
    count : number of all that the list has
    listed : number of parts on one page
    """
    return max(1, -(-count // listed))


def unread(visit: Visit, error: HistoryError) -> Response:
    """Return the answer for a missing part or an unreadable history."""
    if isinstance(error, NoSuchPartError):
        why = word("there is no such part")
        return visit.html("unread.html.j2", 404, title=visit.screen.title, why=why)
    return visit.html("unread.html.j2", title=visit.screen.title, why=str(error))
