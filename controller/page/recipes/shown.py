"""Output of `cellctl` on a part, a plan and a check, prepared for the browser."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from ..frame.drawn import why_not_drawn

POINT_MAX_COUNT: Final = 20_000  # largest number of surface points that no view shows
WHOLE, NOTHING = 0.995, 0.005  # shares of a face that count as all of it, and as none
PART_KEYS: Final = (
    "part", "unit", "unit_declared", "size_mm", "volume_mm3", "mass_g", "density_g_cm3",
    "triangles", "characteristics", "features", "warnings",
)  # fmt: skip
POSE_KEYS: Final = (
    "index", "probability", "R", "com_height_mm", "rolling", "rocking", "marginal", "same_as",
    "picture", "tip_energy_mj_per_kg",
)  # fmt: skip
STEP_KEYS: Final = (
    "kind", "label", "seconds", "seen_fraction", "new_fraction", "picture", "picture_outside",
    "view_id",
)  # fmt: skip
Body = Mapping[str, Any]


def part_shown(body: Body) -> dict[str, Any]:
    """Return the data of a compiled part for the browser.

    Parameters
    ----------
    body : as `cellctl compile --json` prints it
    """
    return {
        **_only(body, PART_KEYS),
        "poses": [_only(pose, POSE_KEYS) for pose in body["stable_poses"]],
        "faces": [_only(face, ("face", "label", "kind", "area_mm2")) for face in body["faces"]],
    }


def plan_shown(body: Body) -> dict[str, Any]:
    """Return the data of a plan for the browser, or the reason why there is none.

    Parameters
    ----------
    body : as `cellctl plan --json` prints it
    """
    found: dict[str, Any] = {
        "pose": body["pose"],
        "error": body.get("error", ""),
        "certificates": body["certificates"],
        "steps": [_only(step, STEP_KEYS) for step in body["steps"]],
        "faces": [],
        "unseen": [],
    }
    if found["error"]:
        return found
    left_out, hidden = body["not_inspected"], _hidden(body)
    return found | {
        "forecast_s": body["forecast_s"],
        "covered_fraction": body["covered_fraction"],
        "covered_U": body["covered_U"],
        "reachable_fraction": body["reachable_fraction"],
        "faces": [
            {
                **_only(face, ("face", "label", "area_mm2", "covered_fraction", "covered_U")),
                "state": _state(face["covered_fraction"], str(face["face"]) in left_out),
                "left_out": left_out.get(str(face["face"])),
            }
            for face in body["faces"]
        ],
        "unseen": hidden,
    }


def check_shown(body: Body) -> dict[str, Any]:
    """Return the data of a check for the browser.

    Parameters
    ----------
    body : as `cellctl check --json` prints it
    """
    keys = ("balloon", "id", "U_mm", "share_of_tolerance", "capable", "measured", "exempt")
    return {
        "ok": body["ok"],
        "problems": body["problems"],
        "poses": body["poses"],
        "characteristics": [_only(one, keys) for one in body["characteristics"]],
    }


def mesh_shown(folder: Path) -> dict[str, Any]:
    """Return the mesh written by a child process, or the reason why it is not drawn.

    Parameters
    ----------
    folder : folder it was given for its output
    """
    try:
        mesh = json.loads((folder / "mesh.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {"why": "the mesh is not there"}
    why = why_not_drawn(len(mesh["face_of_triangle"]))
    return {"why": why} if why else dict(mesh)


def _state(share: float, is_left_out: bool) -> str:
    if share >= WHOLE:
        return "seen"
    if is_left_out:
        return "left_out"
    return "unseen" if share <= NOTHING else "partly"


def _hidden(body: Body) -> list[dict[str, Any]]:
    """Return the pieces that no view shows, each with some of its points [mm, CAD frame]."""
    points = body["samples"]["points_mm"]
    count = sum(len(piece["samples"]) for piece in body["unseen"])
    each = max(1, -(-count // POINT_MAX_COUNT))
    keys = ("face", "label", "area_fraction", "kind", "reason", "remedy", "not_inspected")
    return [
        {
            **_only(piece, keys),
            "points": [[round(v, 3) for v in points[i]] for i in piece["samples"][::each]],
        }
        for piece in body["unseen"]
    ]


def _only(body: Body, keys: Sequence[str]) -> dict[str, Any]:
    return {key: body[key] for key in keys if key in body}
