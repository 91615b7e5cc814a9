"""Reading and writing of files: atomic writing, locks, archives, hashes, templates, and tables as other programs write them."""

import csv
import errno
import hashlib
import json
import os
import re
import stat
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from flexlab.errors import FlexlabError, StudyError
from flexlab.text import visible

if TYPE_CHECKING:
    from zipfile import ZipFile

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

HAS_LOCKS = fcntl is not None


def is_regular(path: Path) -> bool:
    """Whether there is an ordinary file of this name, not a link, folder, pipe or device."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def check_ordinary(path: Path) -> None:
    """Raise OSError for a folder, a pipe or a device, which could block or never end; links are followed."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is not an ordinary file", str(path))


def read_json(path: Path, largest: int) -> Any:
    """The data in an ordinary JSON file of at most `largest` bytes. Raises OSError, or ValueError for any other file."""
    # A pipe could block, and a link may lead out of the folder.
    if not is_regular(path) or path.stat().st_size > largest:
        raise ValueError("no ordinary file")
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("nested too deeply") from None


class DuplicateField(ValueError):
    """A JSON object names a field twice; the text says which."""


def unique_fields(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object, for `json.loads`. Raises ValueError for a name given twice, as one value would be lost."""
    fields: dict[str, Any] = {}
    for name, value in pairs:
        if name in fields:
            raise DuplicateField(f"the field {visible(name, 60)!r} is given twice in one place")
        fields[name] = value
    return fields


def packed_sizes(archive: "ZipFile") -> dict[str, int]:
    """Name → size, bytes, of each file in an archive. Raises ValueError if one could unpack to more than it says."""
    from zipfile import ZIP_DEFLATED, ZIP_STORED

    for about in archive.infolist():
        # The other methods unpack all of what is read at once: a kilobyte could become gigabytes.
        if about.compress_type not in (ZIP_STORED, ZIP_DEFLATED):
            raise ValueError(f"it is packed by method {about.compress_type}, not by the usual one, deflate")
    return {about.filename: about.file_size for about in archive.infolist()}


def read_packed(archive: "ZipFile", name: str) -> bytes:
    """A file of an archive whose `packed_sizes` are known: no more of it than they say."""
    with archive.open(name) as file:
        return file.read(archive.getinfo(name).file_size)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A draft beside `path` that replaces it atomically when the block ends without an error."""
    draft = _draft_of(path)
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def _draft_of(path: Path) -> Path:
    if not path.name:  # The root, or the working directory.
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    # The file's own name may leave no room for more characters.
    return path.with_name(f".{short_hash(path.name)}-{os.getpid()}-{threading.get_ident()}.draft")


LEFT = 86400.0
"""Time after which a draft that nobody writes to counts as left by a killed process, s."""


def remove_left_drafts(folder: Path) -> None:
    """Remove the drafts that killed processes left in a folder: they are hidden and may be as large as a recording."""
    for draft in folder.glob(f".{DIGITS * '[0-9a-f]'}-*.draft"):
        with suppress(OSError):  # Another process may be removing it too.
            if is_regular(draft) and time.time() - draft.stat().st_mtime > LEFT:
                draft.unlink()


def check_writing(path: Path, suffix: str) -> None:
    """Check before long work that a file can be written afterwards; its name has to end in `suffix`. Raises `StudyError`."""
    if not path.parent.is_dir():
        raise StudyError(f"{path} cannot be written: there is no folder {path.parent}.")
    with writable(path, "choose another file"):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        check_ordinary(path)
        if not path.name.lower().endswith(suffix):  # It could be a recording or a law, and would be lost.
            raise StudyError(f"{path} cannot be written: let its name end in {suffix}.")
        draft = _draft_of(path)
        draft.touch()
        draft.unlink()


@contextmanager
def writing(path: Path, advice: str = "choose another file", kind: type[FlexlabError] = StudyError) -> Iterator[Path]:
    """As `replacing`. Raises `kind`, with a sentence that ends in `advice`, if the file cannot be written."""
    with writable(path, advice, kind):
        if not path.is_dir():
            check_ordinary(path)  # As root, the file would replace /dev/null for all programs.
        with replacing(path) as draft:
            yield draft


@contextmanager
def writable(place: object, advice: str, kind: type[FlexlabError] = StudyError) -> Iterator[None]:
    """Turn an OSError in the block into the error `kind`: a sentence that names `place` and ends in `advice`."""
    try:
        yield
    except OSError as error:
        raise kind(f"{place} cannot be written ({error.strerror or error}): {advice}.") from None


def write_text(path: Path, text: str) -> None:
    """Write a text atomically. Raises `StudyError`."""
    with writing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def make_folder(folder: Path, advice: str = "choose another folder") -> None:
    """Make a folder unless it exists. Raises `StudyError` with a sentence that ends in `advice`."""
    with writable(folder, advice):
        begin_folder(folder)


def begin_folder(folder: Path) -> None:
    """Make a folder and those above it unless they exist. Raises OSError, in plain words if one of them is a file."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise NotADirectoryError(errno.ENOTDIR, "it is not a folder") from None


def lock(file: IO[bytes] | int, attempts: int = 1, shared: bool = False) -> None:
    """Lock an open file or folder until it is closed or its process ends; do nothing unless `HAS_LOCKS`.

    Try `attempts` times, 10 ms apart. Raises OSError; `BlockingIOError` if another process holds the lock each time.
    """
    if fcntl is not None:
        kind = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB
        for _ in range(attempts - 1):
            with suppress(BlockingIOError):
                return fcntl.flock(file, kind)
            time.sleep(0.01)
        fcntl.flock(file, kind)


DIGITS = 16
"""Hexadecimal digits of a hash: two different texts have the same one with a probability of 2⁻⁶⁴."""


def short_hash(text: str) -> str:
    """A hash of a text, `DIGITS` hexadecimal digits."""
    # Lone surrogates, which no file can hold, are refused where a text is read.
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()[:DIGITS]


def filled(template: Path, **values: object) -> str:
    """The text of an HTML template filled with values, which are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    folder = FileSystemLoader(template.parent)
    pages = Environment(loader=folder, autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return pages.get_template(template.name).render(values)


SEPARATORS = ";\t,"
"""Characters that separate columns; without them spaces do."""
REMARK, OF_EXCEL = "#", "sep="
"""Beginnings of lines that are no rows; the second tells Excel the separator."""
_NUMBERS = re.compile(r"[-+−\d.,;eE\s]*\d[-+−\d.,;eE\s]*")
_SPACES = re.compile(r"\s+(?![\[(])")
"""Spaces between columns, but not those between a name and its unit in brackets."""


def separator(line: str) -> str:
    """The character that separates the columns of a line; empty for spaces."""
    most = max(SEPARATORS, key=line.count)
    return most if most in line else ""


def cells(lines: Iterable[str], separated_by: str, strict: bool = False) -> Iterator[list[str]]:
    """The cells of each line. Raises `csv.Error` for broken quotation marks, with `strict` for any that CSV does not allow."""
    if separated_by:
        return csv.reader(lines, delimiter=separated_by, strict=strict)
    return (_SPACES.split(words) if (words := line.strip()) else [] for line in lines)


def table_lines(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """The lines of a table with their numbers, from 1; without empty lines and remarks.

    If it begins with numbers, a remark right above them with as many names comes first: `numpy.savetxt` writes names so.
    """
    above, begun = (0, ""), False
    for number, line in enumerate(lines, 1):
        if line.startswith(REMARK):
            above = number, line.lstrip(REMARK).strip()
        elif line.strip() and not line.startswith(OF_EXCEL):
            if not begun and above[1] and _NUMBERS.fullmatch(line) and _columns(above[1]) == _columns(line):
                yield above
            begun = True
            yield number, line


def _columns(line: str) -> int:
    return len(next(cells([line], separator(line)), []))
