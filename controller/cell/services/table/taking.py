"""Takes the next part from a look at the table, for all recipes of the batch."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from controller.cell.compute import Pickable
from controller.cell.custody import Custody
from controller.cell.errors import PartProblemError
from controller.cell.journal.rows import PartLeft, SightingFields
from controller.cell.services.records import BatchProduct, BatchRecord, PartRecord, sightings_row
from controller.recognition import Sighting

from .ahead import Foreseen, LookAhead
from .choosing import LeftAlone, WantedParts, candidates, chosen
from .labels import Label, Labels


@dataclass(slots=True, eq=False)
class Taking:
    """The choice of the next part and its recipe, and of the parts left alone.

    Attributes
    ----------
    record : record of the batch; gets what is taken
    labels : source of its serial number and lot
    left : parts of the batch that cannot be taken as they lie
    ahead : planner of the next part beside the current one
    """

    record: BatchRecord
    labels: Labels = field(default_factory=Labels)
    left: list[LeftAlone] = field(default_factory=list)
    ahead: LookAhead = field(init=False)

    def __post_init__(self) -> None:
        self.ahead = LookAhead(self.record)

    async def take(self, sightings: tuple[Sighting, ...]) -> bool:
        """Go on with the best of some objects; return False if the current part is not there.

        The objects seen are journaled together with the choice.

        Parameters
        ----------
        sightings : all sightings of a look at the table

        Raises
        ------
        PartProblemError : a person has to decide, or nothing can be taken
        """
        part, row = self.record.part, sightings_row(sightings)
        part.plan_ahead = None
        foreseen = None
        if part.sighting is None and part.custody is Custody.ON_TABLE and not part.interrupted:
            foreseen = await self.ahead.take(row.sightings)
        try:
            number = await self._choose(row.sightings, foreseen)
        except PartProblemError:
            self.record.note(row)
            raise
        if number is None:
            self.record.note(row)
            return False
        laid, part.laid = part.laid, None
        if laid is not None:
            one = sightings[number].laid(laid)
            sightings = (*sightings[:number], one, *sightings[number + 1 :])
            row = sightings_row(sightings)
        if foreseen is not None and number == foreseen.place_in(row.sightings):
            part.plan_ahead = foreseen.plan
            one = foreseen.as_planned(sightings[number], row.sightings[number])
            sightings = (*sightings[:number], one, *sightings[number + 1 :])
            row = sightings_row(sightings)
        row = row.model_copy(update={"taken": number})
        self.record.note(row)
        part.seen = sightings
        part.sighting = sightings[number]
        _, part.neighbours = row.parted()
        part.alternatives = part.sighting.ambiguous_with
        part.free_turn = part.sighting.free_turn
        product = self._product_of(part.sighting.part)
        if part.product is not product:
            label = self.labels.assign(part, product)
            self.record.identify_part(product, label.serial, label.lot)
        return True

    async def leave(self, reason: str) -> bool:
        """Leave the current part on the table and go on with another; return False if none is.

        Only for a part that nothing has touched yet, and that has no serial number read off it.

        Parameters
        ----------
        reason : reason why it cannot be taken
        """
        part = self.record.part
        if not self._is_untouched or part.scanned or len(part.seen) < 2:
            return False
        assert part.sighting is not None, "a part that was seen"
        one = next(
            row
            for row, seen in zip(sightings_row(part.seen).sightings, part.seen, strict=True)
            if seen is part.sighting
        )
        before = part.sighting, part.neighbours, part.alternatives, part.free_turn
        self.left.append(LeftAlone(one, part.neighbours, reason))
        part.sighting, part.neighbours = None, ()
        try:
            found = await self._choose(sightings_row(part.seen).sightings)
        except PartProblemError:
            found = None
        part.sighting, part.neighbours, part.alternatives, part.free_turn = before
        if found is None:
            return False
        self.record.note(
            PartLeft(
                part=str(one.part),
                pose_index=one.pose_index,
                x_mm=one.x_mm,
                y_mm=one.y_mm,
                reason=reason,
            )
        )
        self._let_go()
        return await self.take(part.seen)

    def forget(self) -> None:
        """Try every part again: a person has been at the table."""
        self.left.clear()
        self.ahead.drop()

    def begin_anew(self) -> None:
        """Let the next look begin with any part, unless the current part has begun.

        A part without a plan may have been moved, or taken away for others. A part that was held,
        or shown, is sought again instead: its record belongs to no other part.
        """
        if self._is_untouched and self.record.part.plan_count == 0:
            self._let_go()

    @property
    def _is_untouched(self) -> bool:
        """Whether nothing has touched the current part in any run."""
        part = self.record.part
        is_fresh = part.custody is Custody.ON_TABLE and part.hold_count == 0
        return is_fresh and not (part.recoveries or part.interrupted)

    def _let_go(self) -> None:
        """Forget which visible object is the current part."""
        part = self.record.part
        part.sighting, part.neighbours, part.product, part.code = None, (), None, None
        part.coded.clear()
        self.labels.give_back(part)

    def look_ahead(self) -> None:
        """Begin to choose and plan the next part, now that a gripper has the current one."""
        self.ahead.begin(self._next_of)

    async def _next_of(self, seen: tuple[SightingFields, ...]) -> tuple[int, BatchProduct] | None:
        """Return the next object left on the table, with its product; None if unknown."""
        record = self.record
        if self.labels.order.is_read:
            return None  # the next part comes alone, and its number is read
        next_part = PartRecord(number=record.part.number + 1)
        try:
            found = candidates(seen, self._wanted_of(record.wanted_next, next_part), self.left)
            number = await self._best(seen, found, is_ahead=True)
        except PartProblemError:
            return None
        return None if number is None else (number, self._product_of(seen[number].part))

    async def _choose(
        self, seen: tuple[SightingFields, ...], foreseen: Foreseen | None = None
    ) -> int | None:
        """Return the number of the object that the cell continues with; None if it is not there.

        Where one was foreseen, and may be taken, it is that one: it has a plan.
        """
        found = candidates(seen, self._wanted(), self.left)
        if foreseen is not None and (number := foreseen.place_in(seen)) in found:
            return number
        return await self._best(seen, found)

    async def _best(
        self, seen: tuple[SightingFields, ...], found: Sequence[int], *, is_ahead: bool = False
    ) -> int | None:
        """Return the number of the best of the objects that may be taken; None without any."""
        if not found:
            return None
        if len(seen) == 1:
            return found[0]
        return chosen(seen, found, await self._pickable(seen, is_ahead=is_ahead))

    def _product_of(self, name: str | None) -> BatchProduct:
        """Return the product of the batch that a part taken is of, by the part's name."""
        return next(one for one in self.record.products if one.part_name == name)

    def _wanted_of(self, products: Sequence[BatchProduct], part: PartRecord) -> WantedParts:
        """Return the search for some products' parts: the current part, or one to come."""
        known = {one.part_name: self.labels.in_advance(part, one) for one in products}
        return WantedParts(
            names=tuple(one.part_name for one in products),
            serials={name: label.words for name, label in known.items() if label is not None},
            batch=tuple(one.part_name for one in self.record.products),
        )

    def _wanted(self) -> WantedParts:
        part, record = self.record.part, self.record
        is_sought_again = part.sighting is not None
        products = record.wanted
        if is_sought_again or part.interrupted:
            products = (record.product,)
        elif (number := self.labels.recipe_of(part.scanned)) is not None:
            products = tuple(one for one in products if one.number == number)
        return replace(
            self._wanted_of(products, part),
            is_sought_again=is_sought_again,
            neighbours=part.neighbours,
            scanned=Label(part.scanned).words if part.scanned else "",
        )

    async def _pickable(
        self, seen: tuple[SightingFields, ...], *, is_ahead: bool = False
    ) -> tuple[Pickable, ...]:
        """Return the ways to take each object, by the recipe of its part."""
        best = [Pickable()] * len(seen)
        names = {one.part for one in seen}
        for product in (one for one in self.record.products if one.part_name in names):
            compute = product.ahead if is_ahead and product.ahead is not None else product.compute
            found = await compute.pickable(seen)
            best = [max(pair, key=lambda p: p.path_count) for pair in zip(best, found, strict=True)]
        return tuple(best)
