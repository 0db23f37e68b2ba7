"""The page's *Recipes*: found, changed with a diff, taken in from a file; who may do what."""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from cad_solids import box, mesh_of, rod
from page_bench import ORIGIN, Bench, bench

from controller.config import SHIPPED, ConfigError, load_recipe, yaml_tree
from controller.page import recipes
from controller.page.recipes.editing import NotAsShownError, RecipeChanges, drafted, save
from controller.page.recipes.folder import RecipeFile, RecipeFolder, read_recipe
from controller.page.recipes.noting import NAME
from controller.page.recipes.shown import check_shown, mesh_shown, plan_shown
from controller.page.recipes.taking import UploadStage, take
from controller.page.security import Role
from controller.page.work import Workshop

TEXT = """\
# the first line is a remark
name: "block"                    # quoted, and to stay so
part: parts/block.stl
unit: mm

inspection:
  min_coverage: 0.50             # kept
  characteristics:
    - id: hole 10 mm diameter    # a remark within
      fit: H7
    - id: hole 10 mm position
      upper: 0.2
grasp:
  force_n: 60
"""


@pytest.fixture
def block(tmp_path: Path) -> Path:
    """A project with a recipe of a block of 40 x 30 x 10 mm with a bore of 10 mm."""
    (tmp_path / "parts").mkdir()
    mesh_of(box(40, 30, 10) - rod(5, 20, 64)).export(tmp_path / "parts" / "block.stl")
    path = tmp_path / "block.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return path


def own(path: Path) -> RecipeFile:
    return RecipeFile("project", path)


def changes(path: Path, **more: Any) -> RecipeChanges:
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    return RecipeChanges.model_validate({"sha256": sha256, **more})


def test_a_folders_recipes_are_found_and_other_files_are_none(block: Path) -> None:
    folder = block.parent
    shutil.copy(SHIPPED / "cells" / "emulated.yaml", folder / "cell.yaml")
    (folder / "notes.yaml").write_text("a: 1\n")
    (folder / ".hidden.yaml").write_text(TEXT)
    (folder / "part.csg.yaml").write_text(TEXT)
    (folder / "broken.yaml").write_text("name: [\n")
    found = RecipeFolder(folder).files()
    assert [one.key for one in found if one.is_own] == ["project/block", "project/broken"]
    assert "shipped/holder" in [one.key for one in found if not one.is_own]
    read = [read_recipe(one) for one in found]
    assert [one.file.key for one in read if one.problem] == ["project/broken"]
    assert "broken.yaml:" in read[1].problem


def test_no_key_leads_to_another_file(block: Path) -> None:
    folder = RecipeFolder(block.parent)
    (block.parent / "inner").mkdir()
    shutil.copy(block, block.parent / "inner" / "other.yaml")
    for key in ("project/inner/other", "project/../block", "project/block.yaml", "/etc/passwd"):
        assert folder.find(key) is None


def test_what_was_worked_out_is_old_once_recipe_or_part_has_changed(block: Path) -> None:
    first = read_recipe(own(block)).mark
    assert read_recipe(own(block)).mark == first
    part = block.parent / "parts" / "block.stl"
    mesh_of(box(41, 30, 10)).export(part)
    second = read_recipe(own(block)).mark
    block.write_text(f"{TEXT}# more\n")
    assert len({first, second, read_recipe(own(block)).mark}) == 3


@pytest.mark.parametrize("path", sorted(SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_recipe_without_a_change_stays_as_it_is_to_the_byte(path: Path) -> None:
    draft = drafted(own(path), changes(path))
    assert draft.diff == ()
    assert draft.text.encode() == path.read_bytes()


def test_a_change_leaves_all_other_lines_alone(block: Path) -> None:
    asked = changes(
        block,
        inspection={"min_coverage": 0.7},
        characteristics=[
            {"id": "Hole 10 mm  diameter", "lower": 9.9, "upper": 10.1},
            {"id": "length 40 mm F0 to F1", "ignore": "milled by others"},
        ],
    )
    draft = drafted(own(block), asked)
    old, new = TEXT.splitlines(), draft.text.splitlines()
    removed = [line for line in old if line not in new]
    added = [line for line in new if line not in old]
    assert [line.split("#")[0].strip() for line in removed] == ["min_coverage: 0.50", "fit: H7"]
    assert [line.split("#")[0].strip() for line in added] == [
        "min_coverage: 0.7",
        "lower: 9.9",
        "upper: 10.1",
        "- id: length 40 mm F0 to F1",
        "ignore: milled by others",
    ]
    assert block.read_text() == TEXT
    found = load_recipe(block, draft.text).inspection
    assert [one.id for one in found.characteristics] == [
        "hole 10 mm diameter",
        "hole 10 mm position",
        "length 40 mm F0 to F1",
    ]
    marked = [line[1:] for line in draft.diff if line[0] == "+" and not line.startswith("+++")]
    assert marked == added


def test_a_statement_that_is_taken_back_leaves_nothing_behind(block: Path) -> None:
    asked = changes(
        block,
        characteristics=[
            {"id": "hole 10 mm position", "upper": None},
            {"id": "hole 10 mm diameter", "ignore": "gauged"},
        ],
    )
    draft = drafted(own(block), asked)
    [entry] = yaml_tree(block, draft.text)["inspection"]["characteristics"]
    assert entry == {"id": "hole 10 mm diameter", "ignore": "gauged"}


def test_a_recipe_with_no_section_gets_one_only_for_a_change(block: Path) -> None:
    block.write_text("name: block\npart: parts/block.stl\nunit: mm\n")
    assert drafted(own(block), changes(block)).diff == ()
    draft = drafted(own(block), changes(block, inspection={"required": "stated"}))
    assert yaml_tree(block, draft.text)["inspection"] == {"required": "stated"}


def test_line_ends_stay_those_of_the_file(block: Path) -> None:
    block.write_bytes(TEXT.replace("\n", "\r\n").encode())
    draft = drafted(own(block), changes(block, inspection={"min_coverage": 0.7}))
    assert draft.text.count("\r\n") == draft.text.count("\n") == TEXT.count("\n")
    assert len([line for line in draft.diff if line.startswith("-")]) == 2  # the head, and one


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"inspection": {"min_coverage": 1.7}}, r"block.yaml:7: `inspection.min_coverage`"),
        (
            {"characteristics": [{"id": "hole 10 mm diameter", "lower": 11, "upper": 10}]},
            "above `upper`",
        ),
    ],
)
def test_what_the_model_refuses_is_refused_with_its_message(
    block: Path, asked: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        drafted(own(block), changes(block, **asked))


def test_a_draft_is_written_as_it_was_shown_and_never_otherwise(block: Path) -> None:
    asked = changes(block, inspection={"min_coverage": 0.7})
    draft = drafted(own(block), asked)
    with pytest.raises(NotAsShownError, match="not what was shown"):
        save(own(block), asked, "0" * 64)
    assert block.read_text() == TEXT
    save(own(block), asked, draft.sha256)
    assert block.read_text() == draft.text
    with pytest.raises(NotAsShownError, match="by somebody else"):
        save(own(block), asked, draft.sha256)
    assert block.read_text() == draft.text


def test_a_recipe_that_comes_along_or_is_a_link_is_not_written_to(block: Path) -> None:
    link = block.parent / "link.yaml"
    link.symlink_to(block)
    asked = changes(block, inspection={"min_coverage": 0.7})
    seen = drafted(own(block), asked).sha256
    for file in (RecipeFile("shipped", block), own(link)):
        with pytest.raises(ConfigError):
            save(file, asked, seen)
    assert block.read_text() == TEXT


def test_a_file_that_was_sent_becomes_a_part_and_a_recipe(block: Path, tmp_path: Path) -> None:
    project = tmp_path / "project"
    project.mkdir()
    stage = UploadStage()
    staged = stage.put("new part.stl", block.parent / "parts" / "block.stl")
    staged = staged.with_choice("inch", "")
    path = take(staged, project, "new")
    recipe = load_recipe(path)
    assert (recipe.name, recipe.unit) == ("new", "inch")
    assert recipe.part.read_bytes() == staged.path.read_bytes()
    with pytest.raises(ConfigError, match="is there already"):
        take(staged, project, "new")
    take(staged, project, "another")  # of the same part
    mesh_of(box(1, 2, 3)).export(project / "parts" / "new part.stl")
    with pytest.raises(ConfigError, match="is another file"):
        take(staged, project, "third")
    assert not (project / "third.yaml").exists()
    for name in ("../up", ".hidden", "a.csg", "a/b", "", "x" * 61):
        with pytest.raises(ConfigError, match="letters"):
            take(staged, project, name)
    stage.clear()
    assert not staged.path.exists()


def test_parts_are_not_put_into_a_folder_that_leads_out(block: Path, tmp_path: Path) -> None:
    project, elsewhere = tmp_path / "project", tmp_path / "elsewhere"
    project.mkdir()
    elsewhere.mkdir()
    (project / "parts").symlink_to(elsewhere)
    staged = UploadStage().put("a.stl", block.parent / "parts" / "block.stl")
    with pytest.raises(ConfigError, match="leads out"):
        take(staged, project, "new")
    assert list(elsewhere.iterdir()) == []


def test_a_faces_state_says_how_much_of_it_is_in_sight() -> None:
    shares = [1.0, 0.5, 0.0, 0.5]
    body = {
        "pose": 0,
        "certificates": [],
        "steps": [],
        "forecast_s": 1.0,
        "covered_fraction": 0.5,
        "covered_U": 0.01,
        "reachable_fraction": 1.0,
        "not_inspected": {"0": "why", "3": "because"},
        "samples": {"points_mm": [[0.0, 0.0, float(i)] for i in range(10)]},
        "faces": [
            {"face": i, "label": f"F{i}", "covered_fraction": s} for i, s in enumerate(shares)
        ],
        "unseen": [{"face": 2, "label": "F2", "samples": [3, 5], "reason": "r", "kind": "reach"}],
    }
    found = plan_shown(body)
    states = [face["state"] for face in found["faces"]]
    assert states == ["seen", "partly", "unseen", "left_out"]
    assert found["unseen"][0]["points"] == [[0.0, 0.0, 3.0], [0.0, 0.0, 5.0]]
    none = plan_shown(body | {"error": "no grasp"})
    assert (none["error"], none["faces"]) == ("no grasp", [])


def test_a_mesh_too_large_to_draw_says_so(tmp_path: Path) -> None:
    assert mesh_shown(tmp_path) == {"why": "the mesh is not there"}
    many = {"vertices": [], "triangles": [], "face_of_triangle": [0] * 150_001}
    (tmp_path / "mesh.json").write_text(json.dumps(many))
    assert "150001 triangles" in mesh_shown(tmp_path)["why"]


STAND_IN = """
import json, pathlib, sys
arguments = sys.argv[1:]
if "--drawings" in arguments:
    folder = pathlib.Path(arguments[arguments.index("--drawings") + 1])
    (folder / "pose-0.png").write_bytes(b"a picture")
    (folder / "mesh.json").write_text('{"vertices": [], "triangles": [], "face_of_triangle": []}')
pose = dict(index=0, probability=1.0, R=[], picture="pose-0.png")
posed = [one for one in arguments if "--pose" in one]
print(json.dumps({"pose": posed, "unit": posed, "error": "none", "certificates": [], "steps": [],
                  "part": "<b>", "size_mm": [1, 2, 3], "warnings": [], "features": [],
                  "characteristics": [], "faces": [], "stable_poses": [pose]}))
"""


@pytest.fixture
def page(block: Path) -> Iterator[Bench]:
    """The page of the project, with a stand-in for the commands."""
    shop = Workshop((sys.executable, "-c", STAND_IN))
    with patch.object(recipes, "Workshop", lambda: shop):
        found = bench(block.parent)
    with found.client:
        yield found


def post(page: Bench, path: str, body: object, csrf: str) -> tuple[int, dict[str, Any]]:
    status, text = page.post(f"/recipes/{path}", body, csrf)
    return status, json.loads(text)


def get(page: Bench, path: str) -> Any:
    reply = page.client.get(f"/recipes/{path}")
    assert reply.status_code == 200, reply.text
    return reply.json()


def until_done(page: Bench) -> None:
    for _ in range(1500):
        if get(page, "work")["running"] is None:
            return
        time.sleep(0.02)
    raise AssertionError("the work does not end")


def test_work_is_started_by_an_operator_and_its_result_is_there_for_a_viewer(
    page: Bench, block: Path
) -> None:
    csrf = page.log_in(Role.OPERATOR)
    assert get(page, "facts/project/block")["known"] == {}
    status, body = post(page, "start", {"of": "project/block", "kind": "part"}, csrf)
    assert (status, body["running"]["who"]) == (200, "ada, page")
    until_done(page)
    page.log_in(Role.VIEWER)
    known = get(page, "facts/project/block")["known"]["part"]
    assert (known["state"], known["is_old"]) == ("done", False)
    assert get(page, "part/project/block")["found"]["part"] == "<b>"
    assert get(page, "mesh/project/block")["triangles"] == []
    picture = page.client.get("/recipes/picture/project/block/part/pose-0.png")
    assert (picture.status_code, picture.content) == (200, b"a picture")
    for name in ("mesh.json", "out.jsonl", "..%2Fpose-0.png", "pose-1.png"):
        assert page.client.get(f"/recipes/picture/project/block/part/{name}").status_code == 404
    block.write_text(f"{TEXT}# later\n")
    assert get(page, "facts/project/block")["known"]["part"]["is_old"]


@pytest.mark.parametrize(
    ("kind", "pose", "posed"), [("plan", 2, ["--pose=2"]), ("plan", None, []), ("part", 2, [])]
)
def test_a_plan_may_begin_from_a_pose_that_a_person_chose(
    page: Bench, kind: str, pose: int | None, posed: list[str]
) -> None:
    csrf = page.log_in(Role.OPERATOR)
    body = {"of": "project/block", "kind": kind, "pose": pose}
    assert post(page, "start", body, csrf)[0] == 200
    until_done(page)
    found = get(page, f"{kind}/project/block")["found"]
    assert (found["pose"] if kind == "plan" else found["unit"]) == posed
    assert post(page, "start", {**body, "pose": -1}, csrf)[0] == 422
    assert post(page, "start", {**body, "pose": "--cell"}, csrf)[0] == 422


@pytest.mark.parametrize(
    ("path", "body", "role"),
    [
        ("start", {"of": "project/block", "kind": "part"}, Role.VIEWER),
        ("cancel", {}, Role.VIEWER),
        ("draft", {"of": "project/block", "changes": {"sha256": "0" * 64}}, Role.OPERATOR),
        (
            "save",
            {"of": "project/block", "changes": {"sha256": "0" * 64}, "seen": "0" * 64},
            Role.OPERATOR,
        ),
        ("read-again", {}, Role.OPERATOR),
        ("take", {"name": "x"}, Role.OPERATOR),
    ],
)
def test_nothing_is_done_for_a_lesser_role_or_without_the_pages_token(
    page: Bench, path: str, body: object, role: Role
) -> None:
    csrf = page.log_in(role)
    assert post(page, path, body, csrf)[0] == 403
    page.log_in(Role.ENGINEER)
    assert post(page, path, body, "forged")[0] == 403


def test_a_viewer_and_an_operator_send_no_file(page: Bench) -> None:
    csrf = page.log_in(Role.OPERATOR)
    headers = {"Origin": ORIGIN, "X-CSRF-Token": csrf}
    reply = page.client.post("/recipes/send?name=a.stl", content=b"solid", headers=headers)
    assert reply.status_code == 403


def test_an_engineer_changes_a_recipe_and_it_is_noted_who(page: Bench, block: Path) -> None:
    csrf = page.log_in(Role.ENGINEER)
    facts = get(page, "facts/project/block")
    asked = {
        "of": "project/block",
        "changes": {"sha256": facts["sha256"], "inspection": {"min_coverage": 0.75}},
    }
    status, draft = post(page, "draft", asked, csrf)
    assert status == 200
    assert [line for line in draft["diff"] if line.startswith("+  ")] != []
    assert post(page, "save", {**asked, "seen": "0" * 64}, csrf)[0] == 409
    assert post(page, "save", {**asked, "seen": draft["seen"]}, csrf)[0] == 200
    assert get(page, "facts/project/block")["recipe"]["inspection"]["min_coverage"] == 0.75
    assert post(page, "save", {**asked, "seen": draft["seen"]}, csrf)[0] == 409
    [line] = (block.parent / "runs" / NAME).read_text().splitlines()
    noted = json.loads(line)
    assert (noted["who"], noted["what"]) == ("ada, page", "recipe changed")
    assert noted["before"] == facts["sha256"]
    asked["changes"] = {
        "sha256": get(page, "facts/project/block")["sha256"],
        "inspection": {"min_coverage": 7},
    }
    status, refusal = post(page, "draft", asked, csrf)
    assert status == 422
    assert refusal["error"].startswith("block.yaml:7: `inspection.min_coverage`")


def test_a_shipped_recipe_is_shown_and_not_written(page: Bench) -> None:
    csrf = page.log_in(Role.ENGINEER)
    facts = get(page, "facts/shipped/holder")
    assert not facts["is_own"]
    asked = {
        "of": "shipped/holder",
        "changes": {"sha256": facts["sha256"], "inspection": {"min_coverage": 0.75}},
    }
    _, draft = post(page, "draft", asked, csrf)
    before = (SHIPPED / "holder.yaml").read_bytes()
    status, refusal = post(page, "save", {**asked, "seen": draft["seen"]}, csrf)
    assert (status, "comes with cellctl" in refusal["error"]) == (422, True)
    assert (SHIPPED / "holder.yaml").read_bytes() == before


def test_the_pages_are_there_in_both_languages_and_escape_names(page: Bench, block: Path) -> None:
    page.log_in(Role.ENGINEER)
    (block.parent / "a<b>&c.yaml").write_text(TEXT)
    for language, word in (("en", "Tolerances"), ("de", "Toleranzen")):
        text = page.client.get(f"/recipes/one/project/block?lang={language}").text
        assert word in text
    text = page.client.get("/recipes/one/project/a%3Cb%3E%26c").text
    assert "a<b>" not in text
    assert "a&lt;b&gt;&amp;c" in text
    assert page.client.get("/recipes/one/project/none").status_code == 404
    assert 'id="send"' in page.client.get("/recipes").text
    page.log_in(Role.VIEWER)
    assert 'id="send"' not in page.client.get("/recipes").text
    assert 'id="save"' not in page.client.get("/recipes/one/project/block").text


def test_a_file_is_read_by_the_real_command_and_becomes_a_recipe_that_can_be_checked(
    block: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(block.parent / "cache"))
    found = bench(block.parent)
    with found.client:
        csrf = found.log_in(Role.ENGINEER)
        headers = {"Origin": ORIGIN, "X-CSRF-Token": csrf}
        good = (block.parent / "parts" / "block.stl").read_bytes()

        def send(name: str, content: bytes) -> int:
            reply = found.client.post(
                f"/recipes/send?name={name}", content=content, headers=headers
            )
            until_done(found)
            return reply.status_code

        assert send("rubbish.stl", b"solid rubbish\nfacet") == 200
        refused = get(found, "part/sent/file")
        assert refused["work"]["state"] == "refused"
        assert refused["work"]["messages"][0].startswith("rubbish.stl: ")
        assert post(found, "take", {"name": "rubbish"}, csrf)[0] == 409
        assert send("plate.stl", good) == 200
        part = get(found, "part/sent/file")["found"]
        assert sorted(part["size_mm"]) == pytest.approx([10.0, 30.0, 40.0], abs=0.01)
        assert any(one["id"].startswith("hole 10 mm") for one in part["characteristics"])
        assert len(get(found, "mesh/sent/file")["triangles"]) > 100
        assert post(found, "take", {"name": "plate", "unit": "cm"}, csrf)[0] == 409  # not read so
        assert post(found, "take", {"name": "plate"}, csrf) == (200, {"key": "project/plate"})
    assert load_recipe(block.parent / "plate.yaml").part.read_bytes() == good
    assert check_shown({"ok": True, "problems": [], "poses": [], "characteristics": []})["ok"]
