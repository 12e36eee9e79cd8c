"""Whole files or none, and messages in three parts."""

from __future__ import annotations

import json
import os
import stat

import pytest

from fresnel_decomp import InputError
from fresnel_decomp._check import choose, input_error
from fresnel_decomp._files import replacing, writable_folder, write_json, write_text


def listing(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_finished_file_replaces_the_old_one(tmp_path):
    target = tmp_path / "a.txt"
    target.write_text("old")
    with replacing(target) as temporary:
        assert (temporary.parent, temporary.suffix) == (tmp_path, ".txt")
        assert temporary.name.startswith(".a")  # hidden while it grows
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert listing(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, SystemExit])
@pytest.mark.parametrize("existing", [True, False])
def test_an_interrupted_write_leaves_nothing_behind(tmp_path, error, existing):
    target = tmp_path / "a.txt"
    if existing:
        target.write_text("old")

    def interrupted():
        with replacing(target) as temporary:
            temporary.write_text("half of the n")
            raise error

    with pytest.raises(InputError if error is OSError else error):  # a disk is full: said plainly
        interrupted()
    assert listing(tmp_path) == (["a.txt"] if existing else [])
    if existing:
        assert target.read_text() == "old"


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_permissions_follow_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        write_text(tmp_path / "a.txt", "x")
        assert os.umask(umask) == umask  # and the umask is as it was
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o666 & ~umask


def test_text_and_json(tmp_path):
    write_text(tmp_path / "a.txt", "θ → µm\n")
    assert (tmp_path / "a.txt").read_bytes() == "θ → µm\n".encode()
    value = {"θ": [1.0, 0.1, 1e-300], "none": None}
    write_json(tmp_path / "a.json", value)
    text = (tmp_path / "a.json").read_text(encoding="utf-8")
    assert json.loads(text) == value
    assert "θ" in text
    assert text.endswith("}\n")
    for bad in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="Out of range float"):
            write_json(tmp_path / "a.json", {"x": bad})
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == value
    assert listing(tmp_path) == ["a.json", "a.txt"]


def test_writable_folder(tmp_path):
    folder = writable_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert writable_folder(str(folder)) == folder
    assert listing(folder) == []
    file = tmp_path / "file"
    file.write_text("x")
    for path in (file, file / "below"):
        with pytest.raises(
            InputError, match=r"cannot write to folder '.*file.*; accepted: a folder.*--out"
        ):
            writable_folder(path)
    assert file.read_text() == "x"


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_unwritable_folder(tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(InputError, match="Permission denied"):
            writable_folder(tmp_path)
    finally:
        tmp_path.chmod(0o700)


def test_messages_have_three_parts():
    error = input_error("x=3", "1 or 2", "Take 2.")
    assert str(error) == "x=3; accepted: 1 or 2. Take 2."
    assert isinstance(error, ValueError)


def test_choose():
    options = ["exact", "schlick", "f82"]
    assert choose("model", "f82", options) == "f82"
    with pytest.raises(InputError) as caught:
        choose("model", "schlik", iter(options))
    assert str(caught.value) == (
        "model='schlik' is unknown; accepted: 'exact', 'schlick', 'f82'. Did you mean 'schlick'?"
    )
    with pytest.raises(InputError, match=r"model=3 is unknown.*Choose one of these\.$"):
        choose("model", 3, options)
