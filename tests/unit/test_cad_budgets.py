"""Large parts and parts of many poses: what is bounded, and what is stated at the bound."""

from __future__ import annotations

import numpy as np
import pytest
from cad_solids import box, solid_of

from controller.cad import find_resting
from controller.cad.compiled.part import CompileOptions, compile_solid
from controller.cad.graph import distinct
from controller.cad.resting import look_alikes, search_look_alikes


@pytest.mark.parametrize("shape", [(0,), (1,), (1000,), (40, 3)])
def test_distinct_values_are_those_of_a_set_in_rising_order(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(5).integers(-20, 20, shape)
    assert distinct(values).tolist() == sorted(set(values.ravel().tolist()))


def test_a_search_that_is_cut_short_has_all_pairs_of_the_likeliest_poses() -> None:
    solid = solid_of(box(40, 30, 20))
    poses = find_resting(solid).poses
    every = {(pair.pose, pair.other) for pair in look_alikes(solid, poses)}
    assert len(every) == 3  # each side of a box looks as the opposite one
    # opposite sides are of equal size and all others are not: one comparison for each pair
    for allowed, pose_count in ((0, 1), (1, 3), (2, 5), (3, 6)):
        found = search_look_alikes(solid, poses, max_compared=allowed)
        assert found.pose_count == pose_count
        assert {(p.pose, p.other) for p in found.pairs} == {
            pair for pair in every if max(pair) < pose_count
        }


def test_a_part_states_which_look_alikes_were_not_worked_out() -> None:
    solid = solid_of(box(40, 30, 20))
    assert not compile_solid(solid).warnings
    options = CompileOptions(max_compared=1)
    part = compile_solid(solid, options, warnings=("The file lacks a date.",))
    first, second = part.warnings
    assert first == "The file lacks a date."
    assert "not worked out beyond the 3 likeliest of 6" in second
    assert second in part.cautions
