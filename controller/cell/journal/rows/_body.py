"""The common base of the row models, and the words in them."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, RootModel

from messages import key
from messages.fields import Sentence

from .._form import RowKind

Json = Mapping[str, Any]
Text = Annotated[str, Field(coerce_numbers_to_str=True)]
Box = tuple[int, int, int, int]
Matrix = tuple[tuple[float, ...], ...]
Joints = tuple[float, ...]


class EffectClass(StrEnum):
    """Whether an intended action may be repeated (cell-facts.md 2)."""

    QUERY = "query"
    """Freely: it only reads."""
    ABSOLUTE = "absolute"
    """After the axes are referenced: it leads to the same place."""
    ONCE = "once"
    """Never without looking."""


class Once(StrEnum):
    """Actions never repeated without looking; the intent is on the disk before the action."""

    GRASP = key("grip")
    HAND_OFF = "hand_off"
    RELEASE_ARM = key("release")
    RECEIVE = "take_back"
    RELEASE_FIXED = "fixture_release"
    SET_DOWN = "set_down"
    SORT = key("sort")
    OPEN_ARM_GRIPPER = "open_arm_gripper"
    OPEN_FIXED_GRIPPER = "open_fixed_gripper"


class Fields(BaseModel):
    """A group of fields inside a body."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)


class Body(BaseModel):
    """The content of a row."""

    model_config = ConfigDict(frozen=True, populate_by_name=True)
    kind: ClassVar[RowKind]
    row_name: ClassVar[str]

    def as_json(self) -> dict[str, Any]:
        """Return the body as the journal keeps it."""
        return self.model_dump(by_alias=True, exclude_unset=True)


class NamedBody(Body):
    """The body of a row of a group; the name is in the row, not in the body."""

    name: str = Field(exclude=True)


class TextByName(Body, RootModel[dict[str, Sentence]]):
    """Texts by the name of their subject: lamp, device, gripper."""
