"""What holds for all tests."""

import signal

import pytest


@pytest.fixture(scope="session", autouse=True)
def signals_work():
    """Signals end the processes that tests start, also where this session ignores them.

    A shell's background job ignores Ctrl-C, and what ``nohup`` starts ignores the end of its
    terminal. Processes inherit that, and Python leaves it at that.
    """
    usual = {
        signal.SIGINT: signal.default_int_handler,
        signal.SIGTERM: signal.SIG_DFL,
        signal.SIGHUP: signal.SIG_DFL,
    }
    ignored = [number for number in usual if signal.getsignal(number) is signal.SIG_IGN]
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, usual)
    for number in ignored:
        signal.signal(number, usual[number])
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, before)
