"""Find the faces of a part that its recipe leaves out of the inspection, by their names."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

from controller.cad import Face
from controller.config import ConfigError, Recipe, line_in

_RUN = re.compile(r"f(\d{1,6}) to f(\d{1,6})")


def faces_left_out(path: Path, recipe: Recipe, faces: Sequence[Face]) -> dict[int, str]:
    """Return which faces of its part a recipe leaves out, by face id, each with the reason.

    A name is a face's number (``F12``), a range of numbers (``F12 to F15``), a label (``F12 bore
    8.0 mm``), or a label without its number, which means all such faces (``bore 8.0 mm``,
    ``torus``). Planes are named by number.

    Parameters
    ----------
    path : of the recipe, or of what holds it, for the message
    recipe : its `inspection.not_inspected` has the names, each with its reason
    faces : of the recipe's part

    Raises
    ------
    ConfigError : no face has this name; the message lists the nearest names
    """
    names: dict[str, list[int]] = {}
    for face in faces:
        number, _, kind = face.label.partition(" ")
        for name in (number, face.label) if kind == "plane" else (number, face.label, kind):
            names.setdefault(name.lower(), []).append(face.id)
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
            problems.append(_unknown_face(path, name, wanted, names))
        left_out |= dict.fromkeys(names.get(wanted, ()), reason)
    if problems:
        raise ConfigError("\n".join(problems))
    return left_out


def _unknown_face(path: Path, name: str, wanted: str, names: dict[str, list[int]]) -> str:
    line = line_in(path, ("inspection", "not_inspected", name))
    where = f"{path}:{line}" if line is not None else f"{path}"
    if wanted == "plane":
        hint = "planes are named by number, as in `F3` or `F3 to F9`"
    else:
        near = difflib.get_close_matches(wanted, names, n=3, cutoff=0.4)
        numbers = [n for n in names if n.startswith("f") and n[1:].isdigit()]
        known = f"the part has F0 to F{len(numbers) - 1}; `cellctl compile` lists them"
        hint = f"nearest: {', '.join(near)}; {known}" if near else known
    return f"{where}: `inspection.not_inspected`: no face {name!r} on the part; {hint}"
