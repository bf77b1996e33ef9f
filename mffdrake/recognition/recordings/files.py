"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

__all__ = ["MakeOutputFolder", "WholeFile"]

_PARTS = ".*-????????.part*"  # the temporary names


@contextmanager
def WholeFile(path: Path | str) -> Iterator[Path]:
    """Writes a file under a temporary name and moves it into place when all went well.

    Args:
        path: The file; one that is there already is replaced.

    Yields:
        A path in the same folder, with the same suffix, to write to.

    Raises:
        OSError: When the folder is missing or not writable, or the disk full; it names the file.

    Example:
        >>> folder = Path(tempfile.mkdtemp())
        >>> with WholeFile(folder / "a.txt") as part:
        ...     _ = part.write_text("all of it")
        >>> [p.name for p in folder.iterdir()]
        ['a.txt']
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "is a directory, not a file", str(path))
    try:
        handle, name = _MakePart(path)
    except OSError as error:  # Name the file that is wanted, not the temporary one.
        raise type(error)(error.errno, error.strerror, str(path)) from error
    part = Path(name)
    try:
        yield part
        # The temporary file is private; the result gets the usual permissions.
        umask = os.umask(0)
        os.umask(umask)
        part.chmod(0o666 & ~umask)
        part.replace(path)
    except OSError as error:
        if error.errno is not None and error.filename in (None, name):
            error.filename = str(path)
        raise
    finally:
        part.unlink(missing_ok=True)
        os.close(handle)


def _MakePart(path: Path) -> tuple[int, str]:
    """A new temporary file beside another one, locked for as long as its handle is open."""
    while True:
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}-", suffix=f".part{path.suffix}"
        )
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:  # Such a file system has no locks; then what is left stays, too.
            return handle, name
        if os.fstat(handle).st_nlink:  # Else it was taken for a leftover before it was locked.
            return handle, name
        os.close(handle)


def MakeOutputFolder(folder: Path | str) -> Path:
    """Makes a folder and checks that files can be written there, before any long work.

    What `WholeFile` left there, and in the folders inside, when its process was killed is removed.

    Args:
        folder: The folder.

    Returns:
        Its path.

    Raises:
        OSError: When it cannot be made or written to.

    Example:
        >>> MakeOutputFolder(tempfile.mkdtemp()).is_dir()
        True
    """
    folder = Path(folder)
    if folder.exists() and not folder.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, "is a file, not a directory", str(folder))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise type(error)(error.errno, error.strerror, str(folder)) from error
    _RemoveLeftovers(folder)
    return folder


def _RemoveLeftovers(folder: Path) -> None:
    """Removes temporary files that nobody has locked: their process is gone."""
    for part in [*folder.glob(_PARTS), *folder.glob(f"*/{_PARTS}")]:
        with suppress(OSError):
            handle = os.open(part, os.O_RDWR)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                part.unlink()
            finally:
                os.close(handle)
