"""Files: whole or absent, linked, read with bounds, TOML of the user's, those that are shipped with the code, and the
user's own folders.
"""

from __future__ import annotations

import atexit
import errno
import gzip
import hashlib
import json
import os
import re
import secrets
import shutil
import stat
import tempfile
import tomllib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any

from .errors import SceneError
from .quantities import QUANTITY

# -- Files that are whole or absent ------------------------------------------------------------------------------------
FULL = errno.ENOSPC, errno.EDQUOT, errno.EFBIG
SHORTENED = 60  # letters of a file's name in that of its draft, which may have 255 bytes
DRAFT = re.compile(r"\..+\.[0-9a-f]{8}\.tmp")


def path_of(given: Path | str, name: str) -> Path:
    """What a caller gives as a path. Raises SceneError, by its ``name``, where it is none."""
    if not isinstance(given, str | os.PathLike):
        raise SceneError(f"{name} = {given!r}: needs a path, not {type(given).__name__}")
    if "\0" in os.fspath(given):
        raise SceneError(f"{name} = {given!r}: no path holds a zero byte")
    return Path(given)


def made_folder(folder: Path) -> Path:
    """The folder for results, made where it is not there. Raises SceneError where it cannot be, where its name is not
    UTF-8 (VTK takes no other), and where a folder in it is a link: what it leads to is not the program's.
    """
    if os.fsencode(folder) != str(folder).encode(errors="replace"):
        raise SceneError(f"--out {folder}: its name is not UTF-8; choose another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        linked = sorted(path for path in folder.iterdir() if path.is_symlink() and path.is_dir())
    except OSError as problem:
        if problem.errno in FULL:  # no mistake of the caller's
            raise
        raise SceneError(f"{folder}: cannot be made, {problem.strerror}; choose another --out") from None
    if linked:
        raise SceneError(f"{folder}: {linked[0].name} is a link to a folder; remove the link or choose another --out")
    return folder


@contextmanager
def atomic_write(path: Path | str, mode: str = "w") -> Iterator[IO[Any]]:
    """Open a temporary neighbour of ``path`` for writing; it takes the name ``path`` only when all went well. Text is
    UTF-8, with a ? for what none of it can say, as a byte of a file's name.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name[:SHORTENED]}.{secrets.token_hex(4)}.tmp")
    handle = os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o666)  # less the user's umask
    try:
        coding = (None, None) if "b" in mode else ("utf-8", "replace")
        with os.fdopen(handle, mode, encoding=coding[0], errors=coding[1]) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(draft, path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


def remove_drafts(folder: Path) -> None:
    """Remove what a killed :func:`atomic_write` left in a folder where nobody else writes at this moment."""
    for path in folder.iterdir() if folder.is_dir() else ():
        if DRAFT.fullmatch(path.name) and path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)


def write_json(path: Path | str, value: Any) -> None:
    """Write ``value`` as indented JSON. Raises ValueError for NaN and infinity: JSON has neither."""
    with atomic_write(path) as stream:
        json.dump(value, stream, indent=2, allow_nan=False)
        stream.write("\n")


# -- Files of the cache shown elsewhere without a second copy on the disk ----------------------------------------------
CANNOT = (errno.EXDEV, errno.EPERM, errno.EMLINK, errno.ENOTSUP, errno.EACCES)  # another disk, or one without links


def link_or_copy(source: Path, target: Path) -> None:
    """Show the file ``source`` as ``target`` too: a hard link, or a copy where the file system has none.

    ``target`` appears whole and replaces what stood there. The two are one file afterwards: replace it, as every writer
    of this package does, and do not change it in place.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = target.with_name(f".{target.name}.tmp")
    draft.unlink(missing_ok=True)
    try:
        try:
            os.link(source, draft)
        except OSError as problem:
            if problem.errno not in CANNOT:
                raise
            shutil.copyfile(source, draft)
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)


# -- Files that are read: none is trusted to be what it should be ------------------------------------------------------
MAX_INPUT = 16_000_000  # bytes of a text that a person writes
MAX_RECORD = 1_000_000_000  # bytes of a file that the program writes
PIECE = 1 << 20  # bytes that are read at a time
MAX_DEPTH = 32  # tables in tables; a scene has six
MAX_KEYS = 80_000  # of all tables together; 300 fractions and 10 000 bins have fewer


def read_whole(path: Path, most: int = MAX_INPUT) -> bytes:
    """The bytes of a file. Raises SceneError, at once, for a device, a pipe and what has more bytes than ``most``, or
    where its disk does not give them; OSError where it cannot be opened.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    try:
        about = os.fstat(handle)
        if stat.S_ISDIR(about.st_mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(about.st_mode):
            raise SceneError(f"{path}: is a device or a pipe; name a file")
        content = bytearray()
        try:
            while len(content) <= most and (part := os.read(handle, PIECE)):
                content += part
        except OSError as problem:  # names no file
            raise SceneError(f"{path}: cannot be read ({problem.strerror}); is its disk damaged or away?") from None
    finally:
        os.close(handle)
    if len(content) > most:
        raise SceneError(
            f"{path}: has more than {most / 1e6:g} MB, which nothing of its kind has; is it the right file?"
        )
    return bytes(content)


def digest_of(path: Path) -> str:
    """sha256 (hex) of a file's bytes. Raises SceneError for a pipe or a device, which may give none."""
    if path.exists() and not path.is_file():
        raise SceneError(f"{path} is no file; move it, or choose another --out")
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_packed(path: Path, most: int = MAX_RECORD) -> bytes:
    """What a file holds that gzip packed. Raises SceneError where it is damaged, or holds more bytes than ``most``."""
    try:
        with gzip.open(path) as stream:
            result = stream.read(most + 1)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        raise SceneError(f"{path} is damaged") from None
    if len(result) > most:
        raise SceneError(f"{path}: unpacks to more than {most / 1e6:g} MB")
    return result


def read_json(path: Path, most: int = MAX_RECORD) -> Any:
    """What a JSON file holds. Raises SceneError where it is damaged, OSError where it cannot be read."""
    return json_of(read_whole(path, most), str(path))


def json_of(content: bytes | str, where: str) -> Any:
    """What a text of JSON holds. Raises SceneError, naming ``where`` it is from, where it is none, or not finite."""
    try:
        return json.loads(content, parse_constant=_refused)
    except (ValueError, RecursionError):  # not UTF-8, no JSON, a number of too many digits; tables in tables
        raise SceneError(f"{where} is damaged") from None


def _refused(constant: str) -> None:
    raise ValueError(constant)


# -- TOML files of the user's ------------------------------------------------------------------------------------------
def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file, in UTF-8 with or without a mark of the byte order at its head.

    Raises SceneError, one line that says how to mend it, where it is no such text; OSError where it cannot be read.
    """
    try:
        text = read_whole(path).decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:  # as half of the bytes of UTF-16 are
        raise SceneError(f"{path}: not UTF-8; save it as UTF-8 in your editor")
    return toml_of(text, str(path))


def toml_of(text: str, where: str) -> dict[str, Any]:
    """The tables of a text of TOML. Raises SceneError, naming ``where`` it is from, where it is none."""
    try:
        result = tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise SceneError(f"{where}: not valid TOML: {problem}{_hint(text, str(problem))}") from None
    except ValueError as problem:  # a number of thousands of digits, a day that there is not
        raise SceneError(f"{where}: not valid TOML: {str(problem).partition(';')[0]}") from None
    except RecursionError:
        raise SceneError(f"{where}: {DEEP}") from None
    check_tables(result, where)
    return result


def check_tables(tables: object, where: str, most: float = MAX_KEYS) -> None:
    """Raise SceneError where tables are deeper in each other than any that mean something, have more keys than any, or
    hold a whole number that TOML does not know: one of more than 64 bits.
    """
    depth, keys, inside = 0, 0, [tables]
    while inside:
        keys += sum(len(item) for item in inside if isinstance(item, dict))
        if keys > most:
            raise SceneError(f"{where}: has more than {most} keys; is it the right file?")
        depth, inside = depth + 1, [part for item in inside for part in _inside(item)]
        if depth > MAX_DEPTH + 1:
            raise SceneError(f"{where}: {DEEP}")
        if long := next((item for item in inside if isinstance(item, int) and item.bit_length() > 63), None):
            raise SceneError(f"{where}: holds a whole number of {long.bit_length()} bits; TOML has 64")


DEEP = f"tables or lists in each other more than {MAX_DEPTH} deep; a scene has six"


def _inside(value: object) -> list[object]:
    return list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []


def _hint(text: str, problem: str) -> str:
    """A hint for the line that is not TOML, as ``speed = 7 m/s`` and ``speed = 1,5`` are not; empty where there is
    none. ``problem``: tomllib's message, which tells the line.
    """
    result, lines = re.search(r"at line (\d+)", problem), text.splitlines()
    line = lines[int(result[1]) - 1] if result and int(result[1]) <= len(lines) else ""
    key, sign, value = (part.strip() for part in line.partition("#")[0].partition("="))
    if "Cannot declare" in problem:
        return "; a table stands twice: rename one"
    if sign and re.fullmatch(r"[-+]?\d+,\d+", value):
        return f"; write a decimal point: {key} = {value.replace(',', '.')}"
    if sign and re.fullmatch(QUANTITY, value):
        return f"; put quotes round a value with a unit: {key} = {value!r}"
    return ""


# -- Files that are shipped beside the code ----------------------------------------------------------------------------
def _cases() -> Path:
    """``cases`` of the repository in an editable install, the copy inside the package in a wheel."""
    inside = Path(__file__).parents[1] / "cases"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "cases"


def scene_templates() -> dict[str, Path]:
    """The shipped scenes by name; files that ask for many scenes of one are none."""
    files = sorted(_cases().glob("*.toml"))
    return {path.stem: path for path in files if not {"sweep", "search"} & tomllib.loads(path.read_text()).keys()}


def case_template() -> Path:
    """The OpenFOAM case that every airflow starts from."""
    return _cases() / "template"


# -- Files of the user that a scene, a sweep or a search names --------------------------------------------------------
def user_path(given: str, base: Path, key: str) -> Path:
    """The path ``given`` under a ``key`` of a file in the folder ``base``: relative to that; ~ is the home of a user.

    Raises SceneError, naming the key, where no file can have that path.
    """
    if "\0" in given:
        raise SceneError(f"{key} = {given!r}: no path holds a zero byte; write it anew")
    try:
        return base / Path(given).expanduser()
    except RuntimeError:
        raise SceneError(f"{key} = {given!r}: no home of that user is known; write the whole path") from None


# -- The user's own folders: compiled kernels, keys of sources, the secret by which the user's work is known -----------
KERNELS = "WAKEFLOW_KERNELS"  # names another folder, which is believed as it is


@cache
def kernel_root() -> Path:
    """The folder of compiled kernels: ``$WAKEFLOW_KERNELS``, else the user's own.

    Numba's index of compiled code is a pickle: who may write it may run code here. So it is never in the cache of
    stages, which may come from others with a folder of results.
    """
    root = Path(os.environ.get(KERNELS) or _user_folder("kernels")).absolute()
    os.environ[KERNELS] = str(root)  # for the processes that compile beside this one, if it is a temporary one
    return root


def key_root() -> Path:
    """The folder of the keys of sources: who may write there may pass stages of other sources off as these."""
    return _user_folder("keys")


def user_secret() -> bytes:
    """What only this user knows: what is signed with it did not come from others."""
    path = _user_folder("seals") / "secret"
    if not path.exists():
        with atomic_write(path, "wb") as stream:
            os.fchmod(stream.fileno(), 0o600)
            stream.write(os.urandom(32))
    return path.read_bytes()


@cache
def _user_folder(name: str) -> Path:
    """A folder in wakeflow/ in the user's own cache (``$XDG_CACHE_HOME`` or ~/.cache); a temporary one where that is
    not writable, not of the user's own, or others may write there.
    """
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        root = home.absolute() / "wakeflow" / name
        root.mkdir(parents=True, exist_ok=True, mode=0o700)
        about = root.stat()
        if about.st_uid == os.geteuid() and not about.st_mode & 0o022 and os.access(root, os.W_OK):
            return root
    except (OSError, RuntimeError):  # no home, or one that cannot be written: all is made once a process
        pass
    root = Path(tempfile.mkdtemp(prefix=f"wakeflow-{name}-"))
    atexit.register(shutil.rmtree, root, ignore_errors=True)
    return root
