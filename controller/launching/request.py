"""What a run that is started for somebody is asked for: the options of `cellctl run`. No I/O."""

from pathlib import Path
from typing import Annotated, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

PAPER_MAX: Final = 80
COUNT_MAX: Final = 100_000
SERIAL_MAX_COUNT: Final = 2_000
RECIPE_MAX_COUNT: Final = 20


def _plain(text: str) -> str:
    if not text.isprintable():
        raise ValueError("has signs that cannot be printed")
    return text


Paper = Annotated[str, Field(max_length=PAPER_MAX), AfterValidator(_plain)]


class CountedRecipe(BaseModel):
    """A recipe of a run, by its key in `Choices`, with its number of parts: None for its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    recipe: str = Field(min_length=1, max_length=300)
    count: int | None = Field(default=None, ge=1, le=COUNT_MAX)

    @property
    def word(self) -> str:
        """The arguments of the command line."""
        return self.recipe if self.count is None else f"{self.recipe}={self.count}"


class RunRequest(BaseModel):
    """A run that somebody asks for; the options are those of `cellctl run`.

    Attributes
    ----------
    parts_list : key of a list that was sent, in place of recipes and serial numbers
    is_dry : all motions of one recipe without a part, lifted and slow
    cell : key of `Choices`; empty for that of the recipe
    serials, serial_from : serial numbers one by one, or the first of those that are counted
    goes_on : counting goes on after the last number of the earlier runs
    is_read : serial numbers are read off the parts
    speed, seed : speed and seed of the emulated cell
    """

    model_config = ConfigDict(frozen=True, extra="forbid")
    recipes: tuple[CountedRecipe, ...] = Field(default=(), max_length=RECIPE_MAX_COUNT)
    parts_list: str = Field(default="", pattern="^([0-9a-f]{16})?$")
    is_dry: bool = False
    cell: str = Field(default="", max_length=300)
    lot: Paper = ""
    order_number: Paper = ""
    serials: tuple[Annotated[Paper, Field(min_length=1)], ...] = Field(
        default=(), max_length=SERIAL_MAX_COUNT
    )
    serial_from: Paper = ""
    goes_on: bool = False
    is_read: bool = False
    part_temperature_c: float | None = Field(default=None, ge=-50, le=150)
    speed: float = Field(default=1.0, ge=0.1, le=100)
    seed: int | None = Field(default=None, ge=0, lt=2**32)
    are_trays_empty: bool = False
    is_part_removed: bool = False

    @model_validator(mode="after")
    def _one_source_of_serials(self) -> "RunRequest":
        if bool(self.recipes) == bool(self.parts_list):
            raise ValueError("recipes, or a list of parts: one of these")
        sources = (self.serials, self.serial_from, self.is_read, self.parts_list)
        if sum(map(bool, sources)) > 1:
            raise ValueError("serial numbers are listed, counted or read: one of these")
        if self.goes_on and not self.serial_from:
            raise ValueError("counting goes on across runs only where numbers are counted")
        return self

    @model_validator(mode="after")
    def _no_part_of_a_dry_run(self) -> "RunRequest":
        of_a_part = (
            self.lot, self.order_number, self.parts_list, self.serials, self.serial_from,
            self.is_read, self.part_temperature_c is not None, self.are_trays_empty,
            self.is_part_removed, *(one.count for one in self.recipes),
        )  # fmt: skip
        if self.is_dry and (len(self.recipes) != 1 or any(of_a_part)):
            raise ValueError("a dry run is of one recipe, and has no part")
        return self

    @property
    def again(self) -> "RunRequest | None":
        """The same batch once more; None where that is impossible: each part has its number once.

        Counted numbers continue after the last one. A person's statements on the grippers and the
        trays held at that time, and are not repeated.
        """
        if self.serials or self.parts_list or self.is_dry:
            return None
        stated = {"are_trays_empty": False, "is_part_removed": False}
        return self.model_copy(update={**stated, "goes_on": bool(self.serial_from)})

    def options(self, who: str, parts_list: Path | None = None) -> list[str]:
        """Return the options of `cellctl run`; values follow `=`, so none is taken as an option.

        Parameters
        ----------
        who : the account that starts the run
        parts_list : file of the list that was sent
        """
        valued: dict[str, object] = {
            "--operator": who,
            "--lot": self.lot,
            "--order": self.order_number,
            "--cell": self.cell,
            "--serial-from": self.serial_from,
            "--part-temperature": self.part_temperature_c,
            "--seed": self.seed,
            "--parts-list": parts_list,
            "--speed": None if self.speed == 1 else self.speed,
        }
        stated = {
            "--across-runs": self.goes_on,
            "--dry": self.is_dry,
            "--scan": self.is_read,
            "--trays-empty": self.are_trays_empty,
            "--part-removed": self.is_part_removed,
        }
        return [
            *(f"{name}={value}" for name, value in valued.items() if value not in ("", None)),
            *(f"--serial={serial}" for serial in self.serials),
            *(name for name, is_stated in stated.items() if is_stated),
        ]
