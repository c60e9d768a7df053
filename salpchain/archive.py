"""Raw results of a study as one file: FOLDER/raw.tar.xz, with its checksum in FOLDER/SHA256SUMS.

Run folders and tests are hundreds of small files that nobody reads one by one. The archive holds
all files in the sub-folders of FOLDER, but reports, weights and what can be made again. The same
files give the same bytes, and `sha256sum --check SHA256SUMS` checks them anywhere.
"""

import hashlib
import io
import lzma
import tarfile
from pathlib import Path, PurePosixPath

from salpchain.errors import InputError
from salpchain.files import StrPath, write_bytes, writing

ARCHIVE = "raw.tar.xz"
SUMS = "SHA256SUMS"
LEFT_OUT = {"report", "tensorboard", "logs", "cache"}  # folders
LEFT_OUT_FILES = ("*.safetensors", "evaluation.csv", ".*")

Files = dict[str, bytes]  # by path in the folder, with slashes


def pack(folder: StrPath) -> int:
    """Writes the archive of a folder, whose files stay; returns how many it holds.

    Raises:
        InputError: nothing is there to pack, or an archive holds what the folder does not.
        OSError: a file cannot be read or written.
    """
    folder, archive = Path(folder), Path(folder) / ARCHIVE
    files = _loose(folder)
    if not files:
        raise InputError(f"{folder} has no raw results to pack: no files in folders below it")
    content = _archive_of(files)
    with writing(archive):
        if archive.exists() and archive.read_bytes() != content:
            _check_kept(folder, files)
        write_bytes(archive, content)
        write_bytes(folder / SUMS, _sums_of(content))
    return len(files)


def unpack(folder: StrPath) -> int:
    """Writes the files of a folder's archive that are not there; returns how many.

    Raises:
        InputError: there is no archive, it is damaged, or a file that is there has other content;
            then nothing is written.
        OSError: a file cannot be read or written.
    """
    folder = Path(folder)
    missing = {
        name: content
        for name, content in _read(folder).items()
        if _is_missing(folder, name, content)
    }
    for name, content in missing.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_bytes(folder / name, content)
    return len(missing)


def restore(folder: StrPath) -> int:
    """`unpack` of a folder that has an archive; 0 of one that has none."""
    return unpack(folder) if (Path(folder) / ARCHIVE).exists() else 0


def check(folder: StrPath) -> tuple[int, int]:
    """How many files the archive of a folder holds, and how many of them are unpacked.

    Raises:
        As `unpack`.
    """
    files = _read(Path(folder))
    missing = [_is_missing(Path(folder), name, content) for name, content in files.items()]
    return len(files), len(files) - sum(missing)


def _loose(folder: Path) -> Files:
    """The files that belong into the archive."""
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}")
    paths = {path.relative_to(folder): path for path in folder.glob("*/**/*") if path.is_file()}
    return {
        name.as_posix(): path.read_bytes()
        for name, path in paths.items()
        if not LEFT_OUT & set(name.parts) and not any(map(name.match, LEFT_OUT_FILES))
    }


def _archive_of(files: Files) -> bytes:
    """A tar file with neither times nor owners, compressed."""
    plain = io.BytesIO()
    with tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as tar:
        for name in sorted(files):
            entry = tarfile.TarInfo(name)
            entry.size = len(files[name])
            tar.addfile(entry, io.BytesIO(files[name]))
    return lzma.compress(plain.getvalue(), preset=9 | lzma.PRESET_EXTREME)


def _sums_of(archive: bytes) -> bytes:
    """The line that `sha256sum` writes and checks."""
    return f"{hashlib.sha256(archive).hexdigest()}  {ARCHIVE}\n".encode()


def _read(folder: Path) -> Files:
    """The content of the archive, after its checksum."""
    path = folder / ARCHIVE
    try:
        content, sums = path.read_bytes(), (folder / SUMS).read_bytes()
    except FileNotFoundError as error:
        raise InputError(f"no such file: {error.filename}") from None
    if sums.split() != _sums_of(content).split():
        raise InputError(f"{path} is damaged: its checksum is not the one in {folder / SUMS}")
    try:
        return _members(content)
    except (lzma.LZMAError, tarfile.TarError, EOFError, ValueError) as error:
        raise InputError(f"{path} is damaged ({error})") from None


def _members(content: bytes) -> Files:
    files = {}
    with tarfile.open(fileobj=io.BytesIO(lzma.decompress(content))) as tar:
        for member in tar:
            file = tar.extractfile(member)
            name = PurePosixPath(member.name)
            if file is None or name.is_absolute() or ".." in name.parts or len(name.parts) < 2:
                raise ValueError(f"{member.name!r} is no file in a folder of it")
            files[member.name] = file.read()
    return files


def _is_missing(folder: Path, name: str, content: bytes) -> bool:
    """Whether a file of the archive is not in the folder; raises if it is, with other content."""
    path = folder / name
    if not path.exists():
        return True
    if path.is_dir() or path.read_bytes() != content:
        raise InputError(f"{path} is not as in {folder / ARCHIVE}: move one of them away")
    return False


def _check_kept(folder: Path, files: Files) -> None:
    """Raises InputError if a new archive of these files would lose some of the old one."""
    for name, content in _read(folder).items():
        if files.get(name) != content:
            old = folder / ARCHIVE
            raise InputError(f"{name} of {old} would be lost: unpack it first, or move it away")
