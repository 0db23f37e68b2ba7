"""Who answers for a person in an emulated cell: orders go to its control port, in order."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from controller.bring_up import EmulatedPerson, Errand, Person, StepEvidence
from controller.cell.errors import CellError

ERRAND = Errand(
    "lay_board", "Lay the board down.", ({"do": "board", "file": "a.json"}, {"do": "time"})
)


async def served(socket: Path, replies: list[dict[str, object]], errand: Errand) -> list[str]:
    """Return what reaches a port that gives these replies while an errand is done."""
    heard: list[str] = []

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for reply in replies:
            line = await reader.readline()
            if not line:
                break
            heard.append(json.loads(line)["do"])
            writer.write(json.dumps(reply).encode() + b"\n")
            await writer.drain()
        writer.close()

    server = await asyncio.start_unix_server(serve, str(socket))
    async with server:
        evidence = StepEvidence(socket.parent, lambda text: None)
        helper = EmulatedPerson(socket)
        await Person(helper, evidence, helper).have_done(errand)
    assert [(one.text, one.choice, one.who) for one in evidence.answers] == [
        ("Lay the board down.", "yes", "--yes")
    ]
    return heard


async def test_all_orders_of_an_errand_are_given_before_it_counts_as_done(tmp_path: Path) -> None:
    assert await served(tmp_path / "p", [{"ok": True}, {"ok": True}], ERRAND) == ["board", "time"]


async def test_an_order_that_is_refused_names_why(tmp_path: Path) -> None:
    with pytest.raises(CellError, match=r"lay_board: the emulated cell refuses: no such file"):
        await served(tmp_path / "p", [{"ok": False, "error": "no such file"}], ERRAND)


async def test_a_port_that_is_gone_is_named(tmp_path: Path) -> None:
    helper = EmulatedPerson(tmp_path / "gone")
    with pytest.raises(CellError, match=r"lay_board: .*emulated cell"):
        await helper.do(ERRAND)
