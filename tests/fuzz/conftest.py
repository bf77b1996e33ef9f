"""Lets the tests import the helper module beside them, `judging`, and counts their cases."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import judging


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Notes how many cases a test tried."""
    before = judging.tried()
    try:
        return (yield)
    finally:
        item.user_properties.append(("cases", judging.tried() - before))


def pytest_terminal_summary(terminalreporter):
    """Tells how many cases ran, where this folder alone is tested (``make fuzz``)."""
    counts = {
        report.nodeid.partition("::")[2]: dict(report.user_properties).get("cases", 0)
        for reports in terminalreporter.stats.values()
        for report in reports
        if getattr(report, "when", "") == "call" and "tests/fuzz/" in report.nodeid
    }
    for name, count in sorted(counts.items()):
        terminalreporter.write_line(f"{count:9d} cases of {name}")
    terminalreporter.write_line(f"{sum(counts.values()):9d} cases in all")
