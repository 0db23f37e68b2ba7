"""Answers of *History*: the list, one part's record, its pictures, charts, two parts compared."""

import asyncio
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, Final
from urllib.parse import quote

from starlette.responses import Response

from controller.cell.alarms import BY_NUMBER
from controller.history import (
    HistoryError,
    cells_in,
    characteristics_in,
    list_parts,
    recipes_in,
    values_of,
)
from controller.history.reviewing import one_part
from messages.words import teller

from ..frame.drawn import picture_of
from ..frame.screens import GetRoute
from ..frame.visit import Visit, refused
from ..frame.words import translator, value_in, word
from ..records import (
    ELSEWHERE,
    FORMS,
    LISTED_FORMS,
    PartPicture,
    Records,
    WantedFile,
    page_count,
    part_key,
    unread,
    verdict_class,
)
from .asked import LISTED, REVIEW_WORDS, VERDICTS, asked
from .charts import VALUES_MAX, drawn

COMPARED: Final = 2
COLUMNS: Final = (
    ("start", word("begun (UTC)")),
    ("serial", word("serial number")),
    ("recipe", word("recipe")),
    ("lot", word("lot")),
    ("operator", word("operator")),
    ("verdict", word("verdict")),
    ("seconds", word("seconds")),
    ("findings", word("findings")),
)


class HistoryAnswers:
    """The answers of *History*.

    Parameters
    ----------
    records : parts of all runs
    """

    def __init__(self, records: Records) -> None:
        self._records = records

    @property
    def every(self) -> tuple[GetRoute, ...]:
        """All answers."""
        return (
            GetRoute("", self.list),
            GetRoute("part/{run:path}/{number:int}", self.part),
            GetRoute("picture/{run:path}/{number:int}/{picture:int}", self.picture),
            GetRoute("file/{run:path}/{number:int}/{form:str}", self.file),
            GetRoute("file/{run:path}/{form:str}", self.file),
            GetRoute("file/{form:str}", self.file),
            GetRoute("charts", self.charts),
            GetRoute("compare", self.compare),
        )

    async def list(self, visit: Visit) -> Response:
        """Return the parts that fit, page by page."""
        wanted = asked(visit.request.query_params)
        is_filling = await self._records.freshen()
        try:
            listed = await self._records.query(
                list_parts,
                wanted.filters,
                LISTED,
                skipped=LISTED * (wanted.page - 1),
                sort=wanted.sort,
                is_rising=wanted.is_rising,
            )
            recipes = await self._records.query(recipes_in)
            cells = await self._records.query(cells_in)
        except HistoryError as error:
            return unread(visit, error)
        return visit.html(
            "history.html.j2",
            asked=wanted,
            listed=listed,
            recipes=recipes,
            cells=cells if len(cells) > 1 else (),
            columns=COLUMNS,
            verdicts=VERDICTS,
            reviews=REVIEW_WORDS,
            forms=LISTED_FORMS,
            pages=page_count(listed.count, LISTED),
            is_filling=is_filling,
            problems=self._records.problems,
            **_SHOWN,
        )

    async def part(self, visit: Visit) -> Response:
        """Return the full record of a part."""
        try:
            part = await self._records.part(visit.request.path_params)
        except HistoryError as error:
            return unread(visit, error)
        pictures = await self._records.pictures(part)
        return visit.html(
            "part.html.j2",
            part=part,
            pictures=pictures if isinstance(pictures, tuple) else (),
            no_pictures=pictures if isinstance(pictures, str) else "",
            forms=FORMS,
            alarms=counted_alarms(part["alarms"]),
            alarm_words=_alarm_words,
            **_SHOWN,
        )

    async def picture(self, visit: Visit) -> Response:
        """Return a picture of a part by its number; its file is named by the store alone."""
        try:
            part = await self._records.part(visit.request.path_params)
        except HistoryError:
            return refused(404, word("there is no such part"))
        found = await self._records.picture(part, visit.request.path_params["picture"])
        if isinstance(found, str):
            return refused(404, found)
        return await picture_of(found) or refused(404, word("there is no such picture"))

    async def file(self, visit: Visit) -> Response:
        """Return a run, a part or all parts that fit as a file to be kept, no page of this one.

        A part or a run is named by the address, all parts that fit by the filters of the list.
        """
        at = visit.request.path_params
        form, number = str(at["form"]), int(at.get("number", 0))
        filters = None if "run" in at else asked(visit.request.query_params).filters
        if form not in (FORMS if filters is None else LISTED_FORMS):
            return refused(404, word("there is no such form of file"))
        run = ""
        if filters is None:
            try:
                part = await self._records.part({"run": at["run"], "number": number or 1})
            except HistoryError:
                return refused(404, word("there is no such part"))
            if await self._records.journal(part) is None:
                why = teller(visit.language)(ELSEWHERE)
                return visit.html("unread.html.j2", 409, title=visit.screen.title, why=why)
            run = str(part["run"])
        else:
            await self._records.freshen()
        wanted = WantedFile(form, run, number, filters)
        folder = Path(await asyncio.to_thread(mkdtemp, prefix="cellctl-file-"))
        path = folder / f"file.{form}"
        try:
            why = await self._records.written(wanted, path)
            content = b"" if why else await asyncio.to_thread(path.read_bytes)
        finally:
            await asyncio.to_thread(rmtree, folder, ignore_errors=True)
        if why:
            return visit.html(
                "unread.html.j2", 409, title=visit.screen.title, why=teller(visit.language)(why)
            )
        headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(wanted.name)}"}
        return Response(content, media_type=FORMS[form], headers=headers)

    async def charts(self, visit: Visit) -> Response:
        """Return the run charts of a recipe's characteristics."""
        query = visit.request.query_params
        await self._records.freshen()
        wanted = asked(query)
        try:
            cells = await self._records.query(cells_in)
            recipes = await self._records.query(recipes_in)
            recipe = wanted.filters.recipe or (recipes[0] if recipes else "")
            characteristics = await self._records.query(characteristics_in, recipe)
            known = {str(one["id"]): one for one in characteristics}
            chosen = query.get("characteristic", "")
            if chosen not in known:
                chosen = next(iter(known), "")
            values = await self._records.query(
                values_of, wanted.filters, recipe, chosen, VALUES_MAX
            )
        except HistoryError as error:
            return unread(visit, error)
        return visit.html(
            "charts.html.j2",
            asked=wanted,
            recipe=recipe,
            cells=cells if len(cells) > 1 else (),
            recipes=recipes,
            characteristics=characteristics,
            chosen=chosen,
            one=known.get(chosen),
            values=values,
            drawn=await asyncio.to_thread(
                drawn,
                values,
                translator(visit.language, "history"),
                partial(value_in, visit.language),
            ),
            most=VALUES_MAX,
            **_SHOWN,
        )

    async def compare(self, visit: Visit) -> Response:
        """Return two parts side by side."""
        names = visit.request.query_params.getlist("part")[:COMPARED]
        await self._records.freshen()
        try:
            parts = [await self._records.query(one_part, name) for name in names]
        except HistoryError as error:
            return unread(visit, error)
        both = parts if len(parts) == COMPARED else []
        found = [await self._records.pictures(one) for one in both]
        return visit.html(
            "compare.html.j2",
            parts=both,
            rows=_rows(*both) if both else (),
            pairs=_pairs(*found) if both else (),
            no_pictures=[one for one in found if isinstance(one, str)],
            **_SHOWN,
        )


_SHOWN: Final[Mapping[str, Any]] = {
    "verdict_class": verdict_class,
    "part_key": part_key,
}


def _alarm_words(number: int) -> str:
    """Return an alarm's text; empty for one of another version."""
    alarm = BY_NUMBER.get(number)
    return "" if alarm is None else alarm.words


def _rows(a: Mapping[str, Any], b: Mapping[str, Any]) -> tuple[Mapping[str, Any], ...]:
    """Return the characteristics of two parts beside each other, as the first one numbers them."""
    of_b = {str(one["id"]): one for one in b["characteristics"]}
    rows = []
    for one in a["characteristics"]:
        other = of_b.pop(str(one["id"]), None)
        rows.append({"a": one, "b": other, "difference": _difference(one, other)})
    rows += [{"a": None, "b": other, "difference": None} for other in of_b.values()]
    return tuple(rows)


def _pairs(
    a: tuple[PartPicture, ...] | str, b: tuple[PartPicture, ...] | str
) -> tuple[tuple[PartPicture | None, PartPicture | None], ...]:
    """Return the pictures of two parts beside each other: of one view under one lamp."""
    of_a, of_b = (
        {} if isinstance(one, str) else {(picture.view, picture.lamp): picture for picture in one}
        for one in (a, b)
    )
    return tuple((of_a.get(key), of_b.get(key)) for key in dict.fromkeys([*of_a, *of_b]))


def counted_alarms(alarms: Sequence[Mapping[str, Any]]) -> list[tuple[Mapping[str, Any], int]]:
    """Return alarms in order, repeated ones once with their number."""
    firsts: dict[tuple[object, ...], Mapping[str, Any]] = {}
    counts: Counter[tuple[object, ...]] = Counter()
    for one in alarms:
        key = (one["alarm"], one["device"])
        firsts.setdefault(key, one)
        counts[key] += 1
    return [(one, counts[key]) for key, one in firsts.items()]


def _difference(a: Mapping[str, Any], b: Mapping[str, Any] | None) -> float | None:
    if b is None or a["measured"] is None or b["measured"] is None:
        return None
    return float(b["measured"]) - float(a["measured"])
