"""Findings of a part by place, as *Review* has a person decide on them."""

from __future__ import annotations

from typing import Any

from controller.page.review.places import places_of


def finding(number: int, x_mm: float | None, **changes: Any) -> dict[str, Any]:
    at = {"x_mm": x_mm, "y_mm": 0.0, "z_mm": None if x_mm is None else 5.0}
    found = {"number": number, "kind": "chip", "size_mm": 2.0, "verdict": "", "review": ""}
    return {**found, "faces": ["plane +Z"], **at, **changes}


def numbers(*findings: dict[str, Any]) -> list[tuple[int, ...]]:
    return [place.numbers for place in places_of(findings)]


def test_looks_at_one_place_stand_together_and_the_proven_one_tells() -> None:
    found = numbers(finding(1, 0.0), finding(2, 30.0, size_mm=4.0), finding(3, 1.5, verdict="fail"))
    assert found == [(3, 1), (2,)]


def test_what_meets_by_a_third_look_is_one_place() -> None:
    assert numbers(finding(1, 0.0), finding(2, 5.0), finding(3, 2.5)) == [(1, 2, 3)]
    assert numbers(finding(1, 0.0), finding(2, 5.0)) == [(1,), (2,)]


def test_an_edge_out_of_place_is_one_with_what_is_on_a_face_of_it_alone() -> None:
    edge = finding(1, 0.0, kind="missing edge", size_mm=20.0)
    assert numbers(edge, finding(2, 1.0)) == [(1, 2)]
    assert numbers(edge, finding(2, 1.0, faces=["plane -Z"])) == [(1,), (2,)]


def test_a_finding_without_a_place_stands_alone() -> None:
    assert numbers(finding(1, None), finding(2, None), finding(3, 0.0)) == [(1,), (2,), (3,)]


def test_what_a_person_said_of_a_place_is_shown_where_it_is_the_same_of_all() -> None:
    both = [finding(1, 0.0, review="real"), finding(2, 1.0, review="real")]
    (place,) = places_of(both)
    assert place.said == "real"
    (place,) = places_of([both[0], finding(2, 1.0, review="false_alarm")])
    assert place.said == ""
