"""A compiled part, and the certificates of its stable poses, as JSON."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart
from controller.cad.surfaces.features import Feature
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance
from controller.cad.views import LineView
from controller.cell.plans import Certified
from controller.inspection.characteristics import Characteristic
from controller.setup.planner import PlannerSetup

from ..planning.characteristics import characteristic_json
from ..planning.plan_json import certificate_json


def part_json(
    part: CompiledPart, density_g_cm3: float | None, characteristics: Sequence[Characteristic]
) -> dict[str, Any]:
    """Return a compiled part as conventions.md 7 defines it; R are nested row-major lists.

    Parameters
    ----------
    part : compiled
    density_g_cm3 : None for the file's
    characteristics : characteristics to measure on it
    """
    solid, boundary = part.solid, part.solid.boundary
    density = part.density_g_cm3(density_g_cm3)
    return {
        "part": solid.name,
        "content_hash": solid.content_hash,
        "unit": solid.unit,
        "unit_declared": solid.unit_is_declared,
        "size_mm": solid.mesh.extents.tolist(),
        "volume_mm3": solid.volume_mm3,
        "area_mm2": float(solid.mesh.area),
        "centroid_mm": solid.centroid_mm.tolist(),
        "density_g_cm3": density,
        "mass_g": solid.volume_mm3 / 1000 * density,
        "triangles": len(solid.mesh.faces),
        "stable_poses": [
            _pose_json(part, pose, view) for pose, view in zip(part.poses, part.views, strict=True)
        ],
        "faces": [
            {
                "face": f.id,
                "kind": f.kind,
                "label": f.label,
                "area_mm2": f.area_mm2,
                "normal": np.round(f.normal, 6).tolist(),
                "axis": np.round(f.axis, 6).tolist(),
                "centre_mm": f.centre_mm.tolist(),
                "radius_mm": f.radius_mm,
                "concave": f.concave,
                "samples": int(part.sample_counts[f.id]),
            }
            for f in solid.faces
        ],
        "features": [_feature_json(feature) for feature in part.features],
        "tolerances": [_tolerance_json(tolerance) for tolerance in part.tolerances],
        "characteristics": [characteristic_json(c) for c in characteristics],
        "edges": boundary.edge_count,
        "vertices": len(boundary.vertex_ids),
        "loops": len(boundary.first),
        "shells": boundary.shell_count,
        "genus": boundary.genus,
        "euler_defect": part.euler_defect,
        "warnings": list(part.cautions),
    }


def certified_json(certified: Sequence[Certified], setup: PlannerSetup) -> dict[str, Any]:
    """Return the number of grasps, and the certificate of each stable pose.

    Parameters
    ----------
    certified : the certificates
    setup : setup they were made with
    """
    return {
        "grasps": {
            "arm": max((c.arm_grasp_count for c in certified), default=0),
            "fixture": max((c.fixed_grasp_count for c in certified), default=0),
        },
        "certificates": [certificate_json(c.certificate, setup) for c in certified],
    }


def _pose_json(part: CompiledPart, pose: StablePose, view: LineView) -> dict[str, Any]:
    return {
        "index": pose.index,
        "R": pose.R.tolist(),
        "up": pose.R[2].tolist(),
        "probability": pose.probability,
        "drop_probability": pose.drop_probability,
        "tip_energy_mj_per_kg": pose.tip_energy_mj_per_kg,
        "stability_rank": pose.stability_rank,
        "com_height_mm": pose.com_height_mm,
        "rolling": pose.rolling,
        "rocking": pose.rocking,
        "marginal": pose.marginal,
        "same_as": pose.same_as,
        "view": {
            "area_mm2": view.area,
            "perimeter_mm": view.perimeter,
            "loops": len(view.loops),
            "holes": sum(loop.is_hole for loop in view.loops),
            "edges": len(view.edges),
        },
    }


def _feature_json(feature: Feature) -> dict[str, Any]:
    return {
        "kind": feature.kind,
        "label": feature.label,
        "faces": list(feature.faces),
        "diameter_mm": feature.diameter_mm,
        "depth_mm": feature.depth_mm,
        "width_mm": feature.width_mm,
        "length_mm": feature.length_mm,
        "axis": feature.axis.tolist(),
        "position_mm": feature.position_mm.tolist(),
        "through": feature.is_through,
        "concave": feature.is_concave,
        "steps": [asdict(step) for step in feature.steps],
    }


def _tolerance_json(tolerance: Tolerance) -> dict[str, Any]:
    what = {Dimension: "dimension", GeometricTolerance: "geometric", Datum: "datum"}
    return {"tolerance": what[type(tolerance)], **asdict(tolerance)}
