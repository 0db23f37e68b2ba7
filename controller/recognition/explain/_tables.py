"""The stages of a recognition as tables of the figures behind the answer."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..identification.sighting import Recognition
from ..library import Library
from ..segmentation import Segmentation
from ._facts import ObjectFacts, degrees_text

UNTOLD_RAD = 0.5  # standard deviation above which a turn counts as unknown

Cell = str | int | float | None


@dataclass(frozen=True, slots=True)
class StageTable:
    """One stage.

    Attributes
    ----------
    title : name of its subject
    columns : headings, units in brackets
    decimals : decimals of each column's numbers
    rows : plain values; None where there is nothing to say
    """

    title: str
    columns: tuple[str, ...]
    decimals: tuple[int, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def text_rows(self) -> tuple[tuple[str, ...], ...]:
        """Return the rows as they are printed."""
        return tuple(
            tuple(_told(cell, n) for cell, n in zip(row, self.decimals, strict=True))
            for row in self.rows
        )


def _told(cell: Cell, decimals: int) -> str:
    if cell is None:
        return "-"
    return f"{round(cell, decimals) + 0.0:.{decimals}f}" if isinstance(cell, float) else str(cell)


def stage_tables(
    seen: Recognition, facts: Sequence[ObjectFacts], library: Library
) -> tuple[StageTable, ...]:
    """Return segmentation, then each object's stages in their order.

    Parameters
    ----------
    seen : the result of recognition
    facts : `object_facts` of it
    library : library used for the recognition
    """
    tables = [_segmentation(seen.segmentation), _objects(facts), _survivors(facts, library)]
    for f in facts:
        tables += _stages(f, library)
    return tuple(tables)


def _table(
    title: str, columns: Sequence[tuple[str, int]], rows: Sequence[tuple[Cell, ...]]
) -> StageTable:
    return StageTable(
        title, tuple(name for name, _ in columns), tuple(n for _, n in columns), tuple(rows)
    )


def _segmentation(s: Segmentation) -> StageTable:
    levels = s.levels
    rows: list[tuple[Cell, ...]] = [
        ("lighting", s.lighting),
        ("histogram", "two humps" if s.is_bimodal else "one hump: no threshold from it"),
        ("table's level", f"{levels.ground:.0f} of 255"),
    ]
    if s.lighting == "backlit":
        rows += [
            ("things' level", f"{levels.object:.0f}"),
            ("threshold", f"{levels.threshold:.0f}"),
            ("separation (Ashman's D)", f"{levels.separation:.1f}"),
            ("valley / lower hump", f"{levels.valley:.2f}"),
        ]
    else:
        rows.append(("threshold", "none: under lamps things are found by their borders"))
    rows += [
        ("saturated", f"{100 * levels.saturated_share:.1f} %"),
        ("noise", f"{levels.noise:.1f} levels rms"),
        ("level step", f"{levels.step}"),
        ("things", f"{len(s.regions)}"),
    ]
    rows += [("remark", remark) for remark in s.remarks]
    return _table("segmentation", [("what", 0), ("value", 0)], rows)


def _objects(facts: Sequence[ObjectFacts]) -> StageTable:
    columns = [
        ("object", 0), ("x [mm]", 1), ("y [mm]", 1), ("area [mm2]", 1), ("holes", 0),
        ("cut by edge", 0), ("answer", 0),
    ]  # fmt: skip
    rows = []
    for f in facts:
        s = f.sighting
        rows.append(
            (
                f.number,
                s.x_mm,
                s.y_mm,
                s.area_mm2,
                len(f.trace.region.loops_px) - 1,
                "yes" if f.trace.region.touches_edge else "no",
                s.part or "unknown",
            )
        )
    return _table("objects: size", columns, rows)


def _survivors(facts: Sequence[ObjectFacts], library: Library) -> StageTable:
    columns = [
        ("object", 0), ("views in library", 0), ("poses by outline", 0),
        ("candidates", 0), ("fitted", 0),
    ]  # fmt: skip
    rows = [
        (
            f.number,
            library.index.view_count,
            len({(c.part, c.pose) for c in f.trace.candidates}),
            len(f.trace.candidates),
            len(f.trace.hypotheses),
        )
        for f in facts
    ]
    return _table("library: what survives of it", columns, rows)


def _stages(f: ObjectFacts, library: Library) -> list[StageTable]:
    tables = []
    if f.edgelets is not None:
        tables.append(_grey(f))
    if f.candidates:
        tables.append(_candidates(f, library))
    if f.trace.hypotheses:
        tables += [_hypotheses(f, library), _evidence(f)]
    return [*tables, _decision(f)]


def _grey(f: ObjectFacts) -> StageTable:
    e = f.edgelets
    assert e is not None
    rows: list[tuple[Cell, ...]] = [
        ("pieces of edges", len(e.lengths_mm)),
        ("their length [mm]", float(e.lengths_mm.sum())),
    ]
    return _table(f"object {f.number}: grey edges", [("what", 0), ("value", 0)], rows)


def _candidates(f: ObjectFacts, library: Library) -> StageTable:
    columns = [
        ("part", 0), ("pose", 0), ("turn [deg]", 1), ("overlap", 3), ("distance", 3),
    ]  # fmt: skip
    rows = [
        (
            library.entries[c.part].name,
            c.pose,
            float(np.degrees(c.theta_rad)),
            c.overlap,
            c.distance,
        )
        for c in f.candidates
    ]
    title = f"object {f.number}: candidates by silhouette, best {len(rows)}"
    return _table(title, columns, rows)


def _hypotheses(f: ObjectFacts, library: Library) -> StageTable:
    columns = [
        ("no.", 0), ("part", 0), ("pose", 0), ("x [mm]", 2), ("y [mm]", 2), ("turn [deg]", 2),
        ("from", 0), ("overlap", 3), ("score alone", 3), ("taken", 0),
    ]  # fmt: skip
    rows = [
        (
            number,
            library.entries[h.part].name,
            h.pose,
            float(h.place_mm[0]),
            float(h.place_mm[1]),
            float(np.degrees(h.theta_rad)),
            h.source,
            h.overlap,
            f.scores[number - 1],
            "yes" if number - 1 == f.chosen else "",
        )
        for number, h in enumerate(f.trace.hypotheses, start=1)
    ]
    return _table(f"object {f.number}: fitted hypotheses", columns, rows)


def _evidence(f: ObjectFacts) -> StageTable:
    columns = [
        ("no.", 0), ("outline found", 3), ("seen explained", 3), ("sigma [px]", 2),
        ("inner found", 3), ("inner [mm]", 0), ("inner explained", 3), ("shading", 2),
    ]  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for number, h in enumerate(f.trace.hypotheses, start=1):
        e = h.evidence
        # a silhouette that leaves no choice is enough: then nobody looked inside
        inside: tuple[Cell, ...] = (None,) * 4
        if e.area_mm2 > 0:
            inside = (e.inner, e.inner_mm, e.inner_explained, e.shading)
        rows.append((number, e.outline, e.explained, e.sigma_px, *inside))
    return _table(f"object {f.number}: evidence, shares of 1", columns, rows)


def _decision(f: ObjectFacts) -> StageTable:
    s = f.sighting
    rows: list[tuple[Cell, ...]]
    if s.part is None:
        rows = [
            ("answer", f"unknown object at x {s.x_mm:.1f} mm, y {s.y_mm:.1f} mm"),
            ("score, that it is unknown", f"{s.score:.3f}"),
            ("why", s.reason),
        ]
    else:
        others = "; ".join(
            f"{a.part}, pose {a.pose_index}, {degrees_text(a.theta_rad, 1)} deg"
            for a in s.ambiguous_with
        )
        rows = [
            ("answer", f"{s.part}, stable pose {s.pose_index}"),
            ("place", f"x {s.x_mm:.2f} mm, y {s.y_mm:.2f} mm, +- {s.sigma_mm:.3f} mm"),
            ("turn", turn_text(f)),
            ("score", f"{s.score:.3f}"),
            ("ambiguous with", others or "nothing else"),
            ("edges off their predictions", f"{s.residual_px:.2f} px"),
        ]
    return _table(f"object {f.number}: decision", [("what", 0), ("value", 0)], rows)


def turn_text(f: ObjectFacts) -> str:
    """Return a turn with its standard deviation in words."""
    s = f.sighting
    if s.sigma_rad > UNTOLD_RAD:
        return "any: nothing in the picture shows its turn"
    return f"{degrees_text(s.theta_rad, 2)} deg, +- {degrees_text(s.sigma_rad, 3)} deg"
