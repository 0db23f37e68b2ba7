"""Answers of *Review*: the list of parts, one part, its crops, and the verdict on it."""

import asyncio
from collections.abc import Mapping
from typing import Any, Final, Literal

from pydantic import Field
from starlette.responses import Response

from controller.cell.control import MAX_WHY
from controller.history import Filters, HistoryError, NoSuchPartError, list_parts
from controller.history.reviewing import PartDecision, agreement, decide

from ..frame.drawn import mesh_of, packed, packed_json
from ..frame.screens import GetRoute, PostBody, PostRoute, Setting
from ..frame.visit import JsonAnswer, Visit, refused, worded
from ..frame.words import word
from ..records import Records, page_asked, page_count, part_key, unread, verdict_class
from ..security import Role
from .places import places_of

LISTED: Final = 50
DECIDED: Final = 10
PAGE_MAX: Final = 10_000
FINDING_MAX: Final = 10_000
RUN: Final = r"^([^/\x00-\x1f]{1,200}/)?[\w.+-]{1,200}$"  # behind its cell, where several have it
CROP_TITLES: Final = (
    ("picture", word("picture")),
    ("predicted", word("predicted by the CAD")),
    ("difference", word("difference")),
    ("place", word("where on the part")),
)


class DecideBody(PostBody):
    """A verdict of a person, as the browser sends it.

    `seen` is the number of persons' verdicts that the page showed.
    """

    run: str = Field(pattern=RUN)
    number: int = Field(ge=1)
    verdict: Literal["accept", "reject"]
    why: str = Field(min_length=1, max_length=MAX_WHY)
    findings: dict[str, Literal["real", "false_alarm"]] = Field(
        default_factory=dict, max_length=FINDING_MAX
    )
    seen: int = Field(ge=0)


class ReviewAnswers:
    """The answers of *Review*.

    Parameters
    ----------
    setting : start options of the page
    records : parts of all runs
    """

    def __init__(self, setting: Setting, records: Records) -> None:
        self._runs_dir = setting.runs_dir
        self._records = records
        self._deciding = asyncio.Lock()

    @property
    def every(self) -> tuple[GetRoute | PostRoute, ...]:
        """All answers."""
        return (
            GetRoute("", self.list),
            GetRoute("part/{run:path}/{number:int}", self.part),
            GetRoute("coverage/{run:path}/{number:int}", self.coverage),
            GetRoute("crop/{run:path}/{number:int}/{finding:int}/{which:str}", self.crop),
            PostRoute("decide", DecideBody, self.decide, Role.OPERATOR),
        )

    async def list(self, visit: Visit) -> Response:
        """Return the parts that await a person, and those decided on last."""
        page = page_asked(visit.request.query_params, PAGE_MAX)
        is_filling = await self._records.freshen()
        try:
            waiting = await self._records.query(
                list_parts, Filters(review="awaiting"), LISTED, skipped=LISTED * (page - 1)
            )
            decided = await self._records.query(list_parts, Filters(review="reviewed"), DECIDED)
            agreed = await self._records.query(agreement, Filters())
        except HistoryError as error:
            return unread(visit, error)
        likely = {(one.part, one.number) for one in agreed.likely}
        hints = {part: sum(one == part for one, _ in likely) for part, _ in likely}
        return visit.html(
            "review.html.j2",
            waiting=waiting,
            decided=decided,
            agreed=agreed,
            hints=hints,
            page=page,
            pages=page_count(waiting.count, LISTED),
            is_filling=is_filling,
            problems=self._records.problems,
            verdict_class=verdict_class,
            part_key=part_key,
        )

    async def part(self, visit: Visit) -> Response:
        """Return one part with its findings, and the form for the verdict."""
        try:
            part = await self._records.part(visit.request.path_params)
            likely = (await self._records.query(agreement, Filters(recipe=part["recipe"]))).likely
        except HistoryError as error:
            return unread(visit, error)
        pictures = await self._records.pictures(part)
        return visit.html(
            "part.html.j2",
            part=part,
            places=places_of(part["findings"]),
            pictures=pictures if isinstance(pictures, tuple) else (),
            no_pictures=pictures if isinstance(pictures, str) else "",
            unproven=unproven(part),
            is_decisive=is_decisive,
            likely={one.number: one.reviewed for one in likely if one.part == part["part"]},
            crops=CROP_TITLES,
            max_why=MAX_WHY,
            verdict_class=verdict_class,
            part_key=part_key,
        )

    async def coverage(self, visit: Visit) -> Response:
        """Return the part's mesh, and the compared share of each of its faces."""
        at = visit.request.path_params
        try:
            part = await self._records.part(at)
        except HistoryError:
            return refused(404, word("there is no such part"))
        found = await self._records.shown(part)
        if isinstance(found, str):
            return refused(404, found)
        if found.coverage is None:
            return refused(404, word("the part was not judged"))
        mesh = await asyncio.to_thread(
            lambda: mesh_of(found.recipe, found.files, self._runs_dir / str(part["run"]))
        )
        return packed(
            packed_json(worded({"mesh": mesh, "coverage": found.coverage}, visit.language))
        )

    async def crop(self, visit: Visit) -> Response:
        """Return a crop of a finding."""
        at = visit.request.path_params
        try:
            part = await self._records.part(at)
        except HistoryError:
            return refused(404, word("there is no such part"))
        found = await self._records.crop(part, at["finding"], at["which"])
        if isinstance(found, str):
            return refused(404, found)
        headers = {"Cache-Control": "private, max-age=3600"}
        return Response(found, media_type="image/jpeg", headers=headers)

    async def decide(self, visit: Visit, body: DecideBody) -> Response:
        """Return the part after a person's verdict, once the journal has it in their name.

        Parameters
        ----------
        visit : visit of the person who decides
        body : the verdict
        """
        try:
            findings = {int(number): said for number, said in body.findings.items()}
        except ValueError:
            return refused(422, word("the order makes no sense"))
        decision = PartDecision(body.verdict, visit.who, body.why, findings)
        name = f"{body.run}/{body.number}"
        await self._records.freshen()
        try:
            async with self._deciding:
                part = await self._records.query(
                    decide, self._runs_dir, name, decision, seen=body.seen
                )
        except NoSuchPartError:
            return refused(404, word("there is no such part"))
        except HistoryError as error:
            return refused(409, str(error))
        return JsonAnswer({"review": part["review"], "part": part["part"]})


def unproven(part: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return a part's characteristics that are FAIL or INDETERMINATE, the decisive ones first.

    Parameters
    ----------
    part : as `controller.history` has it
    """
    found = [c for c in part["characteristics"] if c["verdict"] in ("fail", "indeterminate")]
    return sorted(found, key=lambda c: not is_decisive(c, part))


def is_decisive(characteristic: Mapping[str, Any], part: Mapping[str, Any]) -> bool:
    """Return whether the machine's reason names a characteristic."""
    return bool(characteristic["label"]) and f"{characteristic['label']}:" in part["reason"]
