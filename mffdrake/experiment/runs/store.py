"""Keeps runs in a database file, each as soon as it is done, and some frame by frame beside it."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import platform
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mffdrake.experiment.scenario.scenario import Scenario
from mffdrake.experiment.simulation.simulation import SimulationResult
from mffdrake.recognition.parameters import InputError
from mffdrake.systems.arms.models import FindModelsPath

__all__ = [
    "FRAMES_NAME",
    "STORE_NAME",
    "CodeFingerprint",
    "Record",
    "RunKey",
    "RunStore",
    "StoreError",
    "Versions",
]

_APPLICATION_ID = 0x6D666673  # Says in the file's header that it is ours.
_VERSION = 1
_PATIENCE = 60.0  # s; how long to wait for another process that writes
_TABLE = """
CREATE TABLE IF NOT EXISTS runs (
    key TEXT PRIMARY KEY,      -- see RunKey
    scenario TEXT NOT NULL,    -- YAML
    code TEXT NOT NULL,        -- see CodeFingerprint
    status TEXT NOT NULL,      -- done or failed
    row TEXT,                  -- of Evaluate, as JSON
    error TEXT,
    attempts INTEGER NOT NULL
)
"""
# What is done stays done: another sweep's failure does not take it back.
_PUT = """
INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?, ?)
ON CONFLICT (key) DO UPDATE SET
    status = excluded.status, row = excluded.row, error = excluded.error,
    attempts = excluded.attempts
WHERE runs.status <> 'done'
"""

_PACKAGES = ("mffdrake", "drake", "numpy", "numba")

STORE_NAME = "runs.sqlite"
"""The file in a folder of results that keeps the runs."""

FRAMES_NAME = "records"
"""The folder beside it that keeps runs frame by frame."""


def Versions() -> dict[str, str]:
    """Versions of what the numbers depend on."""
    return {"python": platform.python_version(), **{name: version(name) for name in _PACKAGES}}


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


class StoreError(InputError, RuntimeError):
    """The database file cannot be used; the message names it and says what helps."""


@dataclass(frozen=True, kw_only=True)
class Record:
    """What is known of a run that has ended.

    Attributes:
        row: Its row of `Evaluate`; None where it failed.
        error: Why it failed; None where it did not.
        attempts: How often it was begun.
    """

    row: dict[str, Any] | None = None
    error: str | None = None
    attempts: int = 1

    @property
    def status(self) -> str:
        """``done`` or ``failed``."""
        return "failed" if self.row is None else "done"


def RunKey(scenario: Scenario, code: str) -> str:
    """What a run is found by again.

    Returns:
        A hash of both.

    Example:
        >>> RunKey(Scenario(), "a") == RunKey(Scenario(), "b")
        False
    """
    return hashlib.sha256(f"{code}\n{scenario.fingerprint}".encode()).hexdigest()


class RunStore:
    """The runs in one file, their frames in a folder beside. Several processes may use it at once.

    Every run is written in a transaction of its own, so that the end of the process at any time
    costs nothing that was there before.

    Args:
        path: The file, which is made where there is none.

    Raises:
        StoreError: When it is something else or damaged.

    Example:
        >>> import tempfile
        >>> store = RunStore(Path(tempfile.mkdtemp()) / "runs.sqlite")
        >>> store.Put("k", "seed: 1", "code", Record(row={"frames": 4}))
        >>> store.Get(["k", "another"])["k"].row
        {'frames': 4}
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        with self._Transaction() as connection:
            mark = connection.execute("PRAGMA application_id").fetchone()[0]
            version = connection.execute("PRAGMA user_version").fetchone()[0]
            empty = not connection.execute("SELECT 1 FROM sqlite_master").fetchone()
            if (mark, version) != (_APPLICATION_ID, _VERSION):
                if not empty or mark or version:
                    raise StoreError(
                        f"{self._path}: is no store of this version's runs; move it away or "
                        "choose another folder with --out"
                    )
                connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                connection.execute(f"PRAGMA user_version = {_VERSION}")
            connection.execute(_TABLE)

    def Get(self, keys: list[str]) -> dict[str, Record]:
        """The runs that are there.

        Returns:
            Their records by key, without those that are not there.

        Raises:
            StoreError: When the file is damaged.
        """
        records = {}
        with self._Transaction() as connection:
            for key in keys:
                found = connection.execute(
                    "SELECT row, error, attempts FROM runs WHERE key = ?", (key,)
                ).fetchone()
                if found:
                    row = None if found[0] is None else json.loads(found[0])
                    records[key] = Record(row=row, error=found[1], attempts=found[2])
        return records

    def CountOthers(self) -> int:
        """How many runs are there that other code has run, and which are of no use to this one.

        Raises:
            StoreError: When the file is damaged.
        """
        with self._Transaction() as connection:
            query = "SELECT COUNT(*) FROM runs WHERE code <> ?"
            return int(connection.execute(query, (CodeFingerprint(),)).fetchone()[0])

    def Frames(self, key: str) -> SimulationResult | None:
        """A run's frames; None where they are not kept, or damaged."""
        with contextlib.suppress(OSError, ValueError):
            return SimulationResult.Load(self._FramesPath(key))
        return None

    def _FramesPath(self, key: str) -> Path:
        return self._path.parent / FRAMES_NAME / f"{key[:16]}.npz"

    def Put(
        self,
        key: str,
        scenario: str,
        code: str,
        record: Record,
        frames: SimulationResult | None = None,
    ) -> None:
        """Keeps a run, in place of a failed one.

        Args:
            key: See `RunKey`.
            scenario: The complete scenario, as YAML.
            code: See `CodeFingerprint`.
            record: What became of it.
            frames: Its frames, which go to a file of their own, where they are to be kept.

        Raises:
            StoreError: When the file cannot be written.
            OSError: When the frames cannot.
        """
        if frames is not None:  # Before the row, which says that nothing is missing.
            path = self._FramesPath(key)
            path.parent.mkdir(exist_ok=True)
            frames.Save(path)
        row = None if record.row is None else json.dumps(record.row)
        with self._Transaction() as connection:
            values = (key, scenario, code, record.status, row, record.error, record.attempts)
            connection.execute(_PUT, values)

    @contextmanager
    def _Transaction(self) -> Iterator[sqlite3.Connection]:
        """A connection of its own each time costs a millisecond, and holds on to nothing."""
        try:
            with closing(
                sqlite3.connect(self._path, timeout=_PATIENCE, isolation_level=None)
            ) as connection:
                connection.execute("BEGIN IMMEDIATE")
                try:
                    yield connection
                except BaseException:
                    with contextlib.suppress(sqlite3.Error):  # Where the disk is full, it has been.
                        connection.execute("ROLLBACK")
                    raise
                connection.execute("COMMIT")
        except sqlite3.Error as error:
            help = (
                "make room; the same command goes on from here"
                if error.sqlite_errorcode == sqlite3.SQLITE_FULL
                else "if it is damaged or not a store of runs, move it away or choose another "
                "folder with --out"
            )
            raise StoreError(f"{self._path}: cannot be used ({error}); {help}") from error
