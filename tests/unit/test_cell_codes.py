"""Serial numbers read by cameras: what is taken for one, and when a person is asked."""

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.compute import SeenCode
from controller.cell.errors import PartProblemError
from controller.cell.journal import rows
from controller.cell.operator import Answer, Question
from controller.cell.services import Background, Codes
from controller.cell.services.records import BatchRecord, RunProgress
from controller.cell.services.table import Label, LabelOrder, Labels
from controller.config.serial_code import SerialCodeSection

ANY: Any = SimpleNamespace
LAMPS = {"table_ring": np.zeros((4, 4), np.uint8), "table_side": np.zeros((4, 4), np.uint8)}
CORNERS = np.array([(0, 0, 5), (9, 0, 5), (9, 9, 5), (0, 9, 5)], float)


def code(text: str, picture: int = 0, fields: dict[str, str] | None = None) -> SeenCode:
    return SeenCode(text, fields or {}, picture, CORNERS)


class Cell:
    """A part on the table, and what the pictures of it show, look by look.

    ``typed`` is what a person answers; without it nobody is there.
    """

    def __init__(
        self,
        *looks: tuple[SeenCode, ...],
        order: LabelOrder = LabelOrder(),  # noqa: B008
        typed: str = "",
        **keys: Any,
    ) -> None:
        self.looks, self.typed = list(looks), typed
        self.rows: list[Any] = []
        self.questions: list[Question] = []
        recipe = ANY(name="lid", serial_code=SerialCodeSection(code="data_matrix", **keys))
        product: Any = ANY(number=0, part_name="lid", count=3, recipe=recipe)
        journal: Any = ANY(write=lambda row, part: self.rows.append(row))
        self.record = BatchRecord(journal, RunProgress(), lambda: None, products=(product,))
        self.labels = Labels(order, self)
        self.codes = Codes(self.record, self, Background(), self.labels)  # type: ignore[arg-type]
        self.next()

    def next(self) -> None:
        """Have the next part recognised."""
        part = self.record.part
        if part.number:
            part.tray = "accept"
            self.record.finish_part()
        self.record.begin_part()
        part = self.record.part
        part.sighting = ANY(T_world_part=np.eye(4))
        part.picture_names = {lamp: f"pictures/{lamp}.png" for lamp in LAMPS}
        product = self.record.products[0]
        label = self.labels.assign(part, product)
        self.record.identify_part(product, label.serial, label.lot)

    async def read_codes(self, pictures: Any, T: Any, *, is_held: bool) -> tuple[SeenCode, ...]:
        assert len(pictures) == len(LAMPS)
        return self.looks.pop(0)

    async def decide(self, question: Question) -> Answer | None:
        self.questions.append(question)
        if not self.typed or (why := question.check(self.typed)):
            assert not self.typed or why
            return None
        return Answer(self.typed, "a person")

    def look(self) -> None:
        """Read the code in the pictures of the table."""
        asyncio.run(self.codes.read_on_table(LAMPS))

    def view(self, is_slow: bool = False) -> str:
        """Read the code in a view of the held part; return what `settle` says in the end."""

        async def shown() -> str:
            located: Any = asyncio.get_running_loop().create_future()
            located.set_result(ANY(T_world_part=np.eye(4)))
            view: Any = ANY(view="V1", expected=np.eye(4), located=located)
            self.record.part.files["V1"] = {lamp: f"pictures/V1_{lamp}.png" for lamp in LAMPS}
            self.codes.read_in_view(view, LAMPS)
            return await self.codes.settle()

        return asyncio.run(shown())

    def settle(self) -> str:
        return asyncio.run(self.codes.settle())

    @property
    def last(self) -> rows.PartIdentified:
        """The row that says which part it is."""
        return [row for row in self.rows if isinstance(row, rows.PartIdentified)][-1]


def test_a_number_read_on_the_table_is_the_parts_and_names_its_picture() -> None:
    cell = Cell((code("SN-1", 1),))
    cell.look()
    assert cell.last.serial == cell.record.part.serial == "SN-1"
    assert cell.last.code is not None
    assert cell.last.code.picture == "pictures/table_side.png"
    np.testing.assert_array_equal(cell.record.part.codes_mm[0], CORNERS)
    assert (cell.settle(), cell.questions) == ("", [])


def test_a_code_on_another_side_is_read_in_a_view_of_the_held_part() -> None:
    cell = Cell((), (code("SN-2"),))
    cell.look()
    assert cell.last.serial == ""
    assert cell.view() == ""
    assert (cell.last.serial, cell.questions) == ("SN-2", [])
    assert cell.last.code is not None
    assert cell.last.code.picture == "pictures/V1_table_ring.png"


def test_a_part_whose_code_nobody_reads_is_kept_back() -> None:
    cell = Cell((), ())
    cell.look()
    why = cell.view()
    assert why.startswith("not identified: part 1: no code with its serial number was read in 4 p")
    assert cell.last.serial == ""


def test_a_person_is_asked_for_the_number_that_no_picture_shows() -> None:
    cell = Cell((), (), typed="SN-9")
    cell.look()
    assert cell.view() == ""
    assert cell.last.serial == "SN-9"
    assert cell.last.code is None  # it was not read by a camera
    (question,) = cell.questions
    assert (question.code, question.entry) == ("scan", "serial number")


def test_two_codes_that_differ_are_a_question_and_nobody_there_holds_the_cell() -> None:
    cell = Cell((code("SN-1"), code("SN-2")))
    with pytest.raises(PartProblemError, match="contradict each other") as e:
        cell.look()
    assert e.value.code == "no_serial"
    assert "SN-1, SN-2" in cell.questions[0].text
    answered = Cell((code("SN-1"), code("SN-2")), typed="SN-2")
    answered.look()
    assert answered.last.serial == "SN-2"


def test_another_code_on_another_side_contradicts_the_first_and_keeps_the_part_back() -> None:
    cell = Cell((code("SN-1"),), (code("SN-1"),), (code("SN-8"),))
    cell.look()
    assert cell.view() == ""  # the same once more
    assert "2 codes contradict each other (SN-1, SN-8)" in cell.view()


def test_what_a_person_has_named_no_later_code_renames() -> None:
    cell = Cell((code("SN-1"), code("SN-2")), (code("SN-1"),), typed="SN-2")
    cell.look()
    cell.view()
    assert cell.last.serial == "SN-2"


def test_the_area_of_every_code_that_was_read_on_the_part_is_left_out() -> None:
    cell = Cell((code("MADE IN EU"), code("SN-7")), form="SN-*")
    cell.look()
    assert len(cell.record.part.codes_mm) == 2


def test_a_number_that_another_part_of_the_run_has_is_refused() -> None:
    cell = Cell((code("SN-1"),), (code("SN-1"),))
    cell.look()
    cell.next()
    with pytest.raises(PartProblemError, match="a part of this run has this number already"):
        cell.look()
    assert cell.record.part.serial == ""


def test_a_code_of_another_form_is_passed_over_and_named_if_no_other_is_found() -> None:
    both = (code("MADE IN EU"), code("SN-7"))
    cell = Cell(both, form="SN-*")
    cell.look()
    assert cell.last.serial == "SN-7"
    alone = Cell(both[:1], form="SN-*")
    alone.look()
    assert "MADE IN EU: the recipe asks for the form SN-*" in alone.settle()


def test_the_number_is_the_field_that_the_recipe_names() -> None:
    text = "(01)04012345678901(21)A-7"
    cell = Cell((code(text, fields={"01": "04012345678901", "21": "A-7"}),), field="21")
    cell.look()
    assert cell.last.serial == "A-7"
    assert cell.last.code is not None
    assert cell.last.code.text == text


@pytest.mark.parametrize("text", ["", " ", "A" * 81])
def test_what_cannot_be_a_number_is_none(text: str) -> None:
    cell = Cell((code(text),))
    with pytest.raises(PartProblemError, match="a serial number"):
        cell.look()


def test_beside_the_part_is_nothing_a_question_at_once_for_no_view_shows_it() -> None:
    cell = Cell((), at="beside")
    with pytest.raises(PartProblemError) as e:
        cell.look()
    assert e.value.code == "no_serial"


def test_a_code_beside_a_part_names_none_of_several() -> None:
    cell = Cell((code("SN-1"),), at="beside")
    cell.record.part.neighbours = (ANY(part="lid"),)
    with pytest.raises(PartProblemError) as e:
        cell.look()
    assert e.value.code == "many_parts"


def test_a_listed_number_brings_its_lot_and_an_unlisted_one_is_refused() -> None:
    order = LabelOrder(listed=((0, Label("SN-1", "L1")), (0, Label("SN-2", "L2"))))
    cell = Cell((code("SN-2"),), (code("SN-3"),), order=order)
    cell.look()
    assert (cell.last.serial, cell.last.lot) == ("SN-2", "L2")
    cell.next()
    with pytest.raises(PartProblemError, match="the list of parts has no such number"):
        cell.look()


def test_a_number_listed_for_another_recipe_is_refused() -> None:
    order = LabelOrder(listed=((0, Label("SN-1")), (1, Label("SN-2"))))
    with pytest.raises(PartProblemError, match="this number for another recipe"):
        Cell((code("SN-2"),), order=order).look()


def test_papers_that_name_another_number_than_the_code_keep_the_part_back() -> None:
    order = LabelOrder(in_order=("SN-1", "SN-2"))
    cell = Cell((code("SN-1"),), (code("SN-9"),), order=order)
    cell.look()
    assert cell.settle() == ""
    cell.next()
    cell.look()
    assert cell.settle() == "its code reads SN-9, its papers say SN-2: another part?"
    assert cell.last.serial == "SN-2"


def test_without_a_code_in_the_recipe_no_picture_is_read() -> None:
    cell = Cell()
    recipe: Any = cell.record.products[0].recipe
    recipe.serial_code = None
    cell.look()
    assert cell.view() == ""
