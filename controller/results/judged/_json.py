"""A judged part as JSON: schema ``cellctl.result``, version 1.

The schema's number rises when a key changes its meaning or goes; new keys may come without it.
Lengths are mm, angles degrees, areas mm2, `*_fraction` 0..1, times ISO 8601 UTC. Unknown is null.

| key | what |
|---|---|
| `schema`, `schema_version` | ``cellctl.result``, 1 |
| `header` | `part`, `number`, `serial`, `lot`, `operator`, `recipe`, `cad`, `cell` with their `_sha256`, `calibrated`, `calibration`, `software`, `start`, `end`, `part_temperature_c`, `run`, `emulated_devices`; `papers`: `part_number`, `drawing_number`, `revision`, `order_number`, `gauge_id`, those that are known |
| `verdict`, `reasons` | `pass`, `fail`, `indeterminate`, `not evaluated` or `no verdict` |
| `reviews[]` | persons' verdicts, oldest first; the last counts: `at`, `verdict` (accept, reject), `who`, `why`, `machine`, `findings` (by number: real, false_alarm) |
| `decision_rule` | how value and uncertainty become a verdict |
| `covered_fraction`, `covered_U`, `in_sight_fraction`, `claim` | of all surface; the uncertainty (k = 2) of the first; what was looked for |
| `found` | by kind of defect what would have been found with 90 % (docs/operating/verdicts.md) |
| `characteristics[]` | `balloon`, `id`, `kind`, `label`, `unit`, `nominal`, `lower`, `upper`, `source`, `critical`, `measured`, `deviation`, `U` (k = 2), `verdict`, `views`, `reason`, `faces`, `p_part_mm`, `looks[]` (`view`, `lamp`, `measured`, `u` (k = 1), `reason`, `budget`) |
| `findings[]` | `number`, `kind`, `view`, `lamp`, `p_part_mm`, `size_mm`, `area_mm2`, `faces`, `verdict`, `pictures` (view and lamp of each that shows it) |
| `faces[]` | the ledger: `face`, `label`, `area_mm2`, `compared_fraction`, `by_check`, `rest`, `verdict`, `views`, `reason` |
| `views[]` | `view`, `evaluated`, `reason`, `pictures` (files by lamp) |
"""  # noqa: E501 - a table row is one line

from collections.abc import Sequence
from typing import Any, Final

from controller.cell.journal.rows import CharacteristicFields

from ..run import ReviewReport
from ._model import DECISION_RULE, JudgedPart

RESULT_SCHEMA: Final = "cellctl.result"
RESULT_SCHEMA_VERSION: Final = 1


def result_json(judged: JudgedPart) -> dict[str, Any]:
    """Return a judged part as plain JSON values; see the module's table for the schema."""
    header, part, verdict = judged.header, judged.part, judged.part.verdict
    return {
        "schema": RESULT_SCHEMA,
        "schema_version": RESULT_SCHEMA_VERSION,
        "header": {
            "part": header.part,
            "number": header.number,
            "serial": header.serial or None,
            "lot": header.lot or None,
            "operator": header.operator or None,
            "papers": dict(header.papers),
            "recipe": header.recipe or None,
            "recipe_sha256": header.recipe_sha256 or None,
            "cad": header.cad or None,
            "cad_sha256": header.cad_sha256 or None,
            "cell": header.cell or None,
            "cell_sha256": header.cell_sha256 or None,
            "calibrated": {name: date or None for name, date in header.calibrated.items()},
            "calibration": None if header.calibration is None else list(header.calibration),
            "software": dict(header.software),
            "start": header.start.isoformat(),
            "end": header.end.isoformat(),
            "part_temperature_c": header.part_temperature_c,
            "run": header.run_id or None,
            "emulated_devices": list(header.emulated_devices),
        },
        "verdict": judged.verdict,
        "reasons": list(judged.reasons),
        "reviews": reviews_json(part.reviews),
        "decision_rule": DECISION_RULE,
        "covered_fraction": verdict.compared_fraction if verdict else None,
        "covered_U": verdict.compared_U if verdict else None,
        "in_sight_fraction": verdict.in_sight_fraction if verdict else None,
        "claim": (verdict.claim or None) if verdict else None,
        "found": [one.model_dump() for one in (verdict.found if verdict else ())],
        "characteristics": [characteristic_json(c) for c in part.characteristics],
        "findings": [
            {
                "number": f.number,
                "kind": f.kind,
                "view": f.view,
                "lamp": f.lamp,
                "p_part_mm": list(f.p_part_mm),
                "size_mm": f.size_mm,
                "area_mm2": f.area_mm2,
                "faces": list(f.faces),
                "verdict": f.verdict or None,
                "pictures": [list(picture) for picture in f.pictures],
            }
            for f in part.findings
        ],
        "faces": [
            {
                "face": face.face,
                "label": face.label,
                "area_mm2": face.area_mm2,
                "compared_fraction": face.compared_fraction,
                "by_check": dict(face.by_check),
                "rest": dict(face.rest),
                "verdict": face.verdict,
                "views": list(face.views),
                "reason": face.reason,
            }
            for face in (verdict.faces if verdict else ())
        ],
        "views": [
            {
                "view": view.view,
                "evaluated": view.evaluated,
                "reason": view.reason,
                "pictures": dict(view.pictures),
            }
            for view in part.views
        ],
    }


def reviews_json(reviews: Sequence[ReviewReport]) -> list[dict[str, Any]]:
    """Return persons' verdicts as plain JSON values, oldest first."""
    return [
        {
            "at": one.at.isoformat(),
            "verdict": one.verdict,
            "who": one.who,
            "why": one.why,
            "machine": one.machine or None,
            "findings": {str(number): word for number, word in one.findings.items()},
        }
        for one in reviews
    ]


def characteristic_json(c: CharacteristicFields) -> dict[str, Any]:
    """Return a characteristic with its result as plain JSON values."""
    return {
        "balloon": c.balloon,
        "id": c.id,
        "kind": c.kind,
        "label": c.label,
        "unit": c.unit,
        "nominal": c.nominal,
        "lower": c.lower,
        "upper": c.upper,
        "source": c.source,
        "critical": c.is_critical,
        "measured": c.measured,
        "deviation": c.deviation,
        "U": c.U,
        "verdict": c.verdict,
        "views": list(c.views),
        "reason": c.reason,
        "faces": list(c.faces),
        "p_part_mm": [list(p) for p in c.anchors_mm],
        "looks": [
            {
                "view": look.view,
                "lamp": look.lamp,
                "measured": look.measured,
                "u": look.u,
                "reason": look.reason,
                "budget": dict(look.budget),
            }
            for look in c.looks
        ],
    }
