"""`cellctl replay --wires`: the controller on recorded wires, and the first byte that differs."""

import logging
from contextlib import closing
from pathlib import Path
from typing import Final

from controller.config import ConfigError, find_recipe
from controller.processes import worker_pool
from controller.recorded_wires import (
    Difference,
    Replayed,
    WireFileError,
    WireReader,
    inputs_of,
    replay_wires,
)

from ..terminal.output import emit, print_line, warn

SHOWN_BYTES: Final = 64  # bytes of a row that are shown; a frame's struct is longer


def replay_wire_file(
    path: Path, recipe_path: Path | None, cell_path: Path | None, *, as_json: bool
) -> int:
    """Run the controller on recorded wires and print the differences.

    Parameters
    ----------
    path : file of wires
    recipe_path, cell_path : recipe and cell file of the replay, None for those of the recorded run
    as_json : print JSON lines instead of sentences

    Returns
    -------
    exit code: 0 where every request is the recorded one, else 1

    Raises
    ------
    ConfigError : a file is wrong
    """
    recipe = None if recipe_path is None else find_recipe(recipe_path)
    try:
        with closing(WireReader(path)) as reader, inputs_of(reader) as inputs:
            if recipe is None and cell_path is None:
                for changed in inputs.restored:
                    warn(f"{changed}: changed since the run; the recording's own copy is used")
            # what drivers log once the recording has ended proves nothing
            logging.disable(logging.CRITICAL)
            with worker_pool("controller.cell.compute") as pool:
                found = replay_wires(
                    reader, recipe or inputs.recipe, cell_path or inputs.cell, pool
                )
    except WireFileError as error:
        raise ConfigError(str(error)) from error
    finally:
        logging.disable(logging.NOTSET)
    _print(found, as_json=as_json)
    return 0 if found.difference is None else 1


def _print(found: Replayed, *, as_json: bool) -> None:
    difference = found.difference
    if as_json:
        emit(
            {
                "event": "replayed",
                "requests": found.request_count,
                "end": found.end,
                "recording_is_whole": found.is_whole,
                "difference": None if difference is None else _as_json(difference),
            }
        )
        return
    if difference is None:
        reach = "" if found.is_whole else ", as far as the recording reaches: its run was killed"
        print_line(f"no difference in {found.request_count} requests{reach}")
        return
    row = difference.after_row
    where = "before the journal's first row" if row is None else f"after row {row[0]}, {row[2]}"
    print_line(f"{difference.wire}, at {difference.at_s:.3f} s of cell time, {where}:")
    print_line(f"  recorded: {_hex(difference.recorded, difference.byte)}")
    print_line(f"            {difference.recorded_words}")
    print_line(f"  now:      {_hex(difference.sent, difference.byte)}")
    print_line(f"            {difference.sent_words}")
    print_line(
        f"byte {difference.byte + 1} is the first that differs, after {found.request_count} "
        "requests that are the same"
    )


def _hex(data: bytes | None, first: int) -> str:
    """Return bytes in hex, the first one that differs in brackets."""
    if data is None:
        return "nothing"
    pairs = [f"{byte:02X}" for byte in data]
    if first < len(pairs):
        pairs[first] = f"[{pairs[first]}]"
    begin = max(0, first - SHOWN_BYTES // 2)
    end = begin + SHOWN_BYTES
    before, after = ("... " if begin else ""), (" ..." if end < len(pairs) else "")
    return before + " ".join(pairs[begin:end]) + after


def _as_json(difference: Difference) -> dict[str, object]:
    return {
        "wire": difference.wire,
        "at_s": difference.at_s,
        "byte": difference.byte,
        "recorded": None if difference.recorded is None else difference.recorded.hex(),
        "sent": None if difference.sent is None else difference.sent.hex(),
        "recorded_words": difference.recorded_words,
        "sent_words": difference.sent_words,
        "after_row": difference.after_row,
    }
