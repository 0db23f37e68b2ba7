"""The serial number and lot of a part: given in advance, counted, listed, or read off it.

A number known in advance belongs to the next part of its recipe, one that a person reads to the
latest part: then no other part of the batch that could have it may be on the table. Where a recipe
has a `serial_code`, and nothing else names the numbers, cameras read it (`services/codes.py`).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Final

from controller.cell.errors import PartProblemError
from controller.cell.operator import NOBODY, Operator, Question
from controller.cell.services.records import BatchProduct, PartRecord
from messages import key, say

MAX_SERIAL: Final = 80  # largest length in characters
SCAN: Final = "scan"  # code of the question for a number


@dataclass(frozen=True, slots=True)
class Label:
    """Serial number and lot of a part; empty if it has none."""

    serial: str = ""
    lot: str = ""

    @property
    def words(self) -> str:
        """The part's name in messages, which distinguishes it from others."""
        return (
            say("the serial number {serial}", serial=self.serial)
            if self.serial
            else say("the lot {lot}", lot=self.lot)
        )


@dataclass(frozen=True, slots=True)
class LabelOrder:
    """The source of a batch's numbers.

    Attributes
    ----------
    in_order : serials of all parts, in working order
    listed : serials of the parts of each recipe by its number, in order
    counted_from : the first of numbers that are counted up; empty if none are
    is_read : each is read off its part before that is begun; must be listed where any are
    """

    in_order: tuple[str, ...] = ()
    listed: tuple[tuple[int, Label], ...] = ()
    counted_from: str = ""
    is_read: bool = False


NO_NUMBERS: Final = LabelOrder()


def counted(first: str, count: int) -> str:
    """Return the number a count after another: its final digits count up, and keep their zeros.

    Raises
    ------
    ValueError : it does not end in a digit
    """
    head, digits = parted(first)
    if not digits:
        raise ValueError(f"{first!r} does not end in a digit")
    return f"{head}{int(digits) + count:0{len(digits)}d}"


def parted(serial: str) -> tuple[str, str]:
    """Return a number's text before its final digits, and these digits, if any."""
    head = serial.rstrip("0123456789")
    return head, serial[len(head) :]


def why_no_serial(text: str) -> str:
    """Return the reason why a text is no serial number; empty if it may be one."""
    if not text or text != text.strip() or not text.isprintable():
        return key("a serial number is printable, and neither begins nor ends with a space")
    if len(text) > MAX_SERIAL:
        return say("a serial number has {max_serial} characters at most", max_serial=MAX_SERIAL)
    return ""


@dataclass(slots=True, eq=False)
class Labels:
    """The numbers of a batch, each given away once.

    Attributes
    ----------
    order : source of the numbers
    operator : reads them off the parts
    used : numbers that parts of this run have
    """

    order: LabelOrder = NO_NUMBERS
    operator: Operator = NOBODY
    used: set[str] = field(default_factory=set)
    _counted: int = 0

    def is_wanted(self, part: PartRecord) -> bool:
        """Return whether the next part's number is still to be read off the part."""
        return self.order.is_read and not (part.serial or part.scanned or part.interrupted)

    async def read(self, part: PartRecord) -> None:
        """Have the number of the next part read off it, unless it has one.

        Raises
        ------
        PartProblemError : nobody is there to read it
        """
        if not self.is_wanted(part):
            return
        question = Question(
            code=SCAN,
            text=key(
                "Lay the next part on the table, alone of its batch, and read its serial number"
            ),
            choices=(),
            entry=key("serial number"),
            check=self.why_not,
        )
        answer = await self.operator.decide(question)
        if answer is None:
            raise PartProblemError(
                "no_serial", key("nobody read the serial number of the next part")
            )
        part.scanned = answer.key

    def is_coded(self, product: BatchProduct) -> bool:
        """Return whether cameras read the numbers of a product's parts off their codes."""
        order = self.order
        is_named = bool(order.in_order or order.counted_from or order.is_read)
        return product.recipe.serial_code is not None and not is_named

    async def ask(self, question: str, product: BatchProduct) -> str | None:
        """Return a product's part's number as a person reads it; None if nobody is there.

        Parameters
        ----------
        question : what could not be read, and of which part
        product : product it belongs to
        """

        def why_not(text: str) -> str:
            return self.why_not(text, product)

        asked = Question(SCAN, question, (), entry=key("serial number"), check=why_not)
        answer = await self.operator.decide(asked)
        return None if answer is None else answer.key

    def why_not(self, text: str, product: BatchProduct | None = None) -> str:
        """Return the reason why a text is not the next part's number; empty if it may be.

        Parameters
        ----------
        text : the text
        product : product that the part belongs to; None if unknown
        """
        if why := why_no_serial(text):
            return why
        if text in self.used:
            return say("{text}: a part of this run has this number already", text=text)
        known = {label.serial: number for number, label in self.order.listed if label.serial}
        if known and text not in known:
            return say("{text}: the list of parts has no such number", text=text)
        if known and product is not None and known[text] != product.number:
            return say("{text}: the list of parts has this number for another recipe", text=text)
        return ""

    def take_read(self, serial: str, product: BatchProduct) -> Label:
        """Return the label of a part whose number was read after it was recognised; it is used up.

        Parameters
        ----------
        serial : number, which `why_not` has no reason against
        product : product it belongs to
        """
        own = [label for number, label in self.order.listed if number == product.number]
        listed = next((one for one in own if one.serial == serial), None)
        self.used.add(serial)
        return replace(listed or next(iter(own), Label()), serial=serial)

    def recipe_of(self, serial: str) -> int | None:
        """Return the number of the recipe that a list has for a serial number; None without."""
        return next((n for n, label in self.order.listed if label.serial == serial), None)

    def in_advance(self, part: PartRecord, product: BatchProduct) -> Label | None:
        """Return the label of a product's next part, if no other part may get it.

        Parameters
        ----------
        part : the part at hand
        product : product that it may belong to
        """
        if self.order.is_read or self.order.counted_from or self.is_coded(product):
            return None
        label = self._in_order(part) if self.order.in_order else self._next_listed(product)
        return label if label.serial else None

    def assign(self, part: PartRecord, product: BatchProduct) -> Label:
        """Return the label that a part has from now on; its number is used up.

        Parameters
        ----------
        part : the part at hand
        product : product it belongs to
        """
        label = self._label(part, product)
        if label.serial:
            self.used.add(label.serial)
        return label

    def give_back(self, part: PartRecord) -> None:
        """Free the number of a part that was left on the table; one that was counted it keeps."""
        if not self.order.counted_from:
            self.used.discard(part.serial)

    def take_over(self, serial: str, others: Iterable[str]) -> tuple[int, ...]:
        """Return the number of the recipe of each listed part that an interrupted run has done.

        The numbers of all parts of that run are used.

        Parameters
        ----------
        serial : serial of the part that goes on in this run; empty if it has none
        others : serials of the other parts of that run
        """
        done = set(others) - {serial}
        self.used |= (done | {serial}) - {""}
        return tuple(number for number, label in self.order.listed if label.serial in done)

    def _label(self, part: PartRecord, product: BatchProduct) -> Label:
        if part.scanned:
            listed = (one for _, one in self.order.listed if one.serial == part.scanned)
            return replace(next(listed, Label()), serial=part.scanned)
        if self.order.in_order:
            return self._in_order(part)
        if self.is_coded(product):
            return Label()
        if self.order.counted_from:
            if part.serial:  # it was taken for another part before
                return Label(part.serial, part.lot)
            return Label(self._next_counted())
        return self._next_listed(product)

    def _in_order(self, part: PartRecord) -> Label:
        serials = self.order.in_order
        return Label(serials[part.number - 1] if part.number <= len(serials) else "")

    def _next_counted(self) -> str:
        while True:
            serial = counted(self.order.counted_from, self._counted)
            self._counted += 1
            if serial not in self.used:
                return serial

    def _next_listed(self, product: BatchProduct) -> Label:
        """Return the next label of a product; its labels without a number are all alike."""
        own = (label for number, label in self.order.listed if number == product.number)
        return next((one for one in own if one.serial not in self.used), Label())
