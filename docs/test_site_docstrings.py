"""Docstrings of the house as Sphinx reads them: ``pytest docs``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import site_docstrings

WRITTEN = """Move to joints; see `stop`.

As a rule : no entry.

Parameters
----------
q : where to, in the arm's
    own order
low, high : limits

Returns
-------
the joints reached,
all of them

Raises
------
LinkError : no answer
"""

SPREAD = """Move to joints; see `stop`.

As a rule : no entry.

Parameters
----------
q
    where to, in the arm's
    own order
low, high
    limits

Returns the joints reached,
all of them

Raises
------
LinkError
    no answer
"""


def test_descriptions_stand_below_their_names() -> None:
    spread = site_docstrings.spread(WRITTEN.splitlines())
    assert spread == SPREAD.splitlines()
