"""Which code the numbers come from: results of other code must not pass for this one's."""

from __future__ import annotations

import functools
import hashlib
import platform
from importlib.metadata import version
from pathlib import Path

from mffdrake.systems.arms.models import FindModelsPath

__all__ = ["CodeFingerprint"]

_PACKAGES = ("mffdrake", "drake", "numpy", "numba")


@functools.cache
def CodeFingerprint() -> str:
    """All that results depend on besides the scenario, as a line of text.

    Returns:
        The versions of the packages and of Python, and a hash of this package's own source and
        model files, as they were when this process first asked.

    Example:
        >>> CodeFingerprint().split()[0]
        'mffdrake'
    """
    package = Path(__file__).parents[2]
    digest = hashlib.sha256()
    for root, pattern in ((package, "*.py"), (FindModelsPath(), "*")):
        for path in sorted(root.rglob(pattern)):
            if path.is_file():
                content = path.read_bytes()
                digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
                digest.update(content)
    python = ".".join(platform.python_version_tuple()[:2])
    names = [f"{name} {version(name)}" for name in _PACKAGES]
    return ", ".join([*names, f"python {python}", f"files {digest.hexdigest()[:16]}"])
