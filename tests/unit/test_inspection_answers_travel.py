"""What is found out of a part comes back from the worker process: it must survive the journey."""

import pickle
from dataclasses import replace

import numpy as np

from controller.inspection import Verdict
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    Look,
    Measured,
    Rim,
    RimGeometry,
)

RIM = Rim(
    centre_mm=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), radius_mm=4.0,
    start=np.array([1.0, 0.0, 0.0]), sweep_rad=2 * np.pi, wall=1, beyond=0, is_hole=True,
)  # fmt: skip
HOLE = Characteristic(
    "hole 8 mm diameter", 1, CharacteristicKind.DIAMETER, "hole 8 mm", 8.0, 7.8, 8.2,
    "ISO 2768-m", RimGeometry((RIM,)), (1,),
)  # fmt: skip


def test_a_measured_characteristic_travels_between_processes() -> None:
    look = Look("v00", "backlit", 8.01, 0.01)
    measured = Measured(
        HOLE, 8.01, 0.02, Verdict.PASS, ("v00",), "", (look, replace(look, budget={"lens": 0.01}))
    )
    back = pickle.loads(pickle.dumps(measured))
    assert (back.measured_mm, back.U_mm, back.verdict) == (8.01, 0.02, Verdict.PASS)
    assert [dict(one.budget) for one in back.looks] == [{}, {"lens": 0.01}]
