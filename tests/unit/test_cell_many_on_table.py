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
from controller.cell.machine import Act, PartFault, Recovery
from controller.cell.services.records import PartRecord, sightings_row
from controller.cell.services.resuming import sighting_of
from controller.cell.services.table import Taking
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

    product = ANY(part_name="plate", compute=Picks(), number=0)
    record = ANY(
        part=before or PartRecord(number=1), products=(product,), wanted=(product,), product=product
    )
    number = asyncio.run(Taking(record, serials)._choose(sightings_row(sightings).sightings))
    if number is None:
        action = RecogniseAction(ANY(), ANY(), record)
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


def test_of_two_alike_that_with_more_grasps_comes_first() -> None:
    one, other = seen(), seen(x_mm=60.0)
    assert choose(one, other, counts=(2, 7)) is other


def test_parts_that_no_gripper_gets_at_are_named_with_their_places() -> None:
    with pytest.raises(PartProblemError, match="plate at x 12, y -7 mm, touching another") as e:
        choose(seen(touching_count=1), seen("block", touching_count=1, x_mm=40.0), counts=(0, 0))
    assert e.value.code == "many_parts"
    assert "no gripper gets at plate between them" in str(e.value)


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
    with pytest.raises(PartProblemError, match="74 % of its outline is seen; move it inwards") as e:
        choose(seen(is_cut=True, free_share=0.74))
    assert e.value.code == "part_cut_off"


def test_what_is_free_of_an_outline_is_kept_in_the_journal() -> None:
    (row,) = sightings_row((seen(free_share=0.8125, touching_count=2, is_cut=True),)).sightings
    again = sighting_of(row)
    assert again.free_share == pytest.approx(0.8125, abs=1e-3)
    assert (again.touching_count, again.is_cut) == (2, True)
