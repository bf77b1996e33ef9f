"""Results kept on disk are those that would be computed, whatever becomes of the folder."""

import numpy as np
import pytest

from mffdrake.recognition.solid import disk_cache as module
from mffdrake.recognition.solid.disk_cache import cached


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    module.disk_memory.cache_clear()
    yield tmp_path / "cache"
    module.disk_memory.cache_clear()


def square(numbers, calls):
    calls.append(len(numbers))
    return numbers**2


def test_a_result_is_computed_once_for_each_key(folder):
    numbers, calls = np.arange(5.0), []
    for _ in range(3):
        np.testing.assert_array_equal(cached(square, numbers, calls, key=[numbers]), numbers**2)
    assert calls == [5]
    cached(square, numbers, calls, key=[numbers.astype(np.float32)])
    cached(square, numbers, calls, key=[numbers, "told apart"])
    cached(square, numbers, calls, key=[numbers.reshape(1, 5)])
    assert calls == 4 * [5]
    assert list(folder.rglob("*.pkl"))


def test_a_result_is_there_in_the_next_process(folder):
    numbers, calls = np.arange(4.0), []
    cached(square, numbers, calls, key=[numbers])
    module.disk_memory.cache_clear()  # as a new process begins
    cached(square, numbers, calls, key=[numbers])
    assert calls == [4]


@pytest.mark.filterwarnings("ignore:Exception while loading results")
def test_a_damaged_file_is_computed_anew(folder):
    numbers, calls = np.arange(4.0), []
    cached(square, numbers, calls, key=[numbers])
    for path in folder.rglob("*.pkl"):
        path.write_bytes(path.read_bytes()[:20])
    np.testing.assert_array_equal(cached(square, numbers, calls, key=[numbers]), numbers**2)
    assert calls == [4, 4]


def test_where_nothing_can_be_written_it_is_computed_each_time(folder):
    folder.write_text("a file where the folder would be", encoding="utf-8")
    numbers, calls = np.arange(4.0), []
    for _ in range(2):
        np.testing.assert_array_equal(cached(square, numbers, calls, key=[numbers]), numbers**2)
    assert calls == [4, 4]


def test_results_of_other_code_are_not_taken(folder, monkeypatch):
    numbers, calls = np.arange(4.0), []
    cached(square, numbers, calls, key=[numbers])
    monkeypatch.setattr(module, "code_hash", lambda: "another hash")
    cached(square, numbers, calls, key=[numbers])
    assert calls == [4, 4]
