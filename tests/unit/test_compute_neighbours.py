"""What else is on the table, as planning gets it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
from planning_cell import emulated_layout

from controller.cad import make_solid
from controller.cell.compute.neighbours import UNKNOWN_HEIGHT_MM, layout_among
from controller.cell.custody import ALONE, Around
from controller.cell.journal.rows import OtherHypothesis, SightingFields

LAYOUT = emulated_layout()
BLOCK = make_solid(
    trimesh.creation.box((60.0, 40.0, 30.0)), "block", "0123456789abcdef", where="block"
)


class Library:
    entries = (SimpleNamespace(name="block"),)

    def solid(self, number: int) -> Any:
        assert number == 0
        return BLOCK


class Known:
    layout, overhead, library = LAYOUT, LAYOUT.overhead, Library()


KNOWN: Any = Known()


def standing_at(x: float, y: float) -> tuple[tuple[float, ...], ...]:
    T = np.eye(4)
    T[:3, 3] = x, y, 15.0
    return tuple(map(tuple, T.tolist()))


def seen(part: str | None, **more: Any) -> SightingFields:
    values: dict[str, Any] = {
        "part": part, "pose_index": 0, "x_mm": 0.0, "y_mm": 0.0, "theta_deg": 0.0, "score": 1.0,
        "box_px": (500, 400, 560, 450),
    }  # fmt: skip
    return SightingFields(**(values | more))


def bounds_of(shape: Any) -> np.ndarray:
    points = shape.shape.hull_mm @ shape.T[:3, :3].T + shape.T[:3, 3]
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_nothing_beside_the_part_leaves_the_cell_as_it_is() -> None:
    assert layout_among(KNOWN, ALONE) is LAYOUT


def test_a_known_part_is_there_as_its_triangles() -> None:
    layout = layout_among(KNOWN, Around((seen("block", T_world_part=standing_at(300.0, 50.0)),)))
    (shape,) = layout.neighbours
    np.testing.assert_allclose(bounds_of(shape), [[270, 30, 0], [330, 70, 30]], atol=1e-9)


def test_a_part_that_may_lie_otherwise_is_there_in_each_way() -> None:
    other = OtherHypothesis(
        part="block", pose_index=1, theta_deg=0.0, T_world_part=standing_at(310.0, 50.0)
    )
    one = seen("block", T_world_part=standing_at(300.0, 50.0), ambiguous_with=(other,))
    assert [n.T[0, 3] for n in layout_among(KNOWN, Around((one,))).neighbours] == [300.0, 310.0]


@pytest.mark.parametrize(
    "one", [seen(None), seen("stranger", T_world_part=standing_at(300.0, 50.0))]
)
def test_an_object_nobody_knows_is_a_column_round_all_it_can_be(one: SightingFields) -> None:
    # whatever stands within its outline, up to that height, is inside: a post in each corner and
    # in the middle of the outline, seen by the camera at both ends
    (column,) = layout_among(KNOWN, Around((one,))).neighbours
    (low, high) = bounds_of(column)
    assert low[2] == pytest.approx(0.0)
    assert high[2] == pytest.approx(UNKNOWN_HEIGHT_MM)
    x0, y0, x1, y1 = one.box_px
    rng = np.random.default_rng(3)
    pixels = np.column_stack([rng.uniform(x0, x1, 200), rng.uniform(y0, y1, 200)])
    for height in np.linspace(0.0, UNKNOWN_HEIGHT_MM, 7):
        points = LAYOUT.overhead.on_plane(pixels, float(height))
        assert (points[:, :2] >= low[:2] - 1e-6).all()
        assert (points[:, :2] <= high[:2] + 1e-6).all()
    # and not much more than that: half as wide again
    on_table = LAYOUT.overhead.on_plane(np.array([[x0, y0], [x1, y1]], dtype=float))
    assert (
        np.ptp([low[:2], high[:2]], axis=0) < 1.5 * np.abs(np.diff(on_table, axis=0))[0, :2]
    ).all()
