"""Pages for a person to sign: content of a part's three printed pages for the template.

`balloons.py` makes the drawing with balloons, `table.py` the rows of characteristics with deviation
bars, `looks.py` cut-outs with rays and fitted shapes, `covering.py` the part coloured by the
ledger; `sheets.py` combines them.
"""

from .sheets import MAX_LOOKS, PartSheets, look_count, make_sheets

__all__ = ["MAX_LOOKS", "PartSheets", "look_count", "make_sheets"]
