"""Times of the benchmarks."""

import statistics
import time


def median_ms(function, count: int) -> float:
    """Median wall time of a call [ms]."""
    times = []
    for _ in range(count):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times)
