"""Keeps the runs of sweeps in a database file, each as soon as it is done."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mffdrake.experiment.scenario.scenario import Scenario

__all__ = ["Record", "RecordPath", "RunKey", "RunStore", "StoreError"]

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


_RECORDS = "records"


class StoreError(RuntimeError):
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

    Args:
        scenario: The scenario.
        code: See `CodeFingerprint`.

    Returns:
        A hash of both.

    Example:
        >>> RunKey(Scenario(), "a") == RunKey(Scenario(), "b")
        False
    """
    return hashlib.sha256(f"{code}\n{scenario.fingerprint}".encode()).hexdigest()


def RecordPath(folder: Path, key: str) -> Path:
    """Where a run's frames are kept, in a folder of runs.

    Args:
        folder: The folder.
        key: See `RunKey`.
    """
    return folder / _RECORDS / f"{key[:16]}.npz"


class RunStore:
    """The runs in one file. Several processes may use it at once.

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
                        f"{self._path}: is no store of this version's sweeps; move it away or "
                        "choose another folder with --out"
                    )
                connection.execute(f"PRAGMA application_id = {_APPLICATION_ID}")
                connection.execute(f"PRAGMA user_version = {_VERSION}")
            connection.execute(_TABLE)

    def Get(self, keys: list[str]) -> dict[str, Record]:
        """The runs that are there.

        Args:
            keys: See `RunKey`.

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

    def Put(self, key: str, scenario: str, code: str, record: Record) -> None:
        """Keeps a run, in place of a failed one.

        Args:
            key: See `RunKey`.
            scenario: The complete scenario, as YAML.
            code: See `CodeFingerprint`.
            record: What became of it.

        Raises:
            StoreError: When the file cannot be written.
        """
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
                    connection.execute("ROLLBACK")
                    raise
                connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise StoreError(
                f"{self._path}: cannot be used ({error}); if it is damaged or not a store of "
                "sweeps, move it away or choose another folder with --out"
            ) from error
