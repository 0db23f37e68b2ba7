"""The surroundings of a part in work; the nests that are taken, by the journal."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ..journal import Body, read_row, read_rows_named, rows
from .fold import CellIdentity


@dataclass(frozen=True, slots=True)
class Around:
    """The objects that a path must keep clear of, besides the cell itself.

    Attributes
    ----------
    neighbours : objects on the table; each is there as everything that it may be
    stored : parts in the nests of the trays
    """

    neighbours: tuple[rows.SightingFields, ...] = ()
    stored: tuple[rows.StoredFields, ...] = ()


ALONE: Final = Around()


@dataclass(slots=True)
class TrayRecord:
    """The parts in the trays since these were emptied last.

    Attributes
    ----------
    nest_counts : nests of each tray whose parts are counted, by name
    stored : parts in the order of their placing
    """

    nest_counts: Mapping[str, int] = field(default_factory=dict)
    stored: tuple[rows.StoredFields, ...] = ()

    def full(self) -> tuple[str, ...]:
        """Return the trays without a free nest."""
        return tuple(name for name in self.nest_counts if self.next_nest(name) is None)

    def next_nest(self, tray: str) -> int | None:
        """Return the number of a tray's first free nest; None if all are taken or none is counted.

        Parameters
        ----------
        tray : its name
        """
        return next_nest(self.stored, tray, self.nest_counts.get(tray, 0))

    def take(self, row: Body) -> None:
        """Take a row about the trays; any other one changes nothing."""
        match row:
            case rows.TraysStood():
                self.stored = row.stored
            case rows.PartStored():
                self.stored = (*self.stored, row.part)
            case rows.TrayEmptied():
                self.stored = tuple(one for one in self.stored if one.tray != row.tray)


def next_nest(stored: Iterable[rows.StoredFields], tray: str, count: int) -> int | None:
    """Return the number of a tray's first free nest, None if there is none.

    Parameters
    ----------
    stored : contents of the trays
    tray : its name
    count : number of its nests
    """
    taken = {one.nest for one in stored if one.tray == tray}
    return next((number for number in range(count) if number not in taken), None)


def left_in_trays(journal: Path, run: str, began: rows.RunBegan) -> tuple[rows.StoredFields, ...]:
    """Return the parts that earlier runs at a cell left in its trays; () in a new emulated cell.

    Parameters
    ----------
    journal : journal of the runs
    run : the present one, whose own rows do not count
    began : its first row, which names the cell

    Raises
    ------
    JournalError : the journal cannot be read
    """
    here, trays, is_here = CellIdentity.of(began).grippers, TrayRecord(), False
    names = [kind.row_name for kind in (rows.RunBegan, rows.TraysStood, rows.PartStored)]
    for row in read_rows_named(journal, [*names, rows.TrayEmptied.row_name]):
        if row.run == run:
            continue
        body = read_row(row.kind, row.name, row.body)
        if isinstance(body, rows.RunBegan):
            is_here = CellIdentity.of(body).grippers == here
        elif is_here and body is not None:
            trays.take(body)
    return trays.stored
