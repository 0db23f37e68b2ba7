"""A gauge study as a dated file with the hashes of its sources, and the reading of such files."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from ..pages import write_page
from ..statistics import Interval
from ..statistics.nested import NestedStudy
from ._reference import Reference
from ._study import CharacteristicGauge
from ._words import said_of, said_of_all

SCHEMA: Final = "cellctl.gauge/1"
FOLDER: Final = "gauge"  # folder below the folder of runs
MAX_BYTES: Final = 64 * 2**20


@dataclass(frozen=True, slots=True)
class StudySources:
    """The sources of a study.

    Attributes
    ----------
    at : date, UTC
    part, cad_sha256 : the product, and its CAD file
    software : versions by name
    inputs : each reading: its source, part, start pose, grasp, and SHA-256 of files or rows by name
    references : values known from elsewhere
    remarks : assumptions made
    """

    at: datetime
    part: str
    cad_sha256: str
    software: Mapping[str, str]
    inputs: Sequence[Mapping[str, Any]]
    references: Sequence[Reference]
    remarks: Sequence[str]


@dataclass(frozen=True, slots=True)
class KeptStudy:
    """A study found on the disk; `problem` says why it is unreadable, else it is empty.

    Attributes
    ----------
    worst_percent : the largest share of a tolerance; None if there is none
    """

    path: Path
    problem: str = ""
    at: str = ""
    part: str = ""
    reading_count: int = 0
    characteristic_count: int = 0
    worst_percent: float | None = None


def study_json(gauge: CharacteristicGauge) -> dict[str, Any]:
    """Return the study of a characteristic as plain JSON values; lengths in its unit."""
    return {
        "id": gauge.id,
        "label": gauge.label,
        "unit": gauge.unit,
        "nominal": gauge.nominal,
        "lower": gauge.lower,
        "upper": gauge.upper,
        "n": len(gauge.values),
        "missing": gauge.missing,
        "mean": None if gauge.study is None else gauge.study.mean,
        "six_sigma": {
            "in_grasp": _interval(gauge.in_grasp),
            "with_regrasps": _interval(gauge.with_regrasps),
            "gauge": _interval(gauge.gauge),
            "look_to_look_upper_bound": _interval(gauge.look_to_look),
        },
        "grr_percent_of_tolerance": _interval(gauge.tolerance_percent),
        "ndc": gauge.ndc,
        "bias": gauge.bias,
        "U_bias": gauge.U_bias,
        "cg": gauge.cg,
        "cgk": gauge.cgk,
        "variances": _variances(gauge.study),
        "variances_of_looks": _variances(gauge.looks),
        "notes": said_of(gauge),
        "values": [
            {"value": value, "part": part, "start_pose": start, "grasp": grasp, "source": source}
            for value, (part, start, grasp), source in zip(
                gauge.values, gauge.groups, gauge.sources, strict=True
            )
        ],
    }


def write_evidence(
    runs_dir: Path, evidence: StudySources, gauges: Sequence[CharacteristicGauge]
) -> Path:
    """Write a study to a dated file below the folder of runs and return its path.

    Parameters
    ----------
    runs_dir : folder of all runs
    evidence : readings it was made of
    gauges : results

    Raises
    ------
    OSError : the file cannot be written
    """
    body = {
        "schema": SCHEMA,
        "at": evidence.at.isoformat(),
        "part": evidence.part,
        "cad_sha256": evidence.cad_sha256,
        "software": dict(evidence.software),
        "inputs": [dict(one) for one in evidence.inputs],
        "references": [
            {"characteristic": r.id, "value": r.value, "U": r.U, "part": r.part}
            for r in evidence.references
        ],
        "data_allow": said_of_all(gauges),
        "remarks": list(evidence.remarks),
        "characteristics": [study_json(gauge) for gauge in gauges],
    }
    name = re.sub(r"[^\w.-]", "_", evidence.part)
    path = runs_dir / FOLDER / f"{evidence.at:%Y%m%d-%H%M%S}-{evidence.at.microsecond // 1000:03d}"
    return write_page(
        json.dumps(body, indent=1, ensure_ascii=False), path.with_name(f"{path.name}-{name}.json")
    )


def kept_studies(runs_dir: Path) -> tuple[KeptStudy, ...]:
    """Return the studies kept below a folder of runs, newest first; none is no error."""
    return tuple(_kept(path) for path in sorted((runs_dir / FOLDER).glob("*.json"), reverse=True))


def _kept(path: Path) -> KeptStudy:
    try:
        if path.stat().st_size > MAX_BYTES:
            return KeptStudy(path, "too large to be a gauge study")
        body = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(body, dict) or body.get("schema") != SCHEMA:
            return KeptStudy(path, f"is no gauge study ({SCHEMA})")
        found = body["characteristics"]
        shares = [c["grr_percent_of_tolerance"] for c in found]
        return KeptStudy(
            path,
            "",
            str(body["at"]),
            str(body["part"]),
            len(body["inputs"]),
            len(found),
            max((share["value"] for share in shares if share is not None), default=None),
        )
    except OSError as error:
        return KeptStudy(path, error.strerror or str(error))
    except (ValueError, KeyError, TypeError, RecursionError):
        return KeptStudy(path, "is damaged")


def _interval(found: Interval | None) -> Mapping[str, float] | None:
    if found is None:
        return None
    return {"value": found.value, "lower": found.lower, "upper": found.upper}


def _variances(study: NestedStudy | None) -> list[dict[str, Any]]:
    if study is None:
        return []
    return [
        {
            "levels": list(c.levels),
            "freedom": c.freedom,
            "variance": _interval(c.variance),
        }
        for c in study.components
    ]
