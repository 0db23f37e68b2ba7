"""The section `faults` of recipe and cell files: what it takes, and its messages."""

from __future__ import annotations

from pathlib import Path

import pytest
from config_text import CELL_TEXT

from controller.config import ConfigError, load_cell, load_recipe


def cell_with(tmp_path: Path, faults: str) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(f"{CELL_TEXT}\nfaults:\n{faults}", encoding="utf-8")
    return path


def test_a_class_has_a_list_of_actions_and_the_others_keep_theirs(tmp_path: Path) -> None:
    text = "  dropped: [{do: re_pose, times: 4, delay_s: 1.5}, {do: hold}]\n  window: 7\n"
    faults = load_cell(cell_with(tmp_path, text)).faults
    assert [(one.do, one.times, one.delay_s) for one in faults.dropped] == [
        ("re_pose", 4, 1.5),
        ("hold", 1, 0.0),
    ]
    assert faults.window == 7
    assert [one.do for one in faults.grasp_missed] == ["re_pose", "hold"]


def test_a_recipe_without_the_section_leaves_the_cells_policy(tmp_path: Path) -> None:
    (tmp_path / "a.stl").touch()
    path = tmp_path / "a.yaml"
    path.write_text("name: a\npart: a.stl\n")
    assert load_recipe(path).faults is None
    path.write_text("name: a\npart: a.stl\nfaults: {not_seen: [{do: abort}]}\n")
    faults = load_recipe(path).faults
    assert faults is not None
    assert faults.model_fields_set == {"not_seen"}


@pytest.mark.parametrize(
    ("faults", "sentence"),
    [
        ("dropped: [{do: park_part}]", "`park_part` is no action for dropped; possible: re_p"),
        ("camera: [{do: re_pose}, {do: hold}]", "`re_pose` is no action for camera"),
        ("dropped: [{do: re_pose}]", "the last action must end the list: skip_characteristic"),
        ("dropped: []", "the last action must end the list"),
        ("dropped: [{do: hold}, {do: abort}]", "`hold` ends the list; nothing can follow it"),
        ("dropped: [{do: hold, times: 2}]", "`hold` ends the list; it has no `times`"),
        ("droped: [{do: hold}]", "unknown key `faults.droped`; did you mean `dropped`"),
        ("dropped: [{do: re_pos}, {do: hold}]", "faults.dropped.0.do"),
        ("{demote_after: 9, window: 4}", "9 failures do not fit into a window of 4 uses"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_line_and_what_is_possible(
    tmp_path: Path, faults: str, sentence: str
) -> None:
    with pytest.raises(ConfigError) as refused:
        load_cell(cell_with(tmp_path, f"  {faults}\n"))
    assert sentence in str(refused.value)
    assert "cell.yaml:" in str(refused.value)
