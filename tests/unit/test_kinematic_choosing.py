"""Which pictures to take: compared with sets drawn by chance, and with what the fit then states."""

from __future__ import annotations

import kinematic_cells as cells
import numpy as np
import pytest

from controller.calibration.kinematics import (
    BoardPicture,
    PoseCandidate,
    calibrate_cell,
    choose,
    predicted_picture,
)
from controller.calibration.kinematics.layout import UnknownsLayout

CORNERS = {name: cells.grid(cells.SIDE, cells.SIDE, cells.SQUARE_MM) for name in ("front", "back")}
COUNT = 16


@pytest.fixture(scope="module")
def candidates() -> list[PoseCandidate]:
    rng = np.random.default_rng(11)
    return [
        PoseCandidate(camera, face, "grasp0", q)
        for camera in ("overhead", "inspection")
        for q, face in cells.in_sight(camera, rng, 40)
    ]


def lying(cell: cells.TrueCell) -> list[BoardPicture]:
    return [cell.lying(f"flat{i}", *cells.PLACED[i]) for i in range(4)]


def cov_of(prior: object, cell: cells.TrueCell, taken: list[PoseCandidate]) -> np.ndarray:
    """What the calibration itself states for these configurations, in units of the prior."""
    shown = [
        cell.held(str(i), c.camera, c.face, c.grasp, c.q, float(i)) for i, c in enumerate(taken)
    ]
    fit = calibrate_cell(prior, [*lying(cell), *(p for p in shown if p is not None)])  # type: ignore[arg-type]
    out: np.ndarray = fit.cov / np.outer(fit.layout.std, fit.layout.std)
    return out


def test_a_choice_beats_chance_and_states_what_the_fit_will(
    candidates: list[PoseCandidate],
) -> None:
    prior, cell = cells.prior(), cells.true_cell(21)
    choice = choose(prior, candidates, CORNERS, COUNT, on_table=lying(cell), noise_px=cell.noise_px)
    assert len(set(choice.indices)) == COUNT
    chosen = cov_of(prior, cell, [candidates[i] for i in choice.indices])
    rng = np.random.default_rng(4)
    drawn = [
        cov_of(prior, cell, [candidates[i] for i in rng.permutation(len(candidates))[:COUNT]])
        for _ in range(3)
    ]
    by_chance = np.mean([np.linalg.slogdet(one)[1] for one in drawn])
    assert np.linalg.slogdet(chosen)[1] < by_chance
    layout = UnknownsLayout(prior)
    stated = choice.std / layout.std
    # the cell is not the drawing's, and its joints' noise is measured anew
    assert np.median(np.abs(np.log(stated / np.sqrt(np.diag(chosen))))) < 0.3


def test_gains_only_fall_and_both_cameras_are_looked_at(candidates: list[PoseCandidate]) -> None:
    cell = cells.true_cell(22)
    choice = choose(cells.prior(), candidates, CORNERS, COUNT, on_table=lying(cell))
    assert all(b <= a + 1e-9 for a, b in zip(choice.gain, choice.gain[1:], strict=False))
    assert {candidates[i].camera for i in choice.indices} == {"overhead", "inspection"}
    assert {candidates[i].face for i in choice.indices} == {"front", "back"}


def test_what_shows_no_board_is_never_chosen(candidates: list[PoseCandidate]) -> None:
    away = PoseCandidate("overhead", "front", "grasp0", np.array([1.3, 0.2, 0, -100.0, 0, 0]))
    other = {"front": "back", "back": "front"}
    behind = [PoseCandidate(c.camera, other[c.face], c.grasp, c.q) for c in candidates[:5]]
    layout = UnknownsLayout(cells.prior())
    x = np.zeros(layout.size)
    assert predicted_picture(layout, x, away, CORNERS["front"]) is None
    for one in behind:
        assert predicted_picture(layout, x, one, CORNERS[one.face]) is None
    choice = choose(cells.prior(), [away, *behind, candidates[0]], CORNERS, 5)
    assert choice.indices == (len(behind) + 1,)


def test_no_candidate_gives_an_empty_choice() -> None:
    choice = choose(cells.prior(), [], CORNERS, 5)
    assert choice.indices == ()
    np.testing.assert_allclose(choice.std, UnknownsLayout(cells.prior()).std)
