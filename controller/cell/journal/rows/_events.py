"""Rows of events: the run, its devices, the machine's events, permits, questions."""

from collections.abc import Mapping

from pydantic import Field

from messages.fields import Sentence

from ._body import Body, Fields, Json, NamedBody, Text, TextByName


class RecipeOrdered(Fields):
    """One of several recipes of a run: its content when read, its file and the number of parts."""

    recipe: Json
    file: str
    count: int


class RunBegan(Body):
    """The first row of a run: the recipe, the cell and the options.

    `recipes` are all of them in order, if there are several; `recipe` is the first, and `count`
    counts all parts. `part_identified` assigns each part to one of them.

    `is_dry`: its motions were made without a part, lifted; there is nothing to judge. `after_us`:
    later than each start at this computer known to this one [us since 1970].
    """

    kind = "event"
    row_name = "run_began"
    recipe: Json = Field(default_factory=dict)
    files: Mapping[str, str] = Field(default_factory=dict)
    cell: Json = Field(default_factory=dict)
    devices: Mapping[str, Json] = Field(default_factory=dict)
    emulated_devices: tuple[str, ...] = ()
    emulator: Json = Field(default_factory=dict)
    speed: float = 1.0
    clock: str | None = None
    count: int | None = None
    software: Mapping[str, Text] = Field(default_factory=dict)
    operator: str = ""
    lot: str = ""
    order_number: str = ""
    serials: tuple[str, ...] = ()
    part_temperature_c: float | None = None
    is_dry: bool = False
    recipes: tuple[RecipeOrdered, ...] = ()
    after_us: int = 0

    @property
    def ordered(self) -> tuple[RecipeOrdered, ...]:
        """All recipes of the run, at least one, with their files."""
        alone = RecipeOrdered(
            recipe=self.recipe, file=next(iter(self.files), ""), count=self.count or 1
        )
        return self.recipes or (alone,)


class Connected(TextByName):
    """The identity that each device reported."""

    kind = "event"
    row_name = "connected"


class EmulatedCellEnded(Body):
    """A part of an earlier run is gone, because its emulated cell has ended."""

    kind = "event"
    row_name = "emulated_cell_ended"
    message: Sentence


class AlarmFields(Fields):
    """An alarm (docs/alarms.md): its subject, and the facts that are unknown since then.

    `step` is the action during which it happened, `unknown` the facts that are unknown from now on,
    `action` the action required of a person.
    """

    number: int
    code: str
    device: str = ""
    step: Sentence = ""
    unknown: Sentence = ""
    action: Sentence = ""


class CellEvent(NamedBody):
    """An event, and the state machine's decision; the row's name is the event's."""

    kind = "event"
    answer: str
    source: str = Field(alias="from")
    target: str = Field(alias="to")
    message: Sentence = ""
    code: str = ""
    reason: Sentence = ""
    alarm: AlarmFields | None = None
    who: str = ""
    why: str = ""


class PermitIssued(Body):
    """From here on the cell may move; `by` is the event that permits it."""

    kind = "event"
    row_name = "permit_issued"
    number: int
    by: str


class PermitWithdrawn(Body):
    """From here on nothing may move; `by` is the event that forbids it."""

    kind = "event"
    row_name = "permit_withdrawn"
    number: int
    by: str


class Acknowledged(Body):
    """A person has looked at the cause of a stop: the next start is no longer barred.

    `run` and `code` are of the fault that was acknowledged.
    """

    kind = "event"
    row_name = "acknowledged"
    run: str
    code: str
    who: str
    why: str = ""


class Overtaken(Body):
    """The report of an action that a stop had overtaken."""

    kind = "event"
    row_name = "overtaken"
    effect: str
    message: Sentence


class AtRest(Body):
    """The state that the run came to rest in."""

    kind = "event"
    row_name = "at_rest"
    state: str
    message: Sentence = ""
    code: str = ""
    custody: str = ""
    where: Sentence = ""
    alarm: AlarmFields | None = None


class RunBrokeOff(Body):
    """An error that kept the run from coming to rest."""

    kind = "event"
    row_name = "run_broke_off"
    error: Sentence = ""
    where: Sentence = ""


class SpeedReached(Fields):
    """Cell seconds per second, requested and reached; the delay of this process [s]."""

    asked: float | None = None
    reached: float | None = None
    missed_s: float | None = None


class RunEnded(Body):
    """The last row of a run."""

    kind = "event"
    row_name = "run_ended"
    end: str
    message: Sentence = ""
    parts: int = 0
    speed: SpeedReached = SpeedReached()


class JournalSetAside(Body):
    """A damaged journal got another name, and this one began."""

    kind = "event"
    row_name = "journal_set_aside"
    why: Sentence
    file: str = ""


class JournalNotReadable(Body):
    """The cell's journal is lost or damaged: its knowledge of the cell is lost with it."""

    kind = "event"
    row_name = "journal_not_readable"
    why: Sentence


class QuestionRaised(Body):
    """A question to the operator; nothing moves until it is answered.

    `choices` are the words that may be typed, `preview` is the first motion after each that moves
    something.
    """

    kind = "event"
    row_name = "question_raised"
    code: str
    text: Sentence
    choices: tuple[Sentence, ...]
    preview: Mapping[str, Sentence] = Field(default_factory=dict)
