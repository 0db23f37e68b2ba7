"""What the cell does where more, or less, than one part is seen on the table."""

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions.perception.recognise import RecogniseAction
from controller.cell.compute import Pickable
from controller.cell.custody import Custody
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal import rows
from controller.cell.machine import Act, PartFault, Recovery
from controller.cell.services.going_on import sighting_of
from controller.cell.services.records import BatchRecord, PartRecord, RunProgress, sightings_row
from controller.cell.services.table import Label, LabelOrder, Labels, Taking
from controller.recognition import Alternative, Sighting

ANY: Any = SimpleNamespace


def seen(part: str | None = "plate", **more: Any) -> Sighting:
    known: dict[str, Any] = {
        "part": part,
        "pose_index": 0,
        "R": np.eye(3),
        "x_mm": 12.0,
        "y_mm": -7.0,
        "theta_rad": 0.0,
        "T_world_part": np.eye(4),
        "score": 0.99,
        "covariance": np.eye(3) * 1e-4,
        "ambiguous_with": (),
        "area_mm2": 100.0,
        "box_px": (0, 0, 10, 10),
        "residual_px": 0.1,
    }
    return Sighting(**(known | more))


def choose(
    *sightings: Sighting,
    counts: tuple[int, ...] = (),
    before: PartRecord | None = None,
    serials: tuple[str, ...] = (),
) -> Sighting:
    """Return the sighting that the action goes on with, with so many grasps for each."""

    class Picks:
        async def pickable(self, seen: Any) -> tuple[Pickable, ...]:
            assert len(seen) == len(sightings)
            return tuple(Pickable(count, 60.0) for count in counts or (1,) * len(seen))

    product = ANY(part_name="plate", compute=Picks(), number=0, recipe=ANY(serial_code=None))
    record = ANY(
        part=before or PartRecord(number=1), products=(product,), wanted=(product,), product=product
    )
    number = asyncio.run(
        Taking(record, Labels(LabelOrder(serials)))._choose(sightings_row(sightings).sightings)
    )
    if number is None:
        action = RecogniseAction(ANY(), ANY(), record, ANY())
        raise action._nothing_found()
    return sightings[number]


def sought_again(*neighbours: Sighting) -> PartRecord:
    """Return a part that was at x 12, y -7 mm, with others beside it."""
    row = sightings_row((seen(), *neighbours)).model_copy(update={"taken": 0})
    return PartRecord(number=1, sighting=seen(), neighbours=row.parted()[1])


def test_the_recipes_part_alone_is_taken() -> None:
    one = seen()
    assert choose(one) is one


@pytest.mark.parametrize("other", ["plate", "block", None])
def test_of_several_objects_one_that_a_gripper_gets_at_is_taken(other: str | None) -> None:
    beside, free = seen(other, x_mm=80.0), seen(x_mm=40.0)
    assert choose(beside, free, counts=(0, 3)) is free


@pytest.mark.parametrize(
    ("better", "worse"),
    [
        ({}, {"ambiguous_with": (Alternative("twin", 0, 0.0, np.eye(4)),)}),
        ({}, {"touching_count": 1}),
        ({"free_share": 0.99}, {"free_share": 0.80}),
    ],
)
def test_what_is_sure_and_free_comes_first(better: Any, worse: Any) -> None:
    # whatever the number of grasps, and whichever is named first
    good, bad = seen(**better), seen(x_mm=60.0, **worse)
    assert choose(bad, good, counts=(9, 1)) is good
    assert choose(good, bad, counts=(1, 9)) is good


def test_of_two_parts_the_one_that_lies_on_the_other_is_taken_first() -> None:
    below, above = seen(is_covered=True), seen(x_mm=60.0, lies_on=(0,), free_share=0.6)
    assert choose(below, above, counts=(9, 1)) is above


def test_what_something_lies_on_is_not_taken_whatever_is_beside_it() -> None:
    with pytest.raises(PartProblemError, match="touching another, under another") as e:
        choose(seen(touching_count=1, is_covered=True), seen(None, x_mm=60.0), counts=(9, 0))
    assert e.value.code == "many_parts"


def test_of_two_alike_that_with_more_grasps_comes_first() -> None:
    one, other = seen(), seen(x_mm=60.0)
    assert choose(one, other, counts=(2, 7)) is other


def test_parts_that_no_gripper_gets_at_are_named_with_their_places() -> None:
    with pytest.raises(PartProblemError, match="plate at x 12, y -7 mm, touching another") as e:
        choose(seen(touching_count=1), seen("block", touching_count=1, x_mm=40.0), counts=(0, 0))
    assert e.value.code == "many_parts"
    assert "no gripper reaches plate between them" in str(e.value)


def test_of_several_objects_none_of_which_is_the_recipes_all_are_named() -> None:
    with pytest.raises(PartProblemError, match="none is plate that can be taken") as e:
        choose(seen("block"), seen(None, x_mm=50.0), seen(is_cut=True, x_mm=90.0))
    assert e.value.code == "many_parts"
    for words in ("block at x 12", "unknown object at x 50", "plate at x 90, y -7 mm, partly"):
        assert words in str(e.value)


@pytest.mark.parametrize(
    ("one", "code"), [(seen(None), "unknown_object"), (seen("block"), "wrong_part")]
)
def test_another_object_alone_is_not_taken(one: Sighting, code: str) -> None:
    with pytest.raises(PartProblemError) as e:
        choose(one)
    assert e.value.code == code


def test_a_lost_part_is_what_was_not_there_before() -> None:
    beside = seen(x_mm=100.0)
    found = seen(x_mm=160.0)
    # the other one was pushed a little when this one fell
    assert choose(seen(x_mm=106.0), found, before=sought_again(beside)) is found


def test_a_neighbour_is_not_taken_for_the_lost_part() -> None:
    record = sought_again(seen(x_mm=100.0))
    record.custody = Custody.LOST
    record.recoveries.append(Recovery(PartFault.DROPPED, "it fell", Act.RETRY))
    with pytest.raises(PartFaultError, match="does not see it"):
        choose(seen(x_mm=101.0), before=record)


def test_where_two_may_be_the_lost_part_a_person_decides() -> None:
    with pytest.raises(PartProblemError, match="may be the plate that was lost") as e:
        choose(seen(x_mm=200.0), seen(x_mm=300.0), before=sought_again(seen(x_mm=100.0)))
    assert e.value.code == "many_parts"


def test_parts_with_serial_numbers_come_one_at_a_time() -> None:
    with pytest.raises(PartProblemError, match="which of them has the serial number A17"):
        choose(seen(), seen(x_mm=60.0), serials=("A17", "A18"))
    block, plate = seen("block"), seen(x_mm=60.0)
    assert choose(block, plate, serials=("A17",)) is plate


def test_the_row_of_a_look_tells_the_part_from_what_is_left_alone() -> None:
    row = sightings_row((seen("block"), seen(x_mm=60.0)))
    assert row.parted() == (None, row.sightings)
    taken = row.model_copy(update={"taken": 1})
    assert taken.parted() == (row.sightings[1], row.sightings[:1])
    (alone,) = sightings_row((seen(),)).sightings
    assert sightings_row((seen(),)).parted() == (alone, ())


def test_what_may_be_the_recipes_part_is_read_as_it() -> None:
    # the twin's centre of mass is 2 mm beside, in the part's own frame, and it lies a quarter round
    T = np.eye(4)
    T[:2, :2], T[:2, 3] = [[0.0, -1.0], [1.0, 0.0]], (30.0, 40.0)
    pose = SimpleNamespace(R=np.diag([1.0, -1.0, -1.0]))
    entry = ANY(name="plate", centroid_mm=np.array([2.0, 0.0, 5.0]), pose=lambda _: pose)
    library: Any = ANY(entries=(ANY(name="twin"), entry))
    own = Alternative("plate", 3, np.pi / 2, T)
    third = Alternative("block", 1, 0.1, np.eye(4))
    one = seen("twin", pose_index=2, theta_rad=0.5, ambiguous_with=(third, own))
    read = one.read_as("plate", library)
    assert (read.part, read.pose_index, read.theta_rad) == ("plate", 3, np.pi / 2)
    assert (read.x_mm, read.y_mm) == pytest.approx((30.0, 42.0))
    assert read.T_world_part is T
    assert np.array_equal(read.R, pose.R)
    assert [a.part for a in read.ambiguous_with] == ["twin", "block"]
    assert (read.ambiguous_with[0].pose_index, read.ambiguous_with[0].theta_rad) == (2, 0.5)
    assert choose(read) is read


@pytest.mark.parametrize("one", [seen(), seen("twin"), seen(None)])
def test_what_is_sure_is_read_as_what_it_is(one: Sighting) -> None:
    assert one.read_as("plate", ANY()) is one


def test_a_part_partly_outside_the_backlit_area_is_not_grasped() -> None:
    with pytest.raises(
        PartProblemError, match="74 % of its outline is visible; move it inwards"
    ) as e:
        choose(seen(is_cut=True, free_share=0.74))
    assert e.value.code == "part_cut_off"


def test_what_is_free_of_an_outline_is_kept_in_the_journal() -> None:
    one = seen(free_share=0.8125, touching_count=2, is_cut=True, lies_on=(1, 3), is_covered=True)
    (row,) = sightings_row((one,)).sightings
    again = sighting_of(row)
    assert again.free_share == pytest.approx(0.8125, abs=1e-3)
    assert (again.touching_count, again.is_cut) == (2, True)
    assert (again.lies_on, again.is_covered) == ((1, 3), True)


# --- several recipes ----------------------------------------------------------------------------

TWO = {"plate": (1, 60.0), "block": (1, 90.0)}  # paths of a gripper to a part, and its forecast


class Batch:
    """A batch of plates and blocks, with a journal that keeps its rows."""

    def __init__(self, order: LabelOrder = LabelOrder(), **left: int) -> None:  # noqa: B008
        self.how: dict[str, tuple[int, float]] = dict(TWO)
        self.rows: list[Any] = []
        counts = {"plate": 2, "block": 2} | left
        products = [
            ANY(
                number=n, part_name=name, count=count, compute=self._asking(name),
                recipe=ANY(name=f"the {name}", serial_code=None),
            )
            for n, (name, count) in enumerate(counts.items())
        ]  # fmt: skip
        journal: Any = ANY(write=lambda row, part: self.rows.append(row))
        self.record = BatchRecord(journal, RunProgress(), lambda: None, products=products)
        self.record.begin_part()
        self.taking = Taking(self.record, Labels(order))

    def _asking(self, name: str) -> Any:
        async def pickable(seen: Any) -> tuple[Pickable, ...]:
            none = Pickable()
            return tuple(Pickable(*self.how[name]) if s.part == name else none for s in seen)

        return ANY(pickable=pickable)

    def take(self, *sightings: Sighting) -> Sighting:
        """Return what is taken of a look at the table."""
        asyncio.run(self.taking.take(sightings))
        taken = self.record.part.sighting
        assert taken is not None
        return taken

    def leave(self, reason: str = "no grasp reaches it") -> Sighting | None:
        """Leave the part at hand; return what is taken in its place, None for nothing."""
        return self.record.part.sighting if asyncio.run(self.taking.leave(reason)) else None

    def done(self) -> None:
        """Have the part at hand in its tray."""
        self.record.part.tray = "accept"
        self.record.finish_part()
        self.record.begin_part()

    @property
    def identified(self) -> list[tuple[str, str, str]]:
        return [(r.name, r.serial, r.lot) for r in self.rows if isinstance(r, rows.PartIdentified)]


PLATE, BLOCK = seen("plate"), seen("block", x_mm=80.0)


def test_a_part_of_any_recipe_is_taken_and_is_of_its_recipe() -> None:
    batch = Batch()
    assert batch.take(seen(None, x_mm=150.0), BLOCK) is BLOCK
    assert batch.record.product.recipe.name == "the block"
    assert batch.identified == [("the block", "", "")]


def test_of_parts_that_are_as_free_the_one_soonest_done_comes_first() -> None:
    assert Batch().take(BLOCK, PLATE) is PLATE
    other = Batch()
    other.how["block"] = (1, 30.0)
    assert other.take(BLOCK, PLATE) is BLOCK


def test_a_sure_part_comes_before_a_quick_one() -> None:
    twin = Alternative("twin", 0, 0.0, np.eye(4))
    assert Batch().take(seen("plate", ambiguous_with=(twin,)), BLOCK) is BLOCK


def test_further_parts_of_a_recipe_that_has_enough_are_left_alone() -> None:
    batch = Batch(plate=1)
    assert batch.take(PLATE, BLOCK) is PLATE
    batch.done()
    assert batch.record.done == {"the plate": (1, 1), "the block": (0, 2)}
    assert batch.take(PLATE, BLOCK) is BLOCK
    batch.done()
    with pytest.raises(PartProblemError, match="enough of those are done") as e:
        batch.take(PLATE)
    assert e.value.code == "wrong_part"


def test_the_batch_is_done_once_all_counts_are_reached() -> None:
    batch = Batch(plate=1, block=1)
    for one in (PLATE, BLOCK):
        assert batch.record.parts_left > 0
        batch.take(one)
        batch.done()
    assert batch.record.parts_left == 0


def test_a_part_without_a_plan_is_left_for_another_and_named() -> None:
    batch = Batch()
    assert batch.take(PLATE, BLOCK) is PLATE
    assert batch.leave("no grasp reaches it") is BLOCK
    assert batch.record.product.recipe.name == "the block"
    (left,) = [row for row in batch.rows if isinstance(row, rows.PartLeft)]
    assert (left.part, left.reason) == ("plate", "no grasp reaches it")
    batch.done()
    # at the next look it lies as it lay, and is not tried again while another can be taken
    assert batch.take(PLATE, seen("block", x_mm=200.0)).part == "block"


def test_where_no_other_part_can_be_taken_nothing_is_left() -> None:
    batch = Batch()
    batch.take(PLATE)
    assert batch.leave() is None
    batch = Batch()
    batch.take(PLATE, seen(None, x_mm=80.0))
    assert batch.leave() is None
    assert batch.record.part.sighting is PLATE  # so that the problem is told of this part


def test_a_part_that_was_left_is_tried_again_once_what_was_beside_it_is_gone() -> None:
    batch = Batch()
    batch.take(PLATE, BLOCK)
    batch.leave()
    batch.done()
    assert batch.take(PLATE) is PLATE
    batch = Batch()
    batch.take(PLATE, BLOCK)
    batch.leave()
    batch.done()
    batch.how["block"] = (0, 90.0)
    with pytest.raises(PartProblemError, match="no gripper reaches"):
        batch.take(PLATE, BLOCK)


def test_a_part_that_was_left_and_lies_as_before_is_named_with_its_reason() -> None:
    batch, stranger = Batch(block=1), seen(None, x_mm=150.0)
    batch.take(PLATE, BLOCK, stranger)
    batch.leave("it is too flat")
    batch.record._left[1] = 0
    batch.record.begin_part()
    batch.record.part.sighting = batch.record.part.product = None
    with pytest.raises(PartProblemError, match="it is too flat") as e:
        batch.take(PLATE, BLOCK, stranger)
    assert e.value.code == "no_plan"
    batch.taking.forget()  # somebody has been at the table
    assert batch.take(PLATE, BLOCK, stranger) is PLATE


@pytest.mark.parametrize(
    "order", [LabelOrder(), LabelOrder(counted_from="S1"), LabelOrder(in_order=("S1", "S2"))]
)
def test_after_a_person_was_at_the_table_another_part_may_come_first(order: LabelOrder) -> None:
    batch = Batch(order)
    batch.take(PLATE)
    batch.taking.begin_anew()  # it had no plan; they laid others, or moved it
    far = seen("block", x_mm=200.0)
    assert batch.take(seen(None, x_mm=150.0), far) is far
    number = "" if order == LabelOrder() else "S1"
    assert batch.identified == [("the plate", number, ""), ("the block", number, "")]


def test_a_number_that_was_read_stays_that_of_the_part_a_person_moved() -> None:
    batch = Batch(LabelOrder(is_read=True), plate=1)
    batch.record.part.scanned = "X7"
    batch.take(PLATE)
    batch.taking.begin_anew()
    moved = seen(x_mm=200.0)
    assert batch.take(moved) is moved
    batch.taking.begin_anew()
    with pytest.raises(PartProblemError, match="which of them has the serial number X7"):
        batch.take(moved, BLOCK)
    assert set(batch.identified) == {("the plate", "X7", "")}


@pytest.mark.parametrize(
    "change", [{"hold_count": 1}, {"plan_count": 1}, {"interrupted": "run"}], ids=str
)
def test_a_part_that_was_begun_is_sought_again_after_a_person_was_there(change: Any) -> None:
    batch = Batch()
    batch.take(PLATE)
    for name, value in change.items():
        setattr(batch.record.part, name, value)
    batch.taking.begin_anew()
    with pytest.raises(PartProblemError, match="that was lost"):
        batch.take(seen(x_mm=90.0), seen(x_mm=200.0))


def test_a_part_that_was_held_or_read_is_never_left_for_another() -> None:
    for change in ({"hold_count": 1}, {"scanned": "A1"}, {"interrupted": "run"}):
        batch = Batch()
        batch.take(PLATE, BLOCK)
        for name, value in change.items():
            setattr(batch.record.part, name, value)
        assert batch.leave() is None


LISTED = ((0, Label("P1", "L1")), (1, Label("B1", "L2")), (0, Label("P2", "L1")))


def test_listed_numbers_go_to_parts_that_are_alone_of_their_recipe() -> None:
    batch = Batch(LabelOrder(listed=LISTED), block=1)
    two = (PLATE, seen("plate", x_mm=200.0))
    assert batch.take(*two, BLOCK) is BLOCK  # which plate is P1 no picture shows
    batch.done()
    with pytest.raises(PartProblemError, match="which of them has the serial number P1") as e:
        batch.take(*two)
    assert e.value.code == "many_parts"
    batch.take(PLATE)
    assert batch.identified == [("the block", "B1", "L2"), ("the plate", "P1", "L1")]


def test_a_number_that_was_read_is_that_of_the_only_part_of_the_batch() -> None:
    batch = Batch(LabelOrder(is_read=True), plate=1)
    batch.record.part.scanned = "X7"
    with pytest.raises(PartProblemError, match="which of them has the serial number X7"):
        batch.take(PLATE, BLOCK)
    assert batch.take(PLATE, seen(None, x_mm=150.0)) is PLATE
    assert batch.identified == [("the plate", "X7", "")]
    batch.done()
    batch.record.part.scanned = "X8"
    # a plate of which there are enough may be what was laid and read
    with pytest.raises(PartProblemError, match="X8"):
        batch.take(PLATE, BLOCK)


def test_a_listed_number_that_was_read_must_be_on_a_part_of_its_recipe() -> None:
    batch = Batch(LabelOrder(listed=LISTED, is_read=True))
    batch.record.part.scanned = "B1"
    with pytest.raises(PartProblemError, match="put block there") as e:
        batch.take(PLATE)
    assert e.value.code == "wrong_part"


def test_counted_numbers_follow_the_parts_as_they_are_begun() -> None:
    batch = Batch(LabelOrder(counted_from="A01"))
    batch.take(PLATE, BLOCK, seen("plate", x_mm=200.0))
    batch.done()
    batch.take(BLOCK)
    assert [serial for _, serial, _ in batch.identified] == ["A01", "A02"]


def test_a_part_of_the_batch_that_was_lost_is_sought_as_what_it_was() -> None:
    batch = Batch()
    batch.take(PLATE, BLOCK)
    assert batch.take(seen("plate", x_mm=60.0), BLOCK).part == "plate"
    assert len(batch.identified) == 1
