"""The history for the screens: one store, opened once, never queried in the page's loop."""

import asyncio
import multiprocessing
import os
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, ClassVar, Concatenate, Final, ParamSpec, TypeVar
from weakref import WeakValueDictionary

from controller.cell.journal import JOURNAL_NAME, JournalError, journal_mark
from controller.history import HistoryError, Store, journals_by_key, open_store, store_url
from controller.history.reviewing import one_part
from controller.results.run import ObjectStore, ResultsError

from ..frame.words import word
from .files import WantedFile, write_wanted
from .pictures import PartPicture, PartShown, pictures_of, read_picture, shown
from .work import begin, draw_crop, fill_store

P = ParamSpec("P")
T = TypeVar("T")

NEWER_S: Final = 2.0  # age up to which a filled store is not filled again
# nor within this many times the last filling's duration, so that filling takes little of a run's
# machine, however many browsers ask
REST_COUNT: Final = 20
WAIT_S: Final = 0.1  # an answer waits this long for the filling, then reports that it goes on
CROP_MAX_COUNT: Final = 200  # number of crops kept, 30 kB each
QUERIES_AT_ONCE: Final = 4  # questions to the store at a time; the others wait
CROPS_AT_ONCE: Final = 2
SHOWN_COUNT: Final = 50  # number of parts whose pictures in the journal are remembered
READS_AT_ONCE: Final = 2
COPIES_AT_ONCE: Final = 4  # pictures read at a time, from a folder or a store of objects
ASKED_AGAIN_S: Final = 60.0  # a store of objects that did not answer is asked again after this
ELSEWHERE: Final = word("the journal of this part is not here: the machine of its cell shows it")
NO_COPIES: Final = word("the pictures are on the machine of the part's cell; no copies were made")
# number at a time; each takes the drawing process for seconds, and the others wait
FILES_AT_ONCE: Final = 1
END_S: Final = 1.0


def make_pool() -> Executor:
    """Return the process that fills and draws."""
    apart = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(1, mp_context=apart, initializer=begin)


class Records:
    """Parts of all runs in one folder.

    Parameters
    ----------
    runs_dir : folder of all runs
    """

    _known: ClassVar[WeakValueDictionary[Path, "Records"]] = WeakValueDictionary()

    @classmethod
    def of(cls, runs_dir: Path) -> "Records":
        """Return the records of a folder; all screens have the same."""
        found = cls._known.get(runs_dir)
        if found is None:
            found = cls._known[runs_dir] = cls(runs_dir)
        return found

    def __init__(self, runs_dir: Path) -> None:
        self.runs_dir = runs_dir
        self.problems: tuple[str, ...] = ()
        self._keeper_count = 0
        self._url = store_url(runs_dir, None, os.environ)
        self._store: Store | None = None
        self._pool: Executor | None = None
        self._filling: asyncio.Task[None] | None = None
        self._filled_s = float("-inf")
        self._took_s = 0.0
        self._mark: tuple[object, ...] | None = None
        self._querying = asyncio.Semaphore(QUERIES_AT_ONCE)
        self._drawing = asyncio.Semaphore(CROPS_AT_ONCE)
        self._writing = asyncio.Semaphore(FILES_AT_ONCE)
        self._reading = asyncio.Semaphore(READS_AT_ONCE)
        self._shown: OrderedDict[str, PartShown] = OrderedDict()
        self._copying = asyncio.Semaphore(COPIES_AT_ONCE)
        self._stores: dict[str, ObjectStore | str] = {}
        self._asked_s = float("-inf")
        self._opening = asyncio.Lock()
        self._crops: OrderedDict[tuple[str, int, str], bytes] = OrderedDict()

    @asynccontextmanager
    async def kept(self) -> AsyncIterator[None]:
        """Close store and process when the page ends."""
        self._keeper_count += 1
        try:
            yield
        finally:
            self._keeper_count -= 1
            if self._keeper_count == 0:
                await self._close()

    async def _close(self) -> None:
        if self._filling is not None:
            self._filling.cancel()
        if self._pool is not None:
            ending = asyncio.create_task(
                asyncio.to_thread(self._pool.shutdown, cancel_futures=True)
            )
            if not (await asyncio.wait([ending], timeout=END_S))[0]:
                for process in multiprocessing.active_children():
                    process.terminate()  # half a filling is begun again
            await ending
        if self._store is not None:
            self._store.close()
        self._filling, self._pool, self._store = None, None, None

    async def query(
        self, question: Callable[Concatenate[Store, P], T], *args: P.args, **kwargs: P.kwargs
    ) -> T:
        """Return the answer of the history to a question, computed in a thread.

        Parameters
        ----------
        question : takes the store first
        args, kwargs : further arguments

        Raises
        ------
        HistoryError : there is no store, or it cannot be read
        """
        async with self._querying:
            store = await self._opened()
            return await asyncio.to_thread(question, store, *args, **kwargs)

    async def part(self, at: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the record of a part, with the newest rows of the journal.

        Parameters
        ----------
        at : its `run` and `number`, as an address has them

        Raises
        ------
        NoSuchPartError : there is no such part
        HistoryError : there is no store, or it cannot be read
        """
        await self.freshen()
        return await self.query(one_part, f"{at['run']}/{at['number']}")

    async def freshen(self) -> bool:
        """Have new data filled into the store; return True while the filling goes on."""
        now_s = time.monotonic()
        mark = self._marked()
        is_running = self._filling is not None and not self._filling.done()
        is_new = mark != self._mark and any(mark)
        rest_s = max(NEWER_S, REST_COUNT * self._took_s)
        if not is_running and is_new and now_s - self._filled_s > rest_s:
            self._mark, self._filled_s = mark, now_s
            self._filling = asyncio.create_task(self._fill())
        if self._filling is None:
            return False
        await asyncio.wait([self._filling], timeout=WAIT_S)
        return not self._filling.done()

    async def journal(self, part: Mapping[str, Any]) -> Path | None:
        """Return the journal of a part; None if it is not in this folder, but of another cell.

        Parameters
        ----------
        part : as the history has it
        """
        there = await asyncio.to_thread(journals_by_key, self.runs_dir)
        return there.get(str(part["journal"]))

    async def crop(self, part: Mapping[str, Any], finding: int, which: str) -> bytes | str:
        """Return a crop of a finding as JPEG, or why there is none.

        Parameters
        ----------
        part : as the history has it
        finding : its number
        which : one of the crops
        """
        key = (str(part["part"]), finding, which)
        if key in self._crops:
            self._crops.move_to_end(key)
            return self._crops[key]
        journal = await self.journal(part)
        if journal is None:
            return ELSEWHERE
        run, number = str(part["run"]), int(part["number"])
        async with self._drawing:
            found = await self._apart(draw_crop, journal, run, number, finding, which)
        if isinstance(found, bytes):
            self._crops[key] = found
            while len(self._crops) > CROP_MAX_COUNT:
                self._crops.popitem(last=False)
        return found

    async def shown(self, part: Mapping[str, Any]) -> PartShown | str:
        """Return the journal's data of a part, or the reason why there are none.

        Parameters
        ----------
        part : as the history has it
        """
        name, run, number = str(part["part"]), str(part["run"]), int(part["number"])
        async with self._reading:
            if name in self._shown:
                return self._shown[name]
            journal = await self.journal(part)
            if journal is None:
                return ELSEWHERE
            try:
                found = await asyncio.to_thread(shown, journal, run, number)
            except (JournalError, ResultsError) as error:
                return str(error)
        if found is None:
            return word("there is no such part")
        if found.is_whole:
            self._shown[name] = found
            while len(self._shown) > SHOWN_COUNT:
                self._shown.popitem(last=False)
        return found

    async def pictures(self, part: Mapping[str, Any]) -> tuple[PartPicture, ...] | str:
        """Return the pictures of a part, or why there are none.

        Parameters
        ----------
        part : as the history has it
        """
        found = pictures_of(part)
        if found and not part["copied_to"] and await self.journal(part) is None:
            return NO_COPIES
        return found

    async def picture(self, part: Mapping[str, Any], number: int) -> bytes | str:
        """Return a picture of a part, or why there is none; one of a copy is checked by its hash.

        Parameters
        ----------
        part : as the history has it
        number : number of the picture, of `pictures`
        """
        if not 0 <= number < len(part["pictures"]):
            return word("there is no such picture")
        folder = None if await self.journal(part) is None else self.runs_dir / str(part["run"])
        now_s = time.monotonic()
        if now_s - self._asked_s > ASKED_AGAIN_S:  # one that was away may be back
            self._asked_s, self._stores = now_s, {}
        async with self._copying:
            return await asyncio.to_thread(read_picture, part, number, folder, self._stores)

    async def written(self, wanted: WantedFile, path: Path) -> str:
        """Write a file for a person; return the reason if it was not written, else empty.

        Parameters
        ----------
        wanted : filters
        path : its place
        """
        async with self._writing:
            return await self._apart(write_wanted, self._url, self.runs_dir, wanted, path)

    async def _apart(self, work: Callable[..., T], *args: object) -> T | str:
        """Do work in its process; return the result, or the reason why it failed."""
        loop = asyncio.get_running_loop()
        try:
            return await loop.run_in_executor(self._pooled(), work, *args)
        except OSError as error:
            return str(error)
        except RuntimeError as error:  # the process was killed; the next request makes one
            self._pool = None
            return f"{error}; try again"

    async def _opened(self) -> Store:
        async with self._opening:
            if self._store is None:
                own = store_url(self.runs_dir, None, {})
                if self._url == own and not self.runs_dir.is_dir():
                    raise HistoryError(f"no folder {self.runs_dir}: nothing ran here yet")
                self._store = await asyncio.to_thread(open_store, self._url)
            return self._store

    async def _fill(self) -> None:
        loop = asyncio.get_running_loop()
        try:
            self.problems, self._took_s = await loop.run_in_executor(
                self._pooled(), fill_store, self._url, self.runs_dir
            )
        except (OSError, RuntimeError) as error:
            self._pool, self._mark = None, None
            self.problems = (f"the history was not filled: {error}",)

    def _pooled(self) -> Executor:
        if self._pool is None:
            self._pool = make_pool()
        return self._pool

    def _marked(self) -> tuple[object, ...]:
        """Return a mark that changes with the journal; all None where there is none."""
        try:
            return journal_mark(self.runs_dir / JOURNAL_NAME)
        except OSError:
            return ()
