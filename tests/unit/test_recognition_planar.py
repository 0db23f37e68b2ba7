"""Outlines moved in the table plane tell which parts are worth a fit, without fitting any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from recognise_bench import CAMERA, Grey, backlit, library, shape

from controller.recognition import recognise
from controller.recognition.library import Candidate
from controller.recognition.partial import Cluster, predicted_shares

REACH_MM = 5.0


def looked_at(picture: Grey) -> tuple[Cluster, list[Candidate]]:
    """Return the outline in a picture of one thing, and the views that may be it."""
    (trace,) = recognise(picture, CAMERA, library(), "backlit").traces
    return Cluster(trace.region, CAMERA), list(trace.candidates)


def test_the_part_that_is_there_meets_its_outline_from_some_millimetres_off() -> None:
    cluster, candidates = looked_at(backlit(shape(theta_rad=0.3)))
    right = candidates[0]
    assert library().entries[right.part].name == "elbow"
    off = replace(
        right, x_mm=right.x_mm + 2.0, y_mm=right.y_mm - 2.0, theta_rad=right.theta_rad + 0.04
    )
    several = [right, off]
    found, covered = predicted_shares(several, cluster, library(), REACH_MM)
    assert found.min() > 0.98
    assert covered.max() == 0.0


def test_another_part_does_not_meet_an_outline() -> None:
    cluster, candidates = looked_at(backlit(shape(theta_rad=0.3)))
    number = next(k for k, e in enumerate(library().entries) if e.name == "block")
    index = library().index
    view = int(np.flatnonzero(index.part == number)[0])
    block = replace(candidates[0], part=number, pose=int(index.pose[view]))
    assert predicted_shares([block], cluster, library(), REACH_MM)[0][0] < 0.8


def test_what_a_neighbour_touches_is_covered_and_not_missing() -> None:
    alone = shape(theta_rad=0.0)
    cluster, (right, *_) = looked_at(backlit(alone))
    x0, _, x1, y1 = alone.bounds
    bar = shapely.box(x0, y1 - 3.0, x1, y1 + 40.0)  # along one side, in pixels
    (trace,) = recognise(backlit(alone, bar), CAMERA, library(), "backlit").traces
    beside = Cluster(trace.region, CAMERA)
    assert beside.region.area_px > cluster.region.area_px
    (found,), (covered,) = predicted_shares([right], beside, library(), REACH_MM)
    assert covered > 0.15
    assert found + covered == pytest.approx(1.0, abs=0.06)


def test_many_places_are_looked_up_as_single_ones_are() -> None:
    cluster, _ = looked_at(backlit(shape(theta_rad=0.3)))
    rng = np.random.default_rng(5)
    x, y = rng.uniform(-60.0, 60.0, (2, 40, 50))
    direction = np.exp(1j * rng.uniform(0.0, 6.3, x.shape))
    is_open = np.arange(len(cluster.points_px)) % 3 > 0
    far, nearest, state = cluster.map.look(x, y)
    away, agree, is_outside = cluster.map.look_along(
        (x + 1j * y).astype(np.complex64),
        direction.astype(np.complex64),
        cluster.map.own(is_open),
    )
    theirs = cluster.map.normals[nearest] @ np.array([1.0, 1.0j])
    expected = (theirs * direction.conj()).real * is_open[nearest]
    # between two cells single precision may decide otherwise
    same = np.abs(away - far) < 1e-3
    assert same.mean() > 0.999
    assert np.abs(agree - expected)[same].max() < 1e-3
    assert (is_outside == (state == 0))[same].all()
