"""Pictures of every frame, as images or as a video."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.recordings.files import WholeFile
from mffdrake.recognition.recordings.image_files import RemoveNumbered, SaveImage

__all__ = ["OVERLAYS", "MakeOverlay", "MakeVideo"]

OVERLAYS = ("images", "video")
"""How frames are drawn: a PNG each, or one MP4."""

Image = NDArray[np.uint8]

_LEAST_RATE, _GREATEST_RATE = 0.1, 500.0  # frames a second that the codec can say


@contextmanager
def MakeOverlay(
    kind: str | None, folder: Path, rate: float
) -> Iterator[Callable[[int, Image], None]]:
    """Collects pictures, as ``overlay/000000.png`` and so on, or as ``overlay.mp4``.

    Args:
        kind: One of `OVERLAYS`; None for no pictures.
        folder: Where to write.
        rate: The video's frames a second, from 0.1 to 500; what is beyond is played at that.

    Yields:
        A function that takes a frame's number and its RGB picture.

    Raises:
        OSError: When they cannot be written.
    """
    if kind == "images":
        (folder / "overlay").mkdir(exist_ok=True)
        RemoveNumbered(folder / "overlay")
        yield lambda frame, view: SaveImage(view, folder / "overlay" / f"{frame:06d}.png")
    elif kind == "video":
        with MakeVideo(folder / "overlay.mp4", rate) as add:
            yield lambda frame, view: add(view)
    else:
        yield lambda frame, view: None


@contextmanager
def MakeVideo(path: Path, rate: float) -> Iterator[Callable[[Image], None]]:
    """A video of pictures of one size, which is there whole in the end.

    Args:
        path: The MP4 file.
        rate: Its frames a second, from 0.1 to 500; what is beyond is played at that.

    Yields:
        A function that takes the next RGB picture; what is odd in its size is padded by a pixel.

    Raises:
        OSError: When it cannot be written.
    """
    import cv2

    writers: list[cv2.VideoWriter] = []
    with WholeFile(path) as part:

        def Add(view: Image) -> None:
            height, width = view.shape[:2]
            even = np.pad(view, ((0, height % 2), (0, width % 2), (0, 0)))  # as the codec wants it
            if not writers:
                code = cv2.VideoWriter.fourcc(*"mp4v")
                size = (even.shape[1], even.shape[0])
                # The codec knows no more than 65535 parts of a second.
                known = round(min(max(rate, _LEAST_RATE), _GREATEST_RATE), 2)
                writers.append(cv2.VideoWriter(str(part), code, known, size))
                if not writers[0].isOpened():
                    raise OSError(f"cannot write a video to {path}")
            writers[0].write(even[:, :, ::-1].copy())

        try:
            yield Add
        finally:
            for writer in writers:
                writer.release()
        if writers and not _IsWhole(part):  # The writer does not say so.
            raise OSError(f"cannot write a video to {path}: it is cut short; is the disk full?")


def _IsWhole(path: Path) -> bool:
    """Whether an MP4 file's boxes, the index among them, fill it to its end."""
    names, begin, size = set(), 0, path.stat().st_size
    with path.open("rb") as file:
        while begin < size:
            file.seek(begin)
            length, name = struct.unpack(">I4s", file.read(8).ljust(8, b"\0"))
            if length == 1:  # The length needs more room.
                (length,) = struct.unpack(">Q", file.read(8).ljust(8, b"\0"))
            if length < 8:
                return False
            names.add(name)
            begin += length
    return begin == size and b"moov" in names
