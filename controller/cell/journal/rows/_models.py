"""The model of a row, by its kind and name."""

from collections.abc import Mapping
from typing import Final

from .._form import Row
from . import _decisions, _deeds, _events, _observations
from ._body import Body, EffectClass, Json, NamedBody
from ._decisions import PartFollowed, PartReviewed, PicturesCopied, PicturesDropped
from ._deeds import CustodyChanged, Intent, OnceDone
from ._events import CellEvent
from ._observations import FilesStored

# Every model that has a name of its own; a base or a group has none.
ROWS: Final[Mapping[tuple[str, str], type[Body]]] = {
    (model.kind, model.row_name): model
    for module in (_events, _deeds, _observations, _decisions)
    for model in vars(module).values()
    if isinstance(model, type) and issubclass(model, Body) and "row_name" in vars(model)
}
# By kind: the model of every name that has no model of its own.
GROUPS: Final[Mapping[str, type[NamedBody]]] = {
    "event": CellEvent,
    "intent": Intent,
    "outcome": OnceDone,
    "custody": CustodyChanged,
}
# Rows that people, reports and later runs add to a run that has ended; none of them is about the
# cell during the run.
ADDED: Final[tuple[type[Body], ...]] = (
    FilesStored,
    PicturesCopied,
    PicturesDropped,
    PartReviewed,
    PartFollowed,
)


def read_row(kind: str, name: str, body: Json) -> Body | None:
    """Return the body of a row as its model; None for a row without a known model.

    Parameters
    ----------
    kind, name : kind and name of the row
    body : as the journal keeps it

    Raises
    ------
    ValueError : the body is not as this version writes it
    """
    model = ROWS.get((kind, name))
    if model is not None:
        read: Body = model.model_validate(body)
        return read
    group = GROUPS.get(kind)
    if group is None:
        return None
    named: Body = group.model_validate({**body, "name": name})
    return named


def name_of(body: Body) -> str:
    """Return the name of the row to which a body belongs."""
    return body.name if isinstance(body, NamedBody) else body.row_name


def is_once(row: Row) -> bool:
    """Return whether a row is the intent of an action that is never repeated without looking.

    An intent without a class is of one: it was written before there were classes.
    """
    return row.kind == "intent" and row.body.get("effect_class", EffectClass.ONCE) == "once"


def is_of(row: Row, model: type[Body]) -> bool:
    """Return whether a journal row belongs to a given model that has a name of its own."""
    return (row.kind, row.name) == (model.kind, model.row_name)
