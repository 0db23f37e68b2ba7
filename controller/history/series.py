"""Measured values of a characteristic over the parts of a recipe, for run charts."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from sqlalchemy import select

from .queries import NAME, Filters, part_json
from .sentences import with_sentences
from .store import Store
from .tables import CHARACTERISTICS, MEASUREMENTS, PARTS, RUNS


def recipes_in(store: Store) -> tuple[str, ...]:
    """Return the names of all recipes that parts are of, in their order.

    Raises
    ------
    HistoryError : the store cannot be read
    """
    with store.reading() as db:
        query = select(PARTS.c.recipe).distinct().order_by(PARTS.c.recipe)
        return tuple(str(name) for name in db.execute(query).scalars())


def cells_in(store: Store) -> tuple[str, ...]:
    """Return the names of all cells that runs are of, in their order.

    Raises
    ------
    HistoryError : the store cannot be read
    """
    with store.reading() as db:
        query = select(RUNS.c.cell).distinct().order_by(RUNS.c.cell)
        return tuple(str(name) for name in db.execute(query).scalars())


def characteristics_in(store: Store, recipe: str) -> tuple[Mapping[str, Any], ...]:
    """Return id, label, kind and unit of a recipe's characteristics, as they are numbered.

    Raises
    ------
    HistoryError : the store cannot be read
    """
    c = CHARACTERISTICS.c
    query = select(c.id, c.label, c.kind, c.unit, c.balloon).where(c.recipe == recipe)
    with store.reading() as db:
        found = db.execute(query.order_by(c.characteristic_no)).mappings()
        latest = {str(row["id"]): dict(row) for row in found}
        every = sorted(latest.values(), key=lambda row: (row["balloon"], row["id"]))
        return tuple(with_sentences(db, every))


def values_of(
    store: Store, filters: Filters, recipe: str, characteristic: str, limit: int
) -> tuple[Mapping[str, Any], ...]:
    """Return the newest measured values of a characteristic, oldest first.

    Parameters
    ----------
    store : store to read
    filters : parts to select
    recipe : recipe of the parts
    characteristic : its id
    limit : parts at most, measured or not

    Raises
    ------
    HistoryError : the store cannot be read
    """
    p, m, c = PARTS.c, MEASUREMENTS.c, CHARACTERISTICS.c
    newest = (
        select(p.part_id)
        .where(replace(filters, recipe=recipe).clause())
        .order_by(p.start.desc(), p.part_id.desc())
        .limit(limit)
    ).subquery()
    query = (
        select(
            *NAME, p.number, p.serial, p.start, p.review,
            m.measured, m.U, m.verdict, c.lower, c.upper, c.nominal, c.unit, c.label,
        )
        .select_from(PARTS.join(RUNS).join(newest, newest.c.part_id == p.part_id))
        .join(MEASUREMENTS, m.part_id == p.part_id)
        .join(CHARACTERISTICS, c.characteristic_no == m.characteristic_no)
        .where(c.id == characteristic)
        .order_by(p.start, p.part_id)
    )  # fmt: skip
    with store.reading() as db:
        return tuple(part_json(row) for row in db.execute(query).mappings())
