"""Reads the serial number off the code of a part, in pictures that the cell takes anyway (ADR 129).

A code on the upper side is read where the part lies, one on another side in the views of the held
part. What is not certain is never a number: a person is asked, and without one the part is not
accepted.
"""

import asyncio
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from controller.arrays import FloatArray, Grey
from controller.cell.compute import Compute, SeenCode, begin
from controller.cell.errors import PartProblemError
from controller.cell.journal.rows import CodeFields
from messages import key, say

from .records import BatchProduct, BatchRecord, PartRecord, Shown, matrix
from .table import Labels
from .views import Background

MAX_NAMED = 3  # codes that a message names


@dataclass(slots=True, eq=False)
class Codes:
    """The codes of the parts.

    Attributes
    ----------
    record : record of the batch; gets what is read
    compute : finds and reads codes
    background : queue for questions that do not hold up the arm
    labels : the numbers of the batch
    """

    record: BatchRecord
    compute: Compute
    background: Background
    labels: Labels

    async def read_on_table(self, lit: Mapping[str, Grey]) -> None:
        """Read the code of the part just taken, in the pictures of the table.

        A person is asked where the pictures contradict themselves or the run, and where a code
        beside the part is not there: no later picture shows it.

        Parameters
        ----------
        lit : by lamp

        Raises
        ------
        PartProblemError : a person is needed, and nobody is there
        """
        part, product = self.record.part, self.record.product
        asked, sighting = product.recipe.serial_code, part.sighting
        if asked is None or part.code is not None:
            return
        assert sighting is not None, "a part was taken"
        assert sighting.T_world_part is not None, "a part that is taken has a pose"
        if asked.at == "beside" and self._are_others_there():
            raise PartProblemError(
                "many_parts",
                key(
                    "the code with the serial number lies beside the part, and several parts "
                    "of the batch are on the table: leave one there, with its code"
                ),
            )
        self.record.show(key("reading the code of the part"))
        seen = await self.compute.read_codes(
            tuple(lit.values()), sighting.T_world_part, is_held=False
        )
        self._take(seen, [part.picture_names[lamp] for lamp in lit])
        if part.serial or not self.labels.is_coded(product):
            return
        if part.code_problem or asked.at == "beside":
            await self._ask(product)
            if not part.serial:
                raise PartProblemError(
                    "no_serial", say("{what}, and nobody read it", what=self._what)
                )

    def read_in_view(self, shown: Shown, lit: Mapping[str, Grey]) -> None:
        """Begin to read the codes in the pictures of a view: another one may contradict the first.

        Parameters
        ----------
        shown : the view
        lit : by lamp
        """
        asked, part = self.record.product.recipe.serial_code, self.record.part
        if asked is not None and asked.at == "part":
            part.reading.append(begin(self._read_view(part, shown, lit)))

    async def _read_view(self, part: PartRecord, shown: Shown, lit: Mapping[str, Grey]) -> None:
        T: FloatArray = shown.expected
        if shown.located is not None:
            found = await asyncio.shield(shown.located)
            T = found.T_world_part
        pictures = tuple(lit.values())
        seen = await self.background.put(self.compute.read_codes, pictures, T, is_held=True)
        if part is self.record.part:
            self._take(seen, [part.files[shown.view][lamp] for lamp in lit])

    async def collect(self) -> None:
        """Wait for the pictures that are still being read."""
        for task in tuple(self.record.part.reading):
            await asyncio.shield(task)

    async def settle(self) -> str:
        """Return the reason why the part at hand is not identified; empty if it is.

        Where no code gave the number, a person is asked first.
        """
        part, product = self.record.part, self.record.product
        asked = product.recipe.serial_code
        if asked is None:
            return ""
        await self.collect()
        if self.labels.is_coded(product) and not part.serial:
            await self._ask(product)
            return "" if part.serial else say("not identified: {what}", what=self._what)
        if part.code is not None and part.code_problem:
            return say("not identified: {what}", what=self._what)
        return _why_other(part)

    @property
    def _what(self) -> str:
        """What could not be read, as a clause."""
        part = self.record.part
        if part.code_problem:
            return say(
                "part {number}: {code_problem}", number=part.number, code_problem=part.code_problem
            )
        others = "; ".join(part.other_codes[:MAX_NAMED])
        return say(
            "part {number}: no code with its serial number was read in {codes_sought} pictures",
            number=part.number,
            codes_sought=part.codes_sought,
        ) + (say(" ({others})", others=others) if others else "")

    async def _ask(self, product: BatchProduct) -> None:
        serial = await self.labels.ask(
            say("{what}. Which is its serial number?", what=self._what), product
        )
        if serial is not None:
            label = self.labels.take_read(serial, product)
            self.record.identify_part(product, label.serial, label.lot)

    def _take(self, seen: Sequence[SeenCode], files: Sequence[str]) -> None:
        """Take what the pictures of one look show: one number, or what is wrong with it."""
        part, product = self.record.part, self.record.product
        asked = product.recipe.serial_code
        assert asked is not None, "the recipe of a part with a code"
        part.codes_sought += len(files)
        numbers: dict[str, SeenCode] = {}
        for code in seen:
            if code.corners_mm is not None:
                part.coded.setdefault(code.text, code.corners_mm)
            number = asked.number_in(code.text, code.fields)
            if number is None:
                why = f"{code.text:.40}: it has no field {asked.field}"
            elif not (why := asked.why_not(number)):
                numbers.setdefault(number, code)
            if why and why not in part.other_codes:
                part.other_codes.append(why)
        known = set() if part.code is None else {part.code.number}
        if len(different := known | numbers.keys()) > 1:
            named = ", ".join(f"{one:.40}" for one in sorted(different)[:MAX_NAMED])
            part.code_problem = say(
                "{different_count} codes contradict each other ({named})",
                different_count=len(different),
                named=named,
            )
        elif numbers and not known and not part.code_problem:
            ((number, code),) = numbers.items()
            self._take_number(number, code, files[code.picture])

    def _take_number(self, number: str, code: SeenCode, picture: str) -> None:
        part, product = self.record.part, self.record.product
        label = part.serial, part.lot
        if self.labels.is_coded(product) and not part.serial:
            if why := self.labels.why_not(number, product):
                part.code_problem = say("its code cannot be right ({why})", why=why)
                return
            new = self.labels.take_read(number, product)
            label = new.serial, new.lot
        elif self.labels.is_coded(product) and number != part.serial:
            return  # a person has named the part, and knows its code
        corners = () if code.corners_mm is None else matrix(code.corners_mm)
        self.record.note_code(
            product,
            CodeFields(text=code.text, number=number, picture=picture, corners_mm=corners),
            label,
        )

    def _are_others_there(self) -> bool:
        batch = {one.part_name for one in self.record.products}
        return any(one.part in batch for one in self.record.part.neighbours)


def _why_other(part: PartRecord) -> str:
    """Return why the number on the papers is not that of the part's code; empty if it may be."""
    if part.code is None or part.serial in ("", part.code.number):
        return ""
    return say(
        "its code reads {number:.40}, its papers say {serial}: another part?",
        number=part.code.number,
        serial=part.serial,
    )
