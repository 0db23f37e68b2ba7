"""How the tests share two cores: whole cells one after the other, everything else beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

HERE = Path(__file__).parent
# each of these starts processes of its own that keep time: two of them at once would only wait
WHOLE_CELLS = ("cell", "cross", "unit/test_emu_world_app.py", "unit/test_emu_camera")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.relative_to(HERE).as_posix().startswith(WHOLE_CELLS):
            item.add_marker(pytest.mark.xdist_group("whole cells"))
