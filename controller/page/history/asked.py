"""A person's query of the history, from the address of the page; invalid values are left out."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from typing import Final
from urllib.parse import urlencode

from starlette.datastructures import QueryParams

from controller.history import REVIEWS_ASKED, SORTS, Filters

from ..frame.words import word
from ..records import page_asked

TEXT_MAX: Final = 200
PAGE_MAX: Final = 100_000
LISTED: Final = 50
TEXTS: Final = ("recipe", "serial", "lot", "order_number", "operator", "run", "cell")
VERDICTS: Final = (
    word("pass"),
    word("fail"),
    word("indeterminate"),
    word("not evaluated"),
    word("no verdict"),
)
REVIEW_WORDS: Final[Mapping[str, str]] = {
    "awaiting": word("awaits a person"),
    "reviewed": word("decided on"),
    "accept": word("accepted by a person"),
    "reject": word("rejected by a person"),
}


@dataclass(frozen=True, slots=True)
class ListRequest:
    """Filters, order and page of a list.

    Attributes
    ----------
    values : values of the form's fields, as they were written
    wrong : fields that make no sense
    """

    filters: Filters
    sort: str
    is_rising: bool
    page: int
    values: Mapping[str, str]
    wrong: tuple[str, ...] = ()

    @property
    def is_filtered(self) -> bool:
        """Whether any filter is set."""
        return any(self.values.values())

    def address(self, **changes: object) -> str:
        """Return the query of the same list with changes; a change to None takes one out."""
        found: dict[str, object] = {name: text for name, text in self.values.items() if text}
        if self.sort != "start" or self.is_rising:
            found |= {"sort": self.sort, "order": "rising" if self.is_rising else "falling"}
        found |= changes
        return "?" + urlencode({name: text for name, text in found.items() if text is not None})


def asked(query: QueryParams) -> ListRequest:
    """Return the query in an address."""
    values = {name: query.get(name, "").strip()[:TEXT_MAX] for name in TEXTS}
    wrong = []
    for name, known in (("verdict", VERDICTS), ("review", REVIEWS_ASKED)):
        values[name] = query.get(name, "")
        if values[name] and values[name] not in known:
            wrong.append(name)
            values[name] = ""
    times: dict[str, datetime | None] = {}
    for name in ("since", "until"):
        values[name] = query.get(name, "").strip()[:40]
        try:
            times[name] = _instant(values[name], is_end=name == "until")
        except (ValueError, OverflowError):
            wrong.append(name)
            times[name] = None
    sort = query.get("sort", "start")
    return ListRequest(
        Filters(
            **{name: values[name] for name in (*TEXTS, "verdict", "review")},
            since=times["since"],
            until=times["until"],
        ),
        sort if sort in SORTS else "start",
        query.get("order") == "rising",
        page_asked(query, PAGE_MAX),
        values,
        tuple(wrong),
    )


def _instant(text: str, *, is_end: bool) -> datetime | None:
    """Return an instant, UTC without a zone; a bare date means the whole day."""
    if not text:
        return None
    if len(text) == len("2026-03-01"):
        day = datetime.combine(date.fromisoformat(text), time())
        return day + timedelta(days=1) if is_end else day
    found = datetime.fromisoformat(text)
    return found.astimezone(UTC).replace(tzinfo=None) if found.tzinfo else found
