"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["MakeOutputFolder", "WholeFile"]


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
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix=f".{path.stem}-", suffix=f".part{path.suffix}"
        )
    except OSError as error:  # Name the file that is wanted, not the temporary one.
        raise type(error)(error.errno, error.strerror, str(path)) from error
    os.close(handle)
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


def MakeOutputFolder(folder: Path | str) -> Path:
    """Makes a folder and checks that files can be written there, before any long work.

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
    return folder
