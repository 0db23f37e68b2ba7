"""Answers of *Recipes*: the list, one recipe, work on it, its changes, new parts."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field
from starlette.responses import Response

from controller.config import ConfigError, Recipe

from ..frame import (
    GetRoute,
    JsonAnswer,
    NoBody,
    PostBody,
    PostRoute,
    Setting,
    Upload,
    Uploaded,
    Visit,
    refused,
    word,
    worded,
)
from ..frame.drawn import packed, packed_json
from ..security import Role
from ..work import BusyError, ChildWork, Workshop, WorkState
from .editing import NotAsShownError, RecipeChanges, drafted, save
from .folder import ReadRecipe, RecipeFile, RecipeFolder, read_recipe
from .noting import note
from .shown import check_shown, mesh_shown, part_shown, plan_shown
from .taking import UploadStage, take

SENT: Final = "sent"  # the key of a file that was sent and is no recipe yet
MAX_KEY: Final = 200
UPLOAD_MAX_BYTES: Final = 200_000_000
SUFFIXES: Final = frozenset({".stl", ".obj", ".ply", ".off", ".3mf", ".step", ".stp"})
PICTURE: Final = re.compile(r"(?:pose-\d{1,4}|step-\d{1,4}(?:-outside)?)\.png")
MAX_POSE: Final = 999  # index of a stable pose
COMMANDS: Final[dict[str, Callable[[str, str], tuple[str, ...]]]] = {
    "part": lambda recipe, folder: (
        "compile", "--recipe", recipe, "--no-plans", "--json", "--drawings", folder,
    ),
    "plan": lambda recipe, folder: ("plan", "--recipe", recipe, "--json", "--drawings", folder),
    "check": lambda recipe, _: ("check", recipe, "--json"),
}  # fmt: skip
SHOWN: Final[dict[str, Callable[[dict[str, Any]], dict[str, Any]]]] = {
    "part": part_shown,
    "plan": plan_shown,
    "check": check_shown,
}


class WorkBody(PostBody):
    """Work on a recipe; a plan may be made from one stable pose, by its index."""

    of: str = Field(min_length=1, max_length=MAX_KEY)
    kind: Literal["part", "plan", "check"]
    pose: int | None = Field(default=None, ge=0, le=MAX_POSE)


class DraftBody(PostBody):
    """Changes of a recipe, to be shown as a diff."""

    of: str = Field(min_length=1, max_length=MAX_KEY)
    changes: RecipeChanges


class SaveBody(DraftBody):
    """Changes of a recipe, to be written exactly as displayed."""

    seen: str = Field(min_length=64, max_length=64)


class SentBody(PostBody):
    """Options for reading an uploaded file."""

    unit: Literal["mm", "cm", "m", "inch"] = "mm"
    body: str = Field(default="", max_length=120)


class TakeBody(SentBody):
    """The file that was sent, to become a recipe."""

    name: str = Field(min_length=1, max_length=60)


class RecipeAnswers:
    """The screen *Recipes*.

    Parameters
    ----------
    setting : start options of the page
    workshop : working folder of child processes
    """

    def __init__(self, setting: Setting, workshop: Workshop) -> None:
        self._runs_dir = setting.runs_dir
        self._folder = RecipeFolder(setting.project_dir)
        self._workshop = workshop
        self._stage = UploadStage()
        self._writing = asyncio.Lock()

    @property
    def every(self) -> tuple[GetRoute | PostRoute | Upload, ...]:
        """All answers."""
        one = "{group:str}/{name:str}"
        return (
            GetRoute("", self.page),
            GetRoute("list", self.list),
            GetRoute(f"one/{one}", self.one),
            GetRoute(f"facts/{one}", self.facts),
            GetRoute(f"mesh/{one}", self.mesh),
            GetRoute(f"picture/{one}/{{kind:str}}/{{file:str}}", self.picture),
            GetRoute("work", self.work),
            *(GetRoute(f"{kind}/{one}", self._result(kind)) for kind in SHOWN),
            PostRoute("start", WorkBody, self.start, Role.OPERATOR),
            PostRoute("cancel", NoBody, self.cancel, Role.OPERATOR),
            PostRoute("draft", DraftBody, self.draft, Role.ENGINEER),
            PostRoute("save", SaveBody, self.save, Role.ENGINEER),
            Upload("send", UPLOAD_MAX_BYTES, SUFFIXES, self.send, Role.ENGINEER),
            PostRoute("read-again", SentBody, self.read_again, Role.ENGINEER),
            PostRoute("take", TakeBody, self.take, Role.ENGINEER),
        )

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Be ready for work while the page is served."""
        async with self._workshop.open():
            try:
                yield
            finally:
                self._stage.clear()

    async def page(self, visit: Visit) -> Response:
        """Return the list, as a page."""
        return visit.html("recipes.html.j2", suffixes=",".join(sorted(SUFFIXES)))

    async def list(self, _: Visit) -> Response:
        """Return all recipes."""
        read = await asyncio.to_thread(lambda: [read_recipe(file) for file in self._folder.files()])
        return JsonAnswer({"recipes": [self._listed(one) for one in read]})

    async def one(self, visit: Visit) -> Response:
        """Return one recipe, as a page."""
        file = await self._asked(visit)
        if file is None:
            return _missing()
        return visit.html("recipe.html.j2", key=file.key, name=file.path.stem, is_own=file.is_own)

    async def facts(self, visit: Visit) -> Response:
        """Return a recipe in its present state, with all results on it."""
        file = await self._asked(visit)
        if file is None:
            return _missing()
        read = await asyncio.to_thread(read_recipe, file)
        found = self._listed(read) | {"sha256": read.sha256, "recipe": _words_of(read.recipe)}
        return JsonAnswer(found)

    async def mesh(self, visit: Visit) -> Response:
        """Return the mesh of a recipe's part, or of the uploaded file."""
        work = await self._worked(visit, "part")
        if work is None:
            return _missing()
        return packed(
            await asyncio.to_thread(
                lambda: packed_json(worded(mesh_shown(work.folder), visit.language))
            )
        )

    async def picture(self, visit: Visit) -> Response:
        """Return a picture that a child process has drawn."""
        kind, name = visit.request.path_params["kind"], visit.request.path_params["file"]
        work = await self._worked(visit, kind) if kind in SHOWN else None
        if work is None or not PICTURE.fullmatch(name):
            return _missing()
        try:
            data = await asyncio.to_thread((work.folder / name).read_bytes)
        except OSError:
            return _missing()
        return Response(data, media_type="image/png")

    async def work(self, _: Visit) -> Response:
        """Return the work in progress."""
        running = self._workshop.running
        return JsonAnswer({"running": None if running is None else running.facts()})

    async def start(self, visit: Visit, body: WorkBody) -> Response:
        """Start work on a recipe; return its description."""
        file = await asyncio.to_thread(self._folder.find, body.of)
        if file is None:
            return _missing()
        read = await asyncio.to_thread(read_recipe, file)
        if read.recipe is None:
            return refused(409, read.problem)
        path = str(file.path.resolve())
        is_posed = body.kind == "plan" and body.pose is not None
        posed = (f"--pose={body.pose}",) if is_posed else ()
        return self._start(
            body.kind,
            body.of,
            visit.who,
            lambda folder: (*COMMANDS[body.kind](path, str(folder)), *posed),
            read.mark,
            Path(path).parent,
        )

    async def cancel(self, _visit: Visit, _body: NoBody) -> Response:
        """End the work in progress; return False if there was none."""
        return JsonAnswer({"done": await self._workshop.cancel()})

    async def draft(self, _visit: Visit, body: DraftBody) -> Response:
        """Return the diff that changes make."""
        file = await asyncio.to_thread(self._folder.find, body.of)
        if file is None:
            return _missing()
        try:
            draft = await asyncio.to_thread(drafted, file, body.changes)
        except ConfigError as error:
            return refused(422, self._short(error))
        except NotAsShownError as error:
            return refused(409, str(error))
        return JsonAnswer({"diff": draft.diff, "seen": draft.sha256})

    async def save(self, visit: Visit, body: SaveBody) -> Response:
        """Write a recipe exactly as displayed; return the result."""
        file = await asyncio.to_thread(self._folder.find, body.of)
        if file is None:
            return _missing()

        def write() -> None:
            before = body.changes.sha256
            draft = save(file, body.changes, body.seen)
            facts = {"before": before, "after": draft.sha256, "diff": draft.diff}
            note(self._runs_dir, visit.who, "recipe changed", str(file.path), **facts)

        async with self._writing:
            return await self._written(write)

    async def send(self, visit: Visit, sent: Uploaded) -> Response:
        """Keep a CAD file that was sent, and have a child process read it; return that work."""
        if self._workshop.running is not None:
            return _busy()
        await asyncio.to_thread(self._stage.put, sent.name, sent.path)
        return self._read(visit)

    async def read_again(self, visit: Visit, body: SentBody) -> Response:
        """Have the file that was sent read anew, in a unit and as a body; return that work."""
        if self._stage.file is None:
            return _nothing_sent()
        if self._workshop.running is not None:
            return _busy()
        self._stage.file = self._stage.file.with_choice(body.unit, body.body)
        return self._read(visit)

    async def take(self, visit: Visit, body: TakeBody) -> Response:
        """Make a recipe of the file that was sent; return its key."""
        staged = self._stage.file
        if staged is None:
            return _nothing_sent()
        work = self._workshop.last("part", SENT)
        wanted = staged.with_choice(body.unit, body.body)
        if work is None or work.state is not WorkState.DONE or work.mark != wanted.mark:
            return refused(409, word("the file has to be read first, as it is to be taken"))
        made: list[str] = []

        def write() -> None:
            path = take(wanted, self._folder.own, body.name)
            facts = {"part": wanted.part.name, "part_sha256": wanted.sha256}
            note(self._runs_dir, visit.who, "recipe made", str(path), **facts)
            made.append(path.stem)
            self._stage.clear()

        async with self._writing:
            reply = await self._written(write)
        return JsonAnswer({"key": f"project/{made[0]}"}) if made else reply

    def _read(self, visit: Visit) -> Response:
        staged = self._stage.file
        assert staged is not None
        within = staged.path.parent
        return self._start("part", SENT, visit.who, staged.arguments, staged.mark, within)

    def _start(
        self,
        kind: str,
        of: str,
        who: str,
        arguments: Callable[[Path], tuple[str, ...]],
        mark: str,
        within: Path,
    ) -> Response:
        try:
            work = self._workshop.start(kind, of, who, arguments, mark=mark, within=within)
        except BusyError:
            return _busy()
        return JsonAnswer({"running": work.facts()})

    def _result(self, kind: str) -> Callable[[Visit], Any]:
        async def answer(visit: Visit) -> Response:
            work = await self._worked(visit, kind)
            if work is None:
                return _missing()
            return packed(
                await asyncio.to_thread(lambda: packed_json(worded(_shown(work), visit.language)))
            )

        return answer

    async def _asked(self, visit: Visit) -> RecipeFile | None:
        params = visit.request.path_params
        return await asyncio.to_thread(self._folder.find, f"{params['group']}/{params['name']}")

    async def _worked(self, visit: Visit, kind: str) -> ChildWork | None:
        """Return finished work on the subject of a request."""
        params = visit.request.path_params
        key = SENT if params["group"] == SENT else f"{params['group']}/{params['name']}"
        return self._workshop.last(kind, key)

    async def _written(self, write: Callable[[], None]) -> Response:
        """Return the answer to something that writes files."""
        try:
            await asyncio.to_thread(write)
        except ConfigError as error:
            return refused(422, self._short(error))
        except NotAsShownError as error:
            return refused(409, str(error))
        except OSError as error:
            return refused(507, str(error.strerror or error))
        return JsonAnswer({"done": True})

    def _short(self, error: ConfigError) -> str:
        """Return a message without the folder of the project."""
        return str(error).replace(f"{self._folder.own}/", "")

    def _listed(self, read: ReadRecipe) -> dict[str, Any]:
        """Return a recipe's entry in the list."""
        file, recipe = read.file, read.recipe
        known = {kind: self._workshop.last(kind, file.key) for kind in SHOWN}
        return {
            "key": file.key,
            "file": file.path.name,
            "is_own": file.is_own,
            "problem": read.problem,
            "name": "" if recipe is None else recipe.name,
            "part": "" if recipe is None else recipe.part.name,
            "cell": "" if recipe is None else recipe.cell.name,
            "known": {
                kind: work.facts() | {"is_old": work.mark != read.mark}
                for kind, work in known.items()
                if work is not None
            },
        }


def _shown(work: ChildWork) -> dict[str, Any]:
    """Return the result of work, in the form of its kind."""
    bodies = work.bodies() if work.state in (WorkState.DONE, WorkState.REFUSED) else []
    found = SHOWN[work.kind](bodies[0]) if bodies else None
    return {"work": work.facts(), "found": found}


def _words_of(recipe: Recipe | None) -> dict[str, Any] | None:
    """Return the displayed settings of a recipe, and the ones that can be changed."""
    if recipe is None:
        return None
    section = recipe.inspection
    return {
        "unit": recipe.unit,
        "density_g_cm3": recipe.density_g_cm3,
        "force_n": recipe.grasp.force_n,
        "not_inspected": section.not_inspected,
        "inspection": {
            "required": section.required,
            "tolerance_class": section.tolerance_class,
            "min_coverage": section.min_coverage,
            "max_incidence_deg": section.max_incidence_deg,
            "smallest_defect_mm": section.smallest_defect_mm,
        },
    }


def _missing() -> Response:
    return refused(404, word("there is no such recipe, or nothing was worked out of it yet"))


def _busy() -> Response:
    return refused(409, word("something is at work already; wait for it, or cancel it"))


def _nothing_sent() -> Response:
    return refused(409, word("no file was sent; send one first"))
