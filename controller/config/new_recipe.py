"""The recipe of a part that nobody has written one for yet."""

import json
import re
from typing import Final

HEAD: Final = """\
# What to inspect and how sharply. Files are named relative to this one and lie in its folder or
# below. `cellctl check` names what is wrong, with file and line.
"""
NOTES: Final = {
    "unit": "of the CAD file, which names none",
    "required": "dimensions without limits of their own: measured where a view shows them",
}
NOTE_COLUMN: Final = 33
PLAIN: Final = re.compile(r"(?!(?i:true|false|null)$)[A-Za-z][A-Za-z0-9_./-]*")  # needs no quotes


def new_recipe(
    name: str,
    part: str,
    *,
    unit: str | None = None,
    density_g_cm3: float | None = None,
    cell: str | None = None,
) -> str:
    """Return the text of a recipe that asks for nothing but the part.

    Parameters
    ----------
    name : of the product, for people
    part : CAD file, relative to the recipe; ``file.step#NAME`` is one body of a file of several
    unit : unit of the file's lengths; None where its format names one
    density_g_cm3 : of the material, if it is known
    cell : cell file, relative to the recipe; None for the default
    """
    lines = {
        "name": _scalar(name),
        "part": _scalar(part),
        "unit": unit,
        "density_g_cm3": density_g_cm3,
        "cell": cell,
        "inspection": "",
        "  required": "stated",
    }
    text = HEAD
    for key, value in lines.items():
        if value is None:
            continue
        line = f"{key}: {value}".rstrip()
        note = NOTES.get(key.strip())
        text += f"{line:{NOTE_COLUMN}}# {note}\n" if note else f"{line}\n"
    return text


def _scalar(text: str) -> str:
    """Return a text as YAML has it, in quotes only where it needs them."""
    return text if PLAIN.fullmatch(text) else json.dumps(text, ensure_ascii=False)
