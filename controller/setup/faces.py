"""Faces that a recipe excludes from the inspection, found by their names."""

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from controller.cad import Face, Feature
from controller.config import ConfigError, Recipe, line_in

MAX_ALIKE: Final = 4  # faces of a diameter that a message names
_RUN = re.compile(r"f(\d{1,6}) to f(\d{1,6})")


def faces_left_out(
    path: Path, recipe: Recipe, faces: Sequence[Face], features: Sequence[Feature]
) -> dict[int, str]:
    """Return the faces that a recipe excludes from inspection: the reason of each, by face id.

    A name is a face's number (``F12``), a range of numbers (``F12 to F15``), a label (``F12 bore
    8.0 mm``), or a label without its number, which means all such faces (``bore 8.0 mm``,
    ``torus``). Planes are named by number. A feature's label (``slot 8.0 x 20.0 mm, 4.0 mm deep``)
    means its faces.

    Parameters
    ----------
    path : path of the recipe, or of what holds it, for the message
    recipe : its `inspection.not_inspected` has the names, each with its reason
    faces, features : faces and features of the recipe's part

    Raises
    ------
    ConfigError : no face has this name, or faces of features of two kinds have it; the message
        lists the nearest names, or these faces
    """
    names: dict[str, list[int]] = {}
    for face in faces:
        number, _, kind = face.label.partition(" ")
        for name in (number, face.label) if kind == "plane" else (number, face.label, kind):
            names.setdefault(name.lower(), []).append(face.id)
    for feature in features:
        names.setdefault(feature.label.lower(), []).extend(feature.faces)
    feature_of = _features_by_face(features)
    left_out: dict[int, str] = {}
    problems = []
    for name, reason in recipe.inspection.not_inspected.items():
        wanted = " ".join(name.lower().split())
        if run := _RUN.fullmatch(wanted):
            ids = range(int(run[1]), int(run[2]) + 1)
            if len(ids) > 1 and ids[-1] < len(faces):
                left_out |= dict.fromkeys(ids, reason)
                continue
        if wanted not in names:
            problems.append(_unknown_face(path, name, wanted, names, faces))
        kinds = {feature_of[i].kind: i for i in names.get(wanted, ()) if i in feature_of}
        if len(kinds) > 1:
            alike = [f"F{i} of {feature_of[i].label}" for i in sorted(kinds.values())]
            problems.append(
                f"{_where(path, name)}: `inspection.not_inspected`: {name!r} is "
                f"{' and '.join(alike)}; name each face by its number, as `cellctl compile --json` "
                "lists them"
            )
        left_out |= dict.fromkeys(names.get(wanted, ()), reason)
    if problems:
        raise ConfigError("\n".join(problems))
    return left_out


def _features_by_face(features: Iterable[Feature]) -> dict[int, Feature]:
    """Return the feature of which each face is a wall, by face; the first of several."""
    found: dict[int, Feature] = {}
    for feature in features:
        for face in feature.faces:
            found.setdefault(face, feature)
    return found


def _where(path: Path, name: str) -> str:
    line = line_in(path, ("inspection", "not_inspected", name))
    return f"{path}:{line}" if line is not None else f"{path}"


def _unknown_face(
    path: Path, name: str, wanted: str, names: dict[str, list[int]], faces: Sequence[Face]
) -> str:
    alike = [
        face.label
        for face in faces
        if face.kind == "cylinder" and wanted.endswith(f" {2 * face.radius_mm:.1f} mm")
    ]
    if wanted == "plane":
        hint = "planes are named by number, as in `F3` or `F3 to F9`"
    elif alike:
        hint = f"of this diameter are: {', '.join(alike[:MAX_ALIKE])}"
    else:
        near = difflib.get_close_matches(wanted, names, n=3, cutoff=0.4)
        numbers = [n for n in names if n.startswith("f") and n[1:].isdigit()]
        known = f"the part has F0 to F{len(numbers) - 1}; `cellctl compile` lists them"
        hint = f"nearest: {', '.join(near)}; {known}" if near else known
    return f"{_where(path, name)}: `inspection.not_inspected`: no face {name!r} on the part; {hint}"
