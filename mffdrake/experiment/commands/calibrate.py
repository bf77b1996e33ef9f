"""What ``mffdrake calibrate`` does."""

from __future__ import annotations

import argparse
from typing import Any

__all__ = ["AddCalibrate", "RunCalibrate"]


def AddCalibrate(commands: Any) -> None:
    pass


def RunCalibrate(options: argparse.Namespace) -> int:
    return 0
