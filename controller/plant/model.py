"""The payloads that a plant gets and gives, one model each; the same on every wire. No I/O.

Times are UTC. Lengths are mm, areas mm2, `*_fraction` 0..1. What is not known is null. A result is
known by cell, run, part and revision: a receiver drops what it has already. `docs/plant-api.json`
is generated from these models (`python -m controller.plant.schema`).
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Annotated, Final, Literal

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
    model_validator,
)

MAX_TEXT: Final = 80
MAX_PARTS: Final = 100_000
MAX_SERIALS: Final = 2_000
MAX_RECIPES: Final = 20


def _as_text(at: datetime) -> str:
    return at.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("has signs that cannot be printed")
    return text


def _not_blank(text: str) -> str:
    if not text.strip():
        raise ValueError("is empty")
    return text


Time = Annotated[AwareDatetime, PlainSerializer(_as_text, return_type=str)]
Label = Annotated[str, Field(max_length=MAX_TEXT), AfterValidator(_printable)]
Disposition = Literal["accept", "reject", "quarantine"]
Packml = Literal[
    "Stopped", "Starting", "Idle", "Suspended", "Execute", "Stopping", "Aborting", "Aborted",
    "Holding", "Held", "Unholding", "Suspending", "Unsuspending", "Resetting", "Completing",
    "Complete", "Clearing",
]  # fmt: skip
# OMAC PackML (ANSI/ISA-TR88.00.02-2022), OPC 30050 StateCurrent: numbers of the states
PACKML_NUMBERS: Final[Mapping[Packml, int]] = {
    "Clearing": 1, "Stopped": 2, "Starting": 3, "Idle": 4, "Suspended": 5, "Execute": 6,
    "Stopping": 7, "Aborting": 8, "Aborted": 9, "Holding": 10, "Held": 11, "Unholding": 12,
    "Suspending": 13, "Unsuspending": 14, "Resetting": 15, "Completing": 16, "Complete": 17,
}  # fmt: skip
OrderWord = Literal["queued", "asked", "running", "done", "stopped", "refused"]
OPEN: Final[frozenset[OrderWord]] = frozenset({"queued", "asked", "running"})


class Payload(BaseModel):
    """Something that is sent or taken as one JSON object."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


def first_wrong(error: ValidationError) -> str:
    """Return the first thing that is wrong with a payload, and where, for whoever sent it."""
    first = error.errors(include_url=False, include_input=False)[0]
    where = ".".join(map(str, first["loc"]))
    return f"{where}: {first['msg']}" if where else str(first["msg"])


class Question(Payload):
    """A question of the cell that a person answers, at the cell: no plant system can."""

    number: int
    code: str
    text: str


class CellState(Payload):
    """The state of a cell now.

    Attributes
    ----------
    online : the bridge is connected; false is what others say of it once it is gone
    state : the cell's own word (docs/state-machine.md); `free` without a run, `left` if a run ended
        with a part in a gripper or with a stop that nobody has acknowledged, `starting` while a run
        begins, `taken` while another command has the cell, `unknown` if it does not answer
    packml : the state's name in PackML
    is_ready : an order would be started now
    may_start : whether orders of a plant may start runs, by the cell file
    message : why it stands, as a sentence; empty if it does not
    run, recipe, order, part, serial : what it works on; null or 0 without
    done : finished and ordered parts of each recipe of the run
    counts : parts of the run by where they went
    """

    schema_: Literal["cellctl.state/1"] = Field("cellctl.state/1", alias="schema")
    cell: str
    at: Time
    online: bool = True
    state: str
    packml: Packml
    is_ready: bool = False
    may_start: Literal["never", "asked", "yes"] = "never"
    is_emulated: bool | None = None
    message: str = ""
    run: str | None = None
    recipe: str | None = None
    order: str | None = None
    part: int = 0
    serial: str | None = None
    question: Question | None = None
    alarms: tuple[str, ...] = ()
    done: Mapping[str, tuple[int, int]] = Field(default_factory=dict)
    counts: Mapping[Disposition, int] = Field(default_factory=dict)


class Characteristic(Payload):
    """What was measured of one characteristic; `U` is the expanded uncertainty, k = 2."""

    id: str
    balloon: int | None = None
    label: str
    kind: str
    unit: str
    nominal: float | None
    lower: float | None
    upper: float | None
    measured: float | None
    U: float | None
    verdict: str


class Finding(Payload):
    """A place where the part differs from its CAD model."""

    number: int
    kind: str
    faces: tuple[str, ...]
    view: str
    size_mm: float
    area_mm2: float | None
    p_part_mm: tuple[float, ...]
    verdict: str | None


class Picture(Payload):
    """A picture of the part: its file in the run's folder, and its content."""

    name: str
    sha256: str | None


class Review(Payload):
    """A person's verdict on the part, which counts before the machine's."""

    at: Time
    verdict: Literal["accept", "reject"]
    who: str
    why: str


class PartResult(Payload):
    """The result of one part, or a later revision of it.

    Attributes
    ----------
    part : number in its run, from 1
    revision : 1 when the part was finished; one more with each verdict of a person and with each
        later run that tells where the part is
    seq : number of the journal's row that made it; rises within a cell
    verdict : the machine's: pass, fail, indeterminate, not evaluated, no verdict
    tray : where it was placed; null if it was not
    disposition : what holds now: the person's verdict, else the tray; null if neither is known
    custody : who has it (docs/glossary.md)
    compared_fraction : share of its surface that was compared
    """

    schema_: Literal["cellctl.part/1"] = Field("cellctl.part/1", alias="schema")
    cell: str
    run: str
    part: int
    revision: int
    seq: int
    order: str | None
    recipe: str
    recipe_sha256: str | None
    serial: str | None
    lot: str | None
    operator: str | None
    begun: Time
    ended: Time
    verdict: str
    reasons: tuple[str, ...]
    tray: Disposition | None
    disposition: Disposition | None
    review: Review | None
    custody: str
    is_emulated: bool
    is_dry: bool
    compared_fraction: float | None
    characteristics: tuple[Characteristic, ...]
    findings: tuple[Finding, ...]
    pictures: tuple[Picture, ...]

    @property
    def key(self) -> str:
        """What it is known by: receivers drop doubles by it."""
        return f"{self.cell}/{self.run}/{self.part}/{self.revision}"


class AlarmNotice(Payload):
    """An alarm was raised, or a person has acknowledged it.

    Attributes
    ----------
    number, code : of docs/alarms.md; the number is null where an acknowledgement has no number
    action : what a person is to do
    """

    schema_: Literal["cellctl.alarm/1"] = Field("cellctl.alarm/1", alias="schema")
    cell: str
    run: str
    part: int | None
    seq: int
    at: Time
    change: Literal["raised", "acknowledged"]
    number: int | None
    code: str
    device: str | None
    message: str
    action: str
    who: str | None = None

    @property
    def key(self) -> str:
        """What it is known by: receivers drop doubles by it."""
        return f"{self.cell}/{self.run}/alarm/{self.seq}"


class OrderedRecipe(Payload):
    """A recipe of an order, with its number of parts; null for the recipe's own."""

    recipe: Annotated[str, Field(min_length=1, max_length=300), AfterValidator(_printable)]
    quantity: int | None = Field(default=None, ge=1, le=MAX_PARTS)


class OrderRequest(Payload):
    """An order, as a plant system gives it.

    Attributes
    ----------
    recipe, quantity : one recipe with its number of parts
    recipes : or several
    serials : serial numbers of the parts, in order; gives the quantity of one recipe
    due : when it is wanted; kept and told, not acted on
    """

    # what the validators below ask for, as far as a schema can say it
    model_config = ConfigDict(
        json_schema_extra={
            "oneOf": [
                {
                    "required": ["recipe"],
                    "properties": {"recipe": {"type": "string"}, "recipes": {"maxItems": 0}},
                },
                {
                    "required": ["recipes"],
                    "properties": {
                        "recipes": {"minItems": 1},
                        "recipe": {"type": "null"},
                        "quantity": {"type": "null"},
                    },
                },
            ]
        }
    )
    recipe: str | None = Field(default=None, min_length=1, max_length=300)
    quantity: int | None = Field(default=None, ge=1, le=MAX_PARTS)
    recipes: tuple[OrderedRecipe, ...] = Field(default=(), max_length=MAX_RECIPES)
    serials: tuple[Annotated[Label, Field(min_length=1)], ...] = Field(
        default=(), max_length=MAX_SERIALS, json_schema_extra={"uniqueItems": True}
    )
    lot: Label = ""
    due: Time | None = None

    @model_validator(mode="after")
    def _is_one_order(self) -> "OrderRequest":
        if (self.recipe is None) == (not self.recipes):
            raise ValueError("recipe, or recipes: one of these")
        if self.recipes and self.quantity is not None:
            raise ValueError("quantity belongs to recipe; each of `recipes` has its own")
        if self.recipe is not None:
            _printable(self.recipe)
        if len(set(self.serials)) < len(self.serials):
            raise ValueError("two parts have the same serial number")
        if self.serials and self.count not in (None, len(self.serials)):
            raise ValueError(f"{self.count} parts, but {len(self.serials)} serial numbers")
        return self

    @property
    def wanted(self) -> tuple[OrderedRecipe, ...]:
        """Its recipes, at least one, each with its number of parts."""
        if self.recipe is None:
            return self.recipes
        count = self.quantity or (len(self.serials) or None)
        return (OrderedRecipe(recipe=self.recipe, quantity=count),)

    @property
    def count(self) -> int | None:
        """All parts; None where a recipe says how many."""
        counts = [one.quantity for one in self.recipes] or [self.quantity]
        return None if None in counts else sum(count for count in counts if count)


class OrderMessage(OrderRequest):
    """An order where its number has no other place: the request, and the plant's own number."""

    number: Annotated[Label, Field(min_length=1), AfterValidator(_not_blank)]

    def request(self) -> OrderRequest:
        """Return the order without its number."""
        return OrderRequest(**{name: getattr(self, name) for name in OrderRequest.model_fields})


class OrderRefusal(Payload):
    """The answer to a message that is no order; `number` is null where it could not be read."""

    cell: str
    number: str | None
    state: Literal["refused"] = "refused"
    reason: str


class OrderState(Payload):
    """What became of an order.

    Attributes
    ----------
    number : the plant's own
    state : `asked` waits for a person at the cell to release it
    reason : why it is refused, or what it waits for, as a sentence
    source : the account and the wire that it came by
    taken, changed, started : when it came, when its state changed, when its run was started
    run : the run that works on it
    quantity : parts ordered; null until the run says
    done, accepted, rejected, quarantined : parts finished so far
    """

    schema_: Literal["cellctl.order/1"] = Field("cellctl.order/1", alias="schema")
    cell: str
    number: str
    state: OrderWord
    reason: str = ""
    request: OrderRequest
    source: str
    taken: Time
    changed: Time
    started: Time | None = None
    run: str | None = None
    quantity: int | None = None
    done: int = 0
    accepted: int = 0
    rejected: int = 0
    quarantined: int = 0

    @property
    def is_open(self) -> bool:
        """Whether something may still become of it."""
        return self.state in OPEN


Notice = PartResult | AlarmNotice
"""What the outbox delivers, in the order of the journal."""
