"""People's access to a run: its control socket, and the terminal that it was started from."""

import asyncio
import sys
import threading
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from controller.cell.batch import Dispatcher
from controller.cell.control import MAX_WHY, make_folder
from controller.cell.control.serving import STOPS, Control, handle_for, serving
from controller.cell.devices.supervision import CallerPrograms
from controller.cell.lock import Holder
from controller.cell.operator import Answer, Desk, OpenQuestion, Operator, Question

from ..terminal.output import emit, warn


class OperatorDoor:
    """The control socket and the terminal of one run.

    Parameters
    ----------
    runs_dir : folder of all runs; the socket is found by its lock
    holder : this process, as the lock names it
    in_advance : answer given before anybody is asked; None without one
    waits : wait for an answer also where there is no terminal
    scans : serial numbers are typed; where there is no terminal, standard input has a line for each
    as_json : print questions as JSON lines

    Attributes
    ----------
    desk : desk for questions
    callers : callers of the control socket, while it is served
    """

    def __init__(
        self,
        runs_dir: Path,
        holder: Holder,
        in_advance: Operator | None = None,
        *,
        waits: bool,
        scans: bool = False,
        as_json: bool,
    ) -> None:
        self._in_advance = in_advance
        self._runs_dir = runs_dir
        self._holder = holder
        self._as_json = as_json
        self._has_terminal = sys.stdin.isatty() and sys.stderr.isatty() and not as_json
        self._is_attended = waits or self._has_terminal
        # lines of a pipe are read one by one, each once it is asked for
        self._reads_lines = scans and not self._is_attended
        self._is_reading = False
        self.desk = Desk(is_attended=self._is_attended or scans, on_change=self._show)
        self._control = Control(holder.run, holder, self.desk)
        self.callers: CallerPrograms | None = None

    async def decide(self, question: Question) -> Answer | None:
        """Return the answer given in advance, or else the answer of the person present."""
        if self._in_advance is not None:
            answer = await self._in_advance.decide(question)
            if answer is not None:
                return answer
        if self._reads_lines and not question.entry:
            return None  # a pipe has serial numbers, and decides nothing
        return await self.desk.decide(question)

    def attach(self, dispatcher: Dispatcher) -> None:
        """Let orders through to the dispatcher of the run."""
        self._control.attach(dispatcher)
        dispatcher.on_early_end(self.desk.leave)

    def attach_stop(self, stop: Callable[[str, str], None]) -> None:
        """Let stops through to work that has no dispatcher, as message and code."""
        self._control.attach_stop(stop)

    @asynccontextmanager
    async def open(self) -> AsyncIterator[None]:
        """Serve the control socket and hear the terminal while the block runs.

        Raises
        ------
        ControlError : the socket cannot be served
        """
        make_folder()
        path = Path(self._holder.control)
        loop = asyncio.get_running_loop()
        async with serving(path, handle_for(self._control), STOPS) as self.callers:
            if self._has_terminal:
                loop.add_reader(sys.stdin.fileno(), self._hear)
            try:
                yield
            finally:
                if self._has_terminal:
                    loop.remove_reader(sys.stdin.fileno())

    def _show(self, raised: OpenQuestion | None) -> None:
        if raised is None:
            return
        question = raised.question
        if self._as_json:
            choices = {choice.key: choice.words for choice in question.choices}
            emit(
                {
                    "event": "question",
                    "number": raised.number,
                    "code": question.code,
                    "text": question.text,
                    "choices": choices,
                    "preview": dict(question.preview),
                    "entry": question.entry,
                }
            )
            self._read_line()
            return
        first = dict(question.preview)
        warn(f"question {raised.number}: {question.text}")
        for choice in question.choices:
            more = f" (first: {first[choice.key]})" if choice.key in first else ""
            warn(f"  {choice.key:6} {choice.words}{more}")
        enter = "Enter, or " if len(question.choices) == 1 else ""
        what = "the number" if question.entry else "an answer and a reason"
        here = f"{enter}type {what}, or " if self._has_terminal else ""
        warn(f"{here}cellctl answer ANSWER --runs {self._runs_dir} from another terminal")
        self._read_line()

    def _hear(self) -> None:
        """Take a line typed at the terminal: an answer, and behind it the reason.

        An empty line is the answer to a question that has only one.
        """
        line = sys.stdin.readline()
        if not line:  # the terminal is gone; `ends.py` notices that, too
            asyncio.get_running_loop().remove_reader(sys.stdin.fileno())
            return
        raised = self.desk.open
        if raised is not None and raised.question.entry:
            self._take_entry(line)
            return
        key, _, why = line.strip().partition(" ")
        if not key:
            if raised is None or len(raised.question.choices) != 1:
                return
            key = raised.question.choices[0].key
        who = f"{self._holder.user} at the terminal"
        refusal = self.desk.answer(None, Answer(key, who, why.strip()[:MAX_WHY]))
        if refusal:
            warn(refusal)

    def _take_entry(self, line: str) -> None:
        """Take a line typed for a question that asks for a text."""
        who = f"{self._holder.user} at the {'terminal' if self._has_terminal else 'input'}"
        refusal = self.desk.answer(None, Answer(line.strip(), who))
        if refusal:
            warn(refusal)

    def _read_line(self) -> None:
        """Have the next line of a pipe read for the open question; its end leaves nobody there."""
        if not self._reads_lines or self._is_reading:
            return
        self._is_reading = True
        loop = asyncio.get_running_loop()

        def read() -> None:
            line = sys.stdin.readline()
            with suppress(RuntimeError):  # the run has ended meanwhile
                loop.call_soon_threadsafe(self._take_line, line)

        threading.Thread(target=read, daemon=True, name="serial numbers").start()

    def _take_line(self, line: str) -> None:
        self._is_reading = False
        if self.desk.open is None:
            if line.strip():
                warn(f"{line.strip()}: no serial number was asked for; the line is left out")
            return
        if not line:
            self.desk.leave()
            return
        self._take_entry(line)
        if self.desk.open is not None and not self.desk.is_answered:
            self._read_line()
