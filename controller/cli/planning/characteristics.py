"""Characteristics of a part as a table and as JSON."""

from collections.abc import Sequence
from math import isfinite
from typing import Any, Final

from rich.box import SIMPLE
from rich.table import Table

from controller.cell.compute.checks import CheckedCharacteristic
from controller.inspection.characteristics import Capability, Characteristic, place_of

from ..terminal.output import print_line, stdout

UM_PER_MM: Final = 1000.0


def characteristic_json(
    characteristic: Characteristic, capability: Capability | None = None
) -> dict[str, Any]:
    """Return a characteristic as docs/characteristics.md describes it.

    Parameters
    ----------
    characteristic : characteristic of a part
    capability : capability of the cell that is to verify it; None if none is named
    """
    p_part_mm, axis = place_of(characteristic.geometry)
    entry: dict[str, Any] = {
        "balloon": characteristic.balloon,
        "id": characteristic.id,
        "kind": characteristic.kind.value,
        "nominal_mm": characteristic.nominal_mm,
        "lower": characteristic.lower_mm,
        "upper": characteristic.upper_mm,
        "source": characteristic.source,
        "critical": characteristic.is_critical,
        "p_part_mm": p_part_mm.tolist(),
        "axis": axis.tolist(),
        "faces": list(characteristic.faces),
        "measured": characteristic.is_measured,
        "exempt": characteristic.exempt,
    }
    if capability is not None:
        entry |= {
            "U_mm": capability.U_mm,
            "share_of_tolerance": capability.share if isfinite(capability.share) else None,
            "min_tolerance_mm": capability.min_tolerance_mm,
            "capable": capability.is_capable,
        }
    return entry


def print_characteristics(characteristics: Sequence[Characteristic]) -> None:
    """Print the characteristics of a part."""
    table = _table()
    for one in characteristics:
        table.add_row(*_row(one), one.exempt)
    stdout.print(table)


def print_checked(checked: Sequence[CheckedCharacteristic]) -> None:
    """Print the characteristics, and the cell's capability for each."""
    table = _table("U\num", "2U/T\n%")
    for each in checked:
        able, one = each.capability, each.characteristic
        share = f"{100 * able.share:.1f}" if one.is_measured else ""
        promised = f"{able.U_mm * UM_PER_MM:.0f}" if one.is_measured else ""
        remark = one.exempt if not one.is_measured else "" if able.is_capable else "not verified"
        table.add_row(*_row(one), promised, share, remark)
    stdout.print(table)
    needed = sum(not each.characteristic.exempt for each in checked)
    unseen = sum(not each.characteristic.is_measured for each in checked)
    weak = len(checked) - needed - unseen
    print_line(
        f"{len(checked)} characteristics: {needed} to be proven for a pass, {weak} measured and "
        f"not verified by this cell, {unseen} not measured"
    )


def _table(*further: str) -> Table:
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    table.add_column("no.", justify="right")
    table.add_column("characteristic", min_width=20)
    for heading in ("nominal\nmm", "limits\nmm"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("by")
    for heading in further:
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("remark")
    return table


def _row(one: Characteristic) -> tuple[str, ...]:
    limits = f"<= {one.upper_mm:g}" if one.is_one_sided else f"{one.lower_mm:g} to {one.upper_mm:g}"
    nominal = "" if one.is_one_sided else f"{one.nominal_mm:g}"
    return str(one.balloon), one.id, nominal, limits, one.source.replace("ISO 2768-", "2768-")
