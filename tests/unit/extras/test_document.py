"""The scene file under work: comments stay, everything can be undone, nobody's change on the disk is lost."""

import tomllib
from pathlib import Path

import pytest
import tomlkit

from wakeflow.core.errors import SceneError
from wakeflow.core.files import scene_templates
from wakeflow.extras.page.document import SceneDocument, merged
from wakeflow.extras.page.form import addable, first_keys, form_of
from wakeflow.scene import Scene
from wakeflow.scene.schema import described, known_keys

KINDS = [*scene_templates()]


def _opened(kind: str, folder: Path) -> SceneDocument:
    path = folder / f"{kind}.toml"
    path.write_text(scene_templates()[kind].read_text())
    return SceneDocument.load(path)


def _values(document: SceneDocument) -> dict[str, str]:
    """Every value that the form shows, by key."""
    groups = form_of(tomlkit.parse(document.text))
    return {one["key"]: one["value"] for group in groups for one in group["fields"] if one["value"] is not None}


@pytest.mark.parametrize("kind", KINDS)
def test_typing_again_what_is_there_changes_no_letter(kind: str, tmp_path: Path) -> None:
    document = _opened(kind, tmp_path)
    before = document.text
    values = _values(document)
    assert values
    document.set(values)
    assert tomllib.loads(document.text) == tomllib.loads(before)
    assert [line.partition("#")[2] for line in document.text.splitlines()] == [
        line.partition("#")[2] for line in before.splitlines()
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_of_every_table_is_in_the_form(kind: str, tmp_path: Path) -> None:
    document = _opened(kind, tmp_path)
    data = tomlkit.parse(document.text)
    shown = {one["key"] for group in form_of(data) for one in group["fields"]}
    for table, value in tomllib.loads(document.text).items():
        if keys := known_keys(described((table,), data)):
            missing = {f"{table}.{key}" for key in keys} - shown
            assert missing <= {"channel.inlet", "numerics.span", *(f"{table}.{key}" for key in value)}, missing
    given = {one["table"] for one in addable(data)}
    assert {"body", "bin", "fraction"} <= given
    assert given.isdisjoint({"channel", "feed"})


def test_a_comment_stays_in_its_column_and_a_new_key_ends_its_table(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    document.set({"air.speed": "12.5 m/s", "air.density": "1.1"})
    lines = document.text.splitlines()
    assert 'speed = "12.5 m/s"         # mean over the channel' in lines
    assert lines[lines.index("density = 1.1") + 1 :][:2] == ["", "[vibration]                # of the body, vertical"]


def test_tables_are_added_and_taken_out_again(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    before = document.text
    for table in ("body.second", "fraction.husk", "bin.sixth"):
        document.set({f"{table}.{key}": typed for key, typed in first_keys(table, 0.4).items()})
    assert {"second", "husk", "sixth"} <= {name for table in tomllib.loads(document.text).values() for name in table}
    document.set({"body.second": None, "fraction.husk": None, "bin.sixth": None})
    assert document.text == before


def test_what_is_typed_is_read_as_on_the_command_line(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    document.set({"air.speed": "1,5 m/s"})
    with pytest.raises(SceneError) as said:
        Scene.load(scene_templates()["rhombus"], {"air.speed": "1,5 m/s"})
    assert document.look.mistake == str(said.value)
    assert "'1.5 m/s'" in document.look.mistake
    document.write(document.text.replace('"1,5 m/s"', "7 m/s"))
    assert "put quotes round a value with a unit: speed = '7 m/s" in document.look.mistake
    with pytest.raises(SceneError, match="mend it first"):
        document.set({"air.speed": "2 m/s"})


def test_a_forgotten_unit_is_doubted_as_in_a_file(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    document.set({"body.rhombus.width": "50"})
    with pytest.raises(SceneError) as said:
        Scene.load(scene_templates()["rhombus"], {"body.rhombus.width": 50})
    assert document.look.mistake == str(said.value)


def test_everything_can_be_undone_and_a_drag_at_once(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    texts = [document.text]
    document.set({"air.speed": "6 m/s"})
    texts.append(document.text)
    for place in range(60, 80):
        document.set({"bin.middle.to": f'"{place} mm"'}, gesture="drag 1")
    texts.append(document.text)
    document.write(document.text + "# the end\n")
    texts.append(document.text)
    for text in reversed(texts[:-1]):
        document.undo()
        assert document.text == text
    for text in texts[1:]:
        document.redo()
        assert document.text == text


def test_a_file_that_changes_on_the_disk_is_taken_in_and_can_be_undone(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    before = document.text
    assert not document.compare_with_disk()
    other = before.replace("5 m/s", "6 m/s")
    document.path.write_text(other)
    assert document.compare_with_disk()
    assert document.text == other
    assert not document.changed
    document.undo()
    assert document.text == before
    assert document.changed


@pytest.mark.parametrize("keep", [True, False])
def test_of_two_changes_none_is_lost_unasked(keep: bool, tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    document.set({"air.speed": "6 m/s"})
    mine, path = document.text, document.path
    assert path is not None
    theirs = path.read_text().replace("5 m/s", "7 m/s")
    path.write_text(theirs)
    with pytest.raises(SceneError, match="choose which of the two"):
        document.save()
    assert path.read_text() == theirs
    document.settle(keep=keep)
    document.save()
    assert path.read_text() == (mine if keep else theirs)
    document.undo()
    assert keep or document.text == mine


def test_a_file_that_is_gone_is_made_anew_and_a_taken_name_is_refused(tmp_path: Path) -> None:
    document = _opened("rhombus", tmp_path)
    document.path.unlink()
    assert not document.compare_with_disk()
    document.save()
    assert document.path.read_text() == document.text
    with pytest.raises(SceneError, match="exists; choose another name"):
        document.save(_opened("prism", tmp_path).path)


@pytest.mark.parametrize(
    ("mine", "theirs", "both"),
    [
        ("A\nb\nc\nd\n", "a\nb\nC\nd\n", "A\nb\nC\nd\n"),
        ("a\nc\nd\n", "a\nb\nc\nD\n", "a\nc\nD\n"),
        ("x\na\nb\nc\nd\n", "a\nb\nc\nd\ny\n", "x\na\nb\nc\nd\ny\n"),
        ("a\nB\nc\nd\n", "a\nb\nc\nd\n", "a\nB\nc\nd\n"),
        ("a\nB\nc\nd\n", "a\nB\nc\nd\n", "a\nB\nc\nd\n"),
        ("a\nB\nc\nd\n", "a\n!\nc\nd\n", None),
        ("a\nB\nc\nd\n", "a\nb\nC\nd\n", None),
    ],
)
def test_changes_of_other_lines_are_both_kept(mine: str, theirs: str, both: str | None) -> None:
    assert merged("a\nb\nc\nd\n", mine, theirs) == both


def test_a_file_that_is_gone_ends_a_conflict_and_one_too_long_is_not_replaced(tmp_path: Path) -> None:
    document = _opened("vacuum", tmp_path)
    document.write("a = 1\n")
    document.path.write_text("b = 1\n")
    assert document.compare_with_disk()
    assert document.conflict
    document.path.unlink()
    assert document.compare_with_disk()
    assert not document.conflict
    document.save()
    assert document.path.read_text() == "a = 1\n"
    document.path.write_text("#" * 1_000_001)
    assert not document.compare_with_disk()
    with pytest.raises(SceneError, match=r"vacuum.toml: a scene of 1000001 letters"):
        document.save()


def test_a_saved_file_keeps_its_mode_and_its_place_behind_a_link(tmp_path: Path) -> None:
    real = _opened("vacuum", tmp_path).path
    assert real is not None
    real.chmod(0o600)
    (tmp_path / "link.toml").symlink_to(real.name)
    document = SceneDocument.load(tmp_path / "link.toml")
    document.write("a = 1\n")
    document.save()
    assert (tmp_path / "link.toml").is_symlink()
    assert (real.read_text(), real.stat().st_mode & 0o777) == ("a = 1\n", 0o600)
    (tmp_path / "away.toml").symlink_to("nowhere")
    with pytest.raises(SceneError, match="exists; choose another name"):
        document.save(tmp_path / "away.toml")
