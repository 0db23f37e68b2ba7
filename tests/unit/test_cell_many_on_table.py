"""What the cell does where more, or less, than one part is seen on the table."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions.perception.recognise import RecogniseAction
from controller.cell.errors import PartProblemError
from controller.cell.services.records import sightings_row
from controller.cell.services.resuming import sighting_of
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


def choose(*sightings: Sighting) -> Sighting:
    action = RecogniseAction(ANY(), ANY(part=Path("plate.step")), ANY())
    return action._choose(sightings)


def test_the_recipes_part_alone_is_taken() -> None:
    one = seen()
    assert choose(one) is one


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


def test_of_parts_that_touch_none_is_grasped_and_each_is_named() -> None:
    with pytest.raises(PartProblemError, match="plate at x 12, y -7 mm, touching another") as e:
        choose(seen(touching_count=1), seen("block", touching_count=1, x_mm=40.0))
    assert e.value.code == "many_parts"


def test_what_is_free_of_an_outline_is_kept_in_the_journal() -> None:
    (row,) = sightings_row((seen(free_share=0.8125, touching_count=2, is_cut=True),)).sightings
    again = sighting_of(row)
    assert again.free_share == pytest.approx(0.8125, abs=1e-3)
    assert (again.touching_count, again.is_cut) == (2, True)
