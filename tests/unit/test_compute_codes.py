"""The worker process reads the code of one part, and says where on the part it is."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.printed_codes import Marking, printed
from controller.cell.compute import Job, answers, context
from controller.config import ConfigError
from controller.imaging import transform

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]
ON_FACE_MM = np.array([-20.0, -20.0])  # of the holder's plane with bores: free of them


def job(folder: Path, asked: str) -> Job:
    recipes = folder / "recipes"
    shutil.copytree(ROOT / "recipes", recipes)
    recipe = recipes / "holder.yaml"
    recipe.write_text(recipe.read_text() + f"serial_code: {asked}\n")
    return Job(recipe, recipes / "cells" / "emulated.yaml")


def picture(rng: np.random.Generator) -> NDArray[np.uint8]:
    """The table with a code in the middle of the picture, 4 pixels a module."""
    ground = np.full((1024, 1280), 90, np.uint8)
    marking = Marking(
        "qr", "SN-1", module_px=4.0, tilt_rad=0.0, turn_rad=0.7, ground_grey=90.0,
        mark_grey=20.0, blur_px=0.7, grain=0.0, slope=0.0, dot=0.0,
    )  # fmt: skip
    return printed(rng, marking, ground).image


def lying(part: Job, middle_mm: Array) -> Array:
    """T_world_part with its plane up that is z = 0 in CAD, a point of it in the camera's middle."""
    c = context(part)
    T = np.eye(4)
    T[:3, :3] = np.diag((1.0, -1.0, -1.0))
    T[:3, 3] = 0.0, 0.0, -(c.solid.mesh.vertices @ T[:3, :3].T)[:, 2].min()
    off = transform(T, np.array([(*ON_FACE_MM, 0.0)]))[0]
    T[:2, 3] = middle_mm - off[:2]
    return T


@pytest.mark.parametrize("at", ["part", "beside"])
def test_a_code_on_the_part_is_its_own_and_one_elsewhere_is_beside_it(
    at: str, tmp_path: Path
) -> None:
    asked = job(tmp_path, f"{{code: qr, at: {at}}}")
    image = picture(np.random.default_rng(3))
    camera_mm = context(asked).overhead.position_mm[:2]
    on, off = lying(asked, camera_mm), lying(asked, camera_mm + 95.0)
    seen_on, seen_off = (
        answers.read_codes(asked, (image, image), T, is_held=False) for T in (on, off)
    )
    mine, none = (seen_on, seen_off) if at == "part" else (seen_off, seen_on)
    assert none == ()
    (code,) = pickle.loads(pickle.dumps(mine))  # it comes from another process
    assert (code.text, code.picture) == ("SN-1", 0)
    if at == "beside":
        assert code.corners_mm is None
        return
    # on the face with z = 0, in the middle that was drawn, 21 modules wide
    np.testing.assert_allclose(code.corners_mm[:, 2], 0.0, atol=1e-6)
    np.testing.assert_allclose(code.corners_mm.mean(axis=0)[:2], ON_FACE_MM, atol=0.6)
    width_mm = np.linalg.norm(code.corners_mm[1] - code.corners_mm[0])
    assert width_mm == pytest.approx(21 * 4.0 * 1237.0 / 3571.0, rel=0.05)


def test_another_symbology_than_the_recipe_asks_for_is_not_read(tmp_path: Path) -> None:
    asked = job(tmp_path, "{code: data_matrix}")
    T = lying(asked, context(asked).overhead.position_mm[:2])
    assert answers.read_codes(asked, (picture(np.random.default_rng(3)),), T, is_held=False) == ()


def test_without_the_library_a_recipe_with_a_code_is_refused_before_anything_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = job(tmp_path, "{code: qr}")
    monkeypatch.setattr("controller.cell.compute.job.can_read_codes", lambda: False)
    with pytest.raises(ConfigError, match=r"pip install 'cellctl\[codes\]'"):
        context(asked)
