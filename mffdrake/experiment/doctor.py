"""What ``mffdrake doctor`` finds: whether this machine has what mffdrake needs, and what helps.

Nothing that may be missing or broken is imported before it is looked at.
"""

from __future__ import annotations

import importlib
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata, version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from packaging.requirements import Requirement

__all__ = ["Diagnose", "Finding", "Report"]

_MODULES = {
    "drake": "pydrake",
    "opencv-python-headless": "cv2",
    "pyyaml": "yaml",
}
"""What a distribution is imported as, where that is another name than its own."""

_GRAPHVIZ = "on Debian or Ubuntu, run: sudo apt-get install graphviz (elsewhere: Graphviz)"


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Args:
        name: The thing.
        value: How it is.
        remedy: What helps, mostly a command; empty where all is well.
        needed: Whether simulations and recognition do not work without it.

    Example:
        >>> Finding("Graphviz", "there is no dot", "sudo apt-get install graphviz", False).mark
        '-'
    """

    name: str
    value: str
    remedy: str = ""
    needed: bool = True

    @property
    def mark(self) -> str:
        """``ok``, ``-`` where something is missing that is not needed, or ``BAD``."""
        if not self.remedy:
            return "ok"
        return "BAD" if self.needed else "-"


def Diagnose() -> list[Finding]:
    """Looks at this machine; where numba's kernels must be compiled yet, that is only told.

    Returns:
        Python, the libraries, the optional extras, graphics, Graphviz, the two cache folders and
        the cores, in this order.

    Example:
        >>> [finding.name for finding in Diagnose()][:1]
        ['Python']
    """
    return [
        _Python(),
        *_Libraries(),
        *_Extras(),
        _Graphics(),
        _Graphviz(),
        _Kernels(),
        _Shapes(),
        _Cores(),
    ]


def Report(findings: Sequence[Finding]) -> str:
    """A line for each finding, with what helps below each problem.

    Example:
        >>> print(Report([Finding("Graphviz", "there is no dot", "install it", False)]))
        -    Graphviz     there is no dot
                            install it
        All that is needed is there.
    """
    width = max(12, *(len(finding.name) for finding in findings))
    lines = []
    for finding in findings:
        lines.append(f"{finding.mark:<5}{finding.name:<{width}} {finding.value}")
        if finding.remedy:
            lines.append(f"{'':<{width + 8}}{finding.remedy}")
    bad = [finding.name for finding in findings if finding.mark == "BAD"]
    end = f"Not well: {', '.join(bad)}." if bad else "All that is needed is there."
    return "\n".join([*lines, end])


def _Python() -> Finding:
    needed = metadata("mffdrake")["Requires-Python"].removeprefix(">=")
    here = ".".join(map(str, sys.version_info[:3]))
    is_new = sys.version_info >= tuple(map(int, needed.split(".")))
    remedy = "" if is_new else f"install Python {needed} or newer, and mffdrake in it"
    return Finding("Python", f"{here} ({sys.executable})", remedy)


def _Libraries() -> Iterator[Finding]:
    """All that the package requires: is it there, new enough, and does it load?"""
    for requirement in _Requirements():
        name, value = requirement.name, _Lack(requirement)
        remedy = f"{sys.executable} -m pip install '{requirement}'" if value else ""
        if not value:
            value = version(name)
            try:
                importlib.import_module(_MODULES.get(name, name.replace("-", "_")))
            except Exception as error:  # Whatever a broken library raises.
                value = f"{value}, but it does not load: {' '.join(str(error).split())}"
                remedy = f"{sys.executable} -m pip install --force-reinstall '{requirement}'"
                if "libglib" in str(error):
                    remedy = "on Debian or Ubuntu, run: sudo apt-get install libglib2.0-0"
        yield Finding(name, value, remedy)


def _Extras() -> Iterator[Finding]:
    """The optional extras of the package."""
    for extra in sorted(metadata("mffdrake").get_all("Provides-Extra") or []):
        lacks = {str(one): lack for one in _Requirements(extra) if (lack := _Lack(one))}
        missing = "; ".join(lacks.values())
        named = " ".join(f"'{one}'" for one in lacks)
        remedy = f"{sys.executable} -m pip install {named}" if lacks else ""
        yield Finding(f"[{extra}]", missing or "there", remedy, needed=False)


def _Requirements(extra: str = "") -> list[Requirement]:
    """What the package needs on this machine: always, or for an extra."""
    from packaging.requirements import Requirement

    stated = map(Requirement, metadata("mffdrake").get_all("Requires-Dist") or [])
    wanted = [
        one
        for one in stated
        if (one.marker is None or one.marker.evaluate({"extra": extra}))
        and ("extra" in str(one.marker)) == bool(extra)
    ]
    for one in wanted:
        one.marker = None  # It has been answered, and pip need not be asked again.
    return wanted


def _Lack(requirement: Requirement) -> str:
    """What is wrong with an installed distribution, without loading it; empty if nothing is."""
    try:
        here = version(requirement.name)
    except PackageNotFoundError:
        return f"{requirement.name} is missing"
    if requirement.specifier.contains(here, prereleases=True):
        return ""
    return f"{requirement.name} is {here}, needed is {requirement.specifier}"


def _Graphics() -> Finding:
    name = "graphics"
    try:
        from mffdrake.systems.rendering.graphics import GraphicsUnavailableError, RequireGraphics
    except ImportError as error:  # A library is missing, which has its own line.
        return Finding(name, f"cannot be tried: {error}", "install the libraries above first")
    try:
        RequireGraphics()
    except GraphicsUnavailableError as error:
        problem, _, remedy = str(error).rpartition("; ")
        return Finding(name, problem, f"{remedy}; or take --renderer flat, which needs no driver")
    return Finding(name, "rendering works")


def _Graphviz() -> Finding:
    dot = shutil.which("dot")
    if dot is None:
        lack = "there is no program dot: no pictures of diagrams (--graphviz)"
        return Finding("Graphviz", lack, _GRAPHVIZ, needed=False)
    return Finding("Graphviz", dot)


def _Kernels() -> Finding:
    """Where numba keeps compiled kernels, and whether it has any."""
    name = "numba cache"
    try:
        from mffdrake.recognition.fitness.kernels import fitness_of_poses
    except ImportError as error:
        return Finding(name, f"cannot be tried: {error}", "install the libraries above first")
    except RuntimeError as error:  # numba finds no folder that it may write to
        lines = " ".join(str(error).split())
        return Finding(name, lines, "name one: export NUMBA_CACHE_DIR=/tmp/numba-cache")
    folder = Path(fitness_of_poses.stats.cache_path)
    python = f"py{sys.version_info[0]}{sys.version_info[1]}"
    if any(folder.glob(f"kernels.fitness_of_poses-*.{python}*.nbi")):
        return Finding(name, f"warm: {folder}")
    return Finding(
        name,
        f"cold: {folder}; the first run compiles for a minute or two",
        "mffdrake run --renderer flat --duration 0.2 --out out/first",
        needed=False,
    )


def _Shapes() -> Finding:
    """Where what was computed of large meshes is kept."""
    name = "mesh cache"
    try:
        import platformdirs
    except ImportError as error:
        return Finding(name, f"cannot be tried: {error}", "install the libraries above first")
    folder = platformdirs.user_cache_path("mffdrake")
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if there.is_dir() and os.access(there, os.W_OK):
        return Finding(name, str(folder))
    lack = f"{folder} cannot be written: large meshes are prepared anew each time"
    return Finding(name, lack, "name another: export XDG_CACHE_HOME=/tmp/cache", needed=False)


def _Cores() -> Finding:
    """How many may be used; where that is less than there are, containers limit it."""
    try:
        import joblib
    except ImportError as error:
        return Finding("cores", f"cannot be counted: {error}", "install the libraries above first")
    return Finding("cores", f"{joblib.cpu_count()} (what sweep and reproduce take by default)")
