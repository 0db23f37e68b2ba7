"""The bridge gives back, while it serves, the memory that results took."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import pytest

from controller.plant import bridge


class NoOrders:
    async def run(self) -> None:
        await asyncio.Event().wait()


def test_free_memory_is_given_back_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def until_twice() -> None:
        twice = asyncio.Event()
        times: list[int] = []

        def noted() -> None:
            times.append(1)
            if len(times) == 2:
                twice.set()

        monkeypatch.setattr(bridge, "TRIM_WALL_S", 0.0)
        monkeypatch.setattr(bridge, "trim", noted)
        serving = asyncio.create_task(
            bridge.serve(cast(Any, None), cast(Any, NoOrders()), wires=(), boxes=())
        )
        async with asyncio.timeout(60):
            await twice.wait()
        serving.cancel()

    asyncio.run(until_twice())
