"""Libraries so large that the views compared first need not hold the right one."""

from __future__ import annotations

from typing import Any

import pytest
from recognise_bench import CAMERA, backlit, library, shape

from controller.recognition import recognise
from controller.recognition.identification import clusters
from controller.recognition.identification.lone import silhouette_of
from controller.recognition.identification.scene import TableScene
from controller.recognition.library import FEW_VIEWS, Candidate, Silhouette


@pytest.fixture
def look_for_several(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Notes each look for several parts, which is ten times as slow, and finds none."""
    looks: list[object] = []

    def none(region: object, *_: object) -> tuple[()]:
        looks.append(region)
        return ()

    monkeypatch.setattr(clusters, "parts_of", none)
    return looks


@pytest.fixture
def others_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first search finds views of other parts alone, as in a crowd of like ones."""
    index, entries = library().index, library().entries
    whole = index.search

    def search(seen: Silhouette, max_view_count: int = FEW_VIEWS, **more: Any) -> list[Candidate]:
        found = whole(seen, max_view_count, **more)
        if max_view_count > FEW_VIEWS:
            return found
        return [c for c in found if entries[c.part].name != "elbow"]

    monkeypatch.setattr(index, "search", search)


@pytest.mark.usefixtures("others_first")
def test_in_a_crowd_more_views_are_compared_before_several_parts_are_looked_for(
    monkeypatch: pytest.MonkeyPatch, look_for_several: list[object]
) -> None:
    monkeypatch.setattr(library().index, "near_count", lambda *_: FEW_VIEWS + 1)
    picture = backlit(shape(theta_rad=0.3))
    (seen,) = recognise(picture, CAMERA, library(), "backlit").sightings
    assert seen.part == "elbow"
    assert not look_for_several


@pytest.mark.usefixtures("others_first")
def test_where_few_views_are_near_no_second_search_is_made(look_for_several: list[object]) -> None:
    picture = backlit(shape(theta_rad=0.3))
    (seen,) = recognise(picture, CAMERA, library(), "backlit").sightings
    assert seen.part is None
    assert len(look_for_several) == 1


def test_views_near_a_silhouette_are_counted() -> None:
    index = library().index
    picture = backlit(shape(theta_rad=0.3))
    found = recognise(picture, CAMERA, library(), "backlit")
    scene = TableScene((picture,), CAMERA, library(), is_backlit=True)
    seen = silhouette_of(found.traces[0].region.loops_px, scene)
    assert seen is not None
    counts = [index.near_count(seen, far) for far in (0.0, 0.3, 1.0, 100.0)]
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == index.view_count
