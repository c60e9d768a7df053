"""Raw results of studies as one file: whole, the same everywhere; nothing is lost or replaced."""

import hashlib
import io
import lzma
import os
import shutil
import subprocess
import sys
import tarfile

import pytest

from salpchain.archive import ARCHIVE, SUMS, check, pack, restore, unpack
from salpchain.errors import InputError
from studies import archive, program

FILES = {
    "base/seed-0/config.json": b"{}\n",
    "base/seed-0/fixed/evaluation.json": b'{"success": 1}\n',
    "two words/seed-1/metrics.csv": b"a,b\r\n1,2\r\n",
    f"deep/{'x' * 120}/empty": b"",
}
NOT_RAW = [
    "factors.csv",
    "report/report.md",
    "base/seed-0/policy.safetensors",
    "cache/a",
    "b/.lock",
]
NOT_RAW += ["base/seed-0/tensorboard/events", "logs/job-1.txt", "base/seed-0/fixed/evaluation.csv"]


def write(folder, files):
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.fixture
def packed(tmp_path):
    """A folder with its archive alone."""
    write(tmp_path / "loose", FILES)
    pack(tmp_path / "loose")
    folder = tmp_path / "packed"
    folder.mkdir()
    for name in (ARCHIVE, SUMS):
        (tmp_path / "loose" / name).rename(folder / name)
    return folder


def test_what_is_unpacked_is_what_was_packed(packed):
    assert check(packed) == (4, 0)
    assert unpack(packed) == 4
    found = contents(packed)
    assert {name: found[name] for name in found if name not in (ARCHIVE, SUMS)} == FILES
    assert check(packed) == (4, 4)
    assert unpack(packed) == 0


def test_the_same_files_give_the_same_bytes_whenever_and_in_whatever_order(packed, tmp_path):
    write(tmp_path / "again", dict(reversed(FILES.items())))
    for path in (tmp_path / "again").rglob("*"):
        os.utime(path, (1, 1))
        path.chmod(0o700)
    pack(tmp_path / "again")
    for name in (ARCHIVE, SUMS):
        assert (tmp_path / "again" / name).read_bytes() == (packed / name).read_bytes()
    with tarfile.open(packed / ARCHIVE) as tar:
        assert tar.getnames() == sorted(FILES)


def test_weights_caches_reports_and_tables_are_not_packed_and_stay(tmp_path):
    write(tmp_path, FILES | dict.fromkeys(NOT_RAW, b"x"))
    assert pack(tmp_path) == len(FILES)
    assert contents(tmp_path).keys() == {*FILES, *NOT_RAW, ARCHIVE, SUMS}


@pytest.mark.skipif(not shutil.which("sha256sum"), reason="the system has no sha256sum")
def test_the_checksum_is_one_that_other_tools_check(packed):
    done = subprocess.run(["sha256sum", "--check", SUMS], cwd=packed, capture_output=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("at", ["cut", "altered", "empty", "other sums", "no text", "no sums"])
def test_a_damaged_archive_is_one_line_and_nothing_is_written(at, packed):
    path, sums = packed / ARCHIVE, packed / SUMS
    content = path.read_bytes()
    half = len(content) // 2
    altered = content[:half] + bytes([content[half] ^ 1]) + content[half + 1 :]
    match at:
        case "other sums":
            sums.write_text(f"{'0' * 64}  {ARCHIVE}\n")
        case "no text":
            sums.write_bytes(b"\xff\xfe")
        case "no sums":
            sums.unlink()
        case _:
            path.write_bytes({"cut": content[:half], "altered": altered, "empty": b""}[at])
    before = contents(packed)
    line = "no such file: .*SHA256SUMS" if at == "no sums" else r"raw\.tar\.xz is damaged"
    for deed in (unpack, check, restore):
        with pytest.raises(InputError, match=line) as error:
            deed(packed)
        assert "\n" not in str(error.value)
    assert contents(packed) == before


def sealed(folder, content):
    """An archive with a right checksum, of whatever it holds."""
    (folder / ARCHIVE).write_bytes(content)
    (folder / SUMS).write_text(f"{hashlib.sha256(content).hexdigest()}  {ARCHIVE}\n")


@pytest.mark.parametrize(
    "name", ["../../outside/x", "/tmp/outside/x", "a/../../x", "grid.json", "a folder"]
)
def test_an_archive_writes_only_files_in_folders_below(name, packed):
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w") as tar:
        entry = tarfile.TarInfo(name)
        entry.type = tarfile.DIRTYPE if name == "a folder" else tarfile.REGTYPE
        tar.addfile(entry)
    sealed(packed, lzma.compress(plain.getvalue()))
    before = contents(packed.parent)
    with pytest.raises(InputError, match="is damaged"):
        unpack(packed)
    assert contents(packed.parent) == before


@pytest.mark.parametrize("content", [b"not compressed", lzma.compress(b"no tar file" * 100)])
def test_what_is_no_archive_is_one_line(content, packed):
    sealed(packed, content)
    with pytest.raises(InputError, match="is damaged"):
        check(packed)


def test_a_file_that_differs_is_named_and_nothing_is_written(packed):
    write(packed, {"base/seed-0/config.json": b"mine"})
    before = contents(packed)
    for deed in (unpack, check, restore):
        with pytest.raises(InputError, match=r"seed-0.config\.json is not as in .*raw\.tar\.xz"):
            deed(packed)
    assert contents(packed) == before


def test_an_archive_grows_but_loses_nothing(packed):
    archived = (packed / ARCHIVE).read_bytes()
    write(packed, {"base/seed-9/config.json": b"new"})
    with pytest.raises(InputError, match=r"\w+ of .*raw\.tar\.xz would be lost: unpack"):
        pack(packed)
    unpack(packed)
    write(packed, {"base/seed-0/config.json": b"mine"})
    with pytest.raises(InputError, match=r"base/seed-0/config\.json of .* would be lost"):
        pack(packed)
    assert (packed / ARCHIVE).read_bytes() == archived
    write(packed, {"base/seed-0/config.json": b"{}\n"})
    assert pack(packed) == 5
    assert check(packed) == (5, 5)


def test_a_folder_without_an_archive_has_nothing_to_restore(tmp_path):
    assert restore(tmp_path) == restore(tmp_path / "missing") == 0


def said(words, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["archive", *words])
    status = 0
    try:
        program("archive", archive.main, archive.__doc__)
    except SystemExit as end:
        status = end.code
    out, err = capsys.readouterr()
    return status, out.strip(), err.strip()


def test_the_program_packs_checks_and_unpacks(tmp_path, monkeypatch, capsys):
    write(tmp_path, FILES)
    for word, line in (("pack", "4 files packed"), ("check", "4 files, 4 of them unpacked")):
        status, out, _ = said([word, str(tmp_path)], monkeypatch, capsys)
        assert status == 0 and line in out
    (tmp_path / "base/seed-0/config.json").unlink()
    status, out, _ = said(["unpack", str(tmp_path)], monkeypatch, capsys)
    assert status == 0 and "1 files written" in out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ([], "give what to do"),
        (["pack"], "give what to do"),
        (["melt", "."], "give what to do"),
        (["pack", "nowhere"], "no such folder: nowhere"),
        (["pack", "."], "no raw results to pack"),
        (["unpack", "nowhere"], "no such file: nowhere"),
        (["check", "."], "no such file: raw.tar.xz"),
    ],
)
def test_the_program_says_what_is_wrong_in_one_line(words, line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, out, err = said(words, monkeypatch, capsys)
    assert status == 2 and not out
    assert line in err and "\n" not in err
    assert list(tmp_path.iterdir()) == []
