"""Chips and burrs by edges off their course: found where they are, and light takes nobody in."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import pytest
from cad_solids import Body, box, solid_of
from edge_views import edge_views, evidence_of
from numpy.typing import NDArray
from shown_part import part, perfect, samples

from controller.inspection import Finding, FindingKind, InspectionLimits
from controller.inspection.dimensions import MeasuringSettings
from controller.inspection.edge_evidence import (
    Displaced,
    EdgeLook,
    EdgeLooks,
    PartEdges,
    State,
    find_damage,
    find_displaced,
    find_edges,
    refuted,
)
from controller.inspection.integrity import Allowances

Array = NDArray[np.float64]
PIXEL_MM = 0.2
NOISE_PX = 0.03
DUST_MM = 1.0
# on the edge between front and top, off its corners
CHIP = (4.0, 17.0, 12.0)
TURNS = ((20.0, -12.0), (-15.0, -10.0))  # the front and the top in sight


@cache
def bar() -> PartEdges:
    edges = find_edges(solid_of(box(60, 8, 8)), PIXEL_MM)
    assert edges is not None
    return edges


def long_edge() -> NDArray[np.intp]:
    """The points of one of the bar's long edges."""
    edges = bar()
    number = int(edges.edge[np.argmax(np.bincount(edges.edge)[edges.edge])])
    return np.flatnonzero(edges.edge == number)


def seen(
    offset: Array,
    contrast: Array | None = None,
    view: str = "v0",
    x_px: float = 0,
    faces: tuple[bool, bool] = (True, True),
    shaded: Array | None = None,
    along_face: bool = False,
) -> EdgeLook:
    """A picture that shows one long edge of the bar, and nothing else."""
    edges, mine = bar(), long_edge()
    count = len(edges.edge)

    def at_edge(values: object, rest: float) -> Array:
        out = np.full(count, rest)
        out[mine] = values
        return out

    out = edges.normals.sum(axis=1) / np.sqrt(2.0)
    pixels = np.zeros((count, 2))
    pixels[mine, 0] = x_px + np.arange(len(mine)) * 2.0
    return EdgeLook(
        view_id=view,
        lamp="ring",
        state=at_edge(State.IN_PLACE, State.HIDDEN).astype(np.int8),
        offset_px=at_edge(offset, np.nan),
        sigma_px=at_edge(NOISE_PX, np.inf),
        contrast=at_edge(80.0 if contrast is None else contrast, 0.0),
        limit_px=np.full(count, 2.0),
        least_mm=np.zeros((count, 2)),
        faces_camera=np.tile(faces, (count, 1)),
        light_through=np.zeros((count, 2), dtype=bool),
        may_glare=np.zeros(count, dtype=bool),
        pixels=pixels,
        normals=np.tile([0.0, 1.0], (count, 1)),
        across=(-edges.into[:, 0] if along_face else out) / PIXEL_MM,
        may_shade=at_edge(False if shaded is None else shaded, False).astype(bool),
    )


def wavering(seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(0.0, NOISE_PX, len(long_edge()))


def of_bar(looks: Sequence[EdgeLook], turned_deg: float = 20.0) -> EdgeLooks:
    """Looks at the bar in views v0, v1 and on, each turned by so much against the one before."""
    poses = {look.view_id: turned(turned_deg * int(look.view_id[1:])) for look in looks}
    return EdgeLooks(bar(), tuple(looks), poses, PIXEL_MM, 3.0, Allowances(), MeasuringSettings())


def runs(*looks: EdgeLook) -> list[Displaced]:
    return find_displaced(of_bar(looks), DUST_MM)


def dented(first: int = 60, depth_px: float = -1.5) -> Array:
    out = wavering()
    out[first : first + 5] += depth_px * np.array([0.6, 1.0, 1.0, 1.0, 0.6])
    return out


def test_a_notch_is_found_where_it_is_and_as_large_as_it_is() -> None:
    (run,) = runs(seen(dented()))
    assert run.points.tolist() == long_edge()[60:65].tolist()
    assert run.depth_mm == pytest.approx(1.5 * PIXEL_MM, abs=3 * NOISE_PX * PIXEL_MM)
    # five points of an edge of 60 mm
    assert run.length_mm == pytest.approx(5 * 60 / len(long_edge()), rel=0.01)
    assert not run.is_burr


def test_what_stands_out_of_the_material_is_a_burr() -> None:
    (run,) = runs(seen(dented(depth_px=1.5)))
    assert run.is_burr


def test_an_edge_out_of_place_as_a_whole_or_turned_is_not_damaged() -> None:
    slope = np.linspace(-1.5, 1.5, len(long_edge()))
    assert runs(seen(wavering() + 1.5), seen(wavering(2) + slope)) == []


def test_noise_takes_nobody_in() -> None:
    # one part in a thousand is allowed; of 200 there are none with a probability of 82 %,
    # and more than two with one of 0.1 %
    found = [bool(runs(seen(wavering(seed)))) for seed in range(200)]
    assert sum(found) <= 2


def test_the_border_of_a_shadow_is_no_notch() -> None:
    # along it the other side is the bright one
    turned = np.where((np.arange(len(long_edge())) // 5) == 12, -60.0, 80.0)
    assert runs(seen(dented(), turned)) == []
    # or it is brighter by far
    bright = np.where(np.arange(len(long_edge())) < 62, 20.0, 80.0)
    assert runs(seen(dented(), bright)) == []


def test_beside_the_border_of_a_shadow_a_notch_is_left_to_other_looks() -> None:
    place = np.arange(len(long_edge()))
    # five points are off; as many on either side have to be in the same light
    assert runs(seen(dented(), np.where(place < 57, 20.0, 80.0))) == []
    assert runs(seen(dented(), np.where(place > 67, 20.0, 80.0))) == []
    assert len(runs(seen(dented(), np.where(place < 52, 20.0, 80.0)))) == 1


def test_a_shadow_that_leads_away_from_an_edge_is_no_notch() -> None:
    offset = wavering()
    offset[100:106] -= np.linspace(0.5, 3.0, 6)
    offset[106:] = np.nan
    assert runs(seen(offset)) == []


def test_by_the_border_of_the_grippers_shadow_nothing_is_known() -> None:
    place = np.arange(len(long_edge()))
    assert runs(seen(dented(), shaded=(place > 55) & (place < 70))) == []
    assert runs(seen(dented(), shaded=place > 61)) == []
    assert len(runs(seen(dented(), shaded=place > 80))) == 1


def test_at_the_end_of_an_edge_nothing_is_known() -> None:
    assert runs(seen(dented(first=0))) == []


def test_what_is_as_short_as_dust_is_none() -> None:
    speck = wavering()
    speck[60:62] -= 1.5
    assert runs(seen(speck)) == []


def turned(deg: float) -> Array:
    T = np.eye(4)
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def damage(turn_deg: float, x_px: float, second_px: float = -1.0, first: int = 60) -> list[Finding]:
    looks = seen(dented()), seen(dented(first, second_px), view="v1", x_px=x_px)
    found = find_damage(of_bar(looks, turn_deg), runs(*looks))
    return [f for every in found.values() for f in every]


def test_two_views_of_one_notch_are_sure() -> None:
    found = damage(20.0, 40.0)
    assert [f.is_sure for f in found] == [True, True]
    assert {f.kind for f in found} == {FindingKind.CHIP}


@pytest.mark.parametrize(
    "second",
    [
        damage(10.0, 40.0),  # the part was hardly turned
        damage(20.0, 0.0),  # in the same pixels: dirt on the lens
        damage(20.0, 40.0, first=80),  # elsewhere on the edge
        damage(20.0, 40.0, second_px=1.0),  # the other way
    ],
    ids=["same look", "same pixels", "elsewhere", "other way"],
)
def test_two_looks_that_one_error_explains_are_not_sure(second: list[Finding]) -> None:
    assert len(second) == 2
    assert not any(f.is_sure for f in second)


OUTLINE = (True, False)


def left(others: list[EdgeLook]) -> list[Finding]:
    """What is left of a notch in one view, with other looks at its edge: v1 and on, all turned."""
    shown = of_bar([seen(dented()), *others])
    found = find_displaced(shown, DUST_MM)
    every = find_damage(shown, found, refuted(shown, found))
    return [f for some in every.values() for f in some]


def clean(number: int, **how: Any) -> EdgeLook:
    return seen(wavering(number), view=f"v{number}", x_px=40.0 * number, **how)


def test_what_two_outlines_had_to_show_and_do_not_is_no_damage() -> None:
    assert left([clean(1, faces=OUTLINE), clean(2, faces=OUTLINE)]) == []


@pytest.mark.parametrize(
    "others",
    [
        [clean(1, faces=OUTLINE)],
        [clean(1, faces=OUTLINE), clean(1, faces=OUTLINE)],  # two lamps, one view
        [clean(1), clean(2)],  # both faces in sight: a facet between them may be as bright
        [clean(k, faces=OUTLINE, along_face=True) for k in (1, 2)],  # one face is seen edge-on
        [clean(k, faces=OUTLINE, shaded=np.ones(len(long_edge()))) for k in (1, 2)],
    ],
    ids=["one look", "one view", "not the outline", "flat", "in shadow"],
)
def test_looks_that_need_not_show_damage_do_not_refute_it(others: list[EdgeLook]) -> None:
    (found,) = left(others)
    assert not found.is_sure


def test_a_shallow_notch_is_not_refuted_by_outlines_that_might_not_show_it() -> None:
    shallow = seen(dented(depth_px=-0.8))
    looks = [shallow, clean(1, faces=OUTLINE), clean(2, faces=OUTLINE)]
    assert refuted(of_bar(looks), runs(*looks)) == [False]


def test_what_two_views_show_is_damage_whatever_two_others_do_not() -> None:
    again = seen(dented(), view="v3", x_px=200.0)
    found = left([clean(1, faces=OUTLINE), clean(2, faces=OUTLINE), again])
    assert [f.is_sure for f in found] == [True, True]


def test_where_the_gripper_may_keep_light_away_is_known_by_its_boxes() -> None:
    views = edge_views(perfect(), TURNS[:1])
    found = evidence_of(part(), samples(), views, InspectionLimits())
    assert found.edges is not None
    points = np.column_stack([found.edges.points_mm, np.ones(len(found.edges.edge))])
    task = {one.task.view_id: one.task for one in views}
    (side,) = next(iter(task.values())).lamps[1].points_mm
    shaded_count = 0
    for look in found.looks:
        if look.lamp == "backlit":
            assert not look.may_shade.any()
        if look.lamp != "side":
            continue
        view = task[look.view_id]
        start = points @ view.T_world_part_expected[:3].T
        way = start[:, None, :] + np.linspace(0.0, 1.0, 400)[:, None] * (side - start[:, None, :])
        clear_mm = np.full(len(start), np.inf)
        for box_ in view.holder:
            at = np.abs((way - box_.T[:3, 3]) @ box_.T[:3, :3]) - box_.half_mm
            clear_mm = np.minimum(clear_mm, np.max(at, axis=2).min(axis=1))
        assert look.may_shade[clear_mm < 0].all()
        assert not look.may_shade[clear_mm > 12.0].any()
        shaded_count += int((clear_mm < 0).sum())
    assert shaded_count > 20


def shown_damage(body: Body, turns: tuple[tuple[float, float], ...]) -> list[Finding]:
    views = edge_views(body, turns)
    found = evidence_of(part(), samples(), views, InspectionLimits())
    return [f for every in found.findings.values() for f in every]


def test_a_perfect_part_has_no_damage() -> None:
    assert shown_damage(perfect(), TURNS) == []


def test_a_chip_is_found_in_pictures() -> None:
    notch = box(3.0, 0.6, 0.6).rotate((45, 0, 0)).translate((CHIP[0], CHIP[1], CHIP[2]))
    found = shown_damage(perfect() - notch, TURNS)
    sure = [f for f in found if f.is_sure]
    assert len(sure) == 2
    for one in sure:
        assert one.kind is FindingKind.CHIP
        assert np.linalg.norm(one.p_part_mm - np.array(CHIP)) < 2.0
        assert one.size_mm == pytest.approx(3.0, abs=1.0)
        assert one.outline_px is not None
        x0, y0, x1, y1 = one.box_px
        deep = 2.0  # the notch is 0.4 mm deep
        assert (one.outline_px > np.array([x0, y0]) - deep).all()
        assert (one.outline_px < np.array([x1, y1]) + deep).all()


def test_one_view_of_a_chip_is_not_sure() -> None:
    notch = box(3.0, 0.6, 0.6).rotate((45, 0, 0)).translate((CHIP[0], CHIP[1], CHIP[2]))
    found = shown_damage(perfect() - notch, TURNS[:1])
    assert found
    assert not any(f.is_sure for f in found)
