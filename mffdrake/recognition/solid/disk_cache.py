"""Results that take long to compute, kept on disk from process to process."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from joblib import Memory

Result = TypeVar("Result")

_MOST_BYTES = 500_000_000


def cached(
    function: Callable[..., Result], *arguments: Any, key: Sequence[str | NDArray[Any]]
) -> Result:
    """What a function returns, from the user's cache folder if it was computed before.

    Where nothing can be written, or read, it is computed.

    Args:
        function: A function of a module of this room, whose results change with nothing but its
            arguments and the room's code.
        arguments: Its arguments.
        key: What tells these arguments from others.

    Example:
        >>> float(cached(np.sqrt, 9.0, key=["an example"]))
        3.0
    """
    digest = hashlib.sha256(f"{code_hash()} {function.__module__}.{function.__name__}".encode())
    for part in key:
        if isinstance(part, str):
            digest.update(part.encode())
        else:
            digest.update(f"{part.dtype} {part.shape}".encode())
            digest.update(np.ascontiguousarray(part).tobytes())
    memory = disk_memory()
    found = memory.cache(_call, ignore=["function", "arguments"], verbose=0)
    name = digest.hexdigest()
    is_new = memory.location is not None and not found.check_call_in_cache(
        name, function, arguments
    )
    result: Result = found(name, function, arguments)
    if is_new:
        memory.reduce_size(bytes_limit=_MOST_BYTES)
    return result


def _call(digest: str, function: Callable[..., Result], arguments: Sequence[Any]) -> Result:
    return function(*arguments)


@functools.cache
def disk_memory() -> Memory:
    """The user's cache folder."""
    import joblib  # Slow to import, and needed for large solids alone.
    import platformdirs

    try:
        return joblib.Memory(platformdirs.user_cache_path("mffdrake"), verbose=0)
    except OSError:
        return joblib.Memory(None, verbose=0)


@functools.cache
def code_hash() -> str:
    """A hash of this room's code, and of what it is compiled by."""
    digest = hashlib.sha256(f"numpy {np.__version__}, numba {version('numba')}".encode())
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
