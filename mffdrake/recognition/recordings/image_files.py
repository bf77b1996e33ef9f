"""Images from folders, patterns and videos, and to files."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.parameters import InputError
from mffdrake.recognition.recordings.files import WholeFile

__all__ = [
    "DecodeImage",
    "EncodePng",
    "ImageFiles",
    "ImageSource",
    "ImageSourceError",
    "OpenImages",
    "ReadImage",
    "ReadMask",
    "RemoveNumbered",
    "SaveImage",
    "Video",
]

Image = NDArray[np.uint8]

_SUFFIXES = {".bmp", ".jpg", ".jpeg", ".png", ".ppm", ".tif", ".tiff", ".webp"}
_VIDEOS = {".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".mpeg", ".webm"}


class ImageSourceError(InputError, ValueError):
    """Images cannot be had; the message is one line for the person who named them."""


class ImageSource(Protocol):
    """Images of one camera, one after the other."""

    @property
    def count(self) -> int | None:
        """How many there are; None where that shows at the end only."""
        ...

    def __iter__(self) -> Iterator[Image]:
        """RGB images, uint8, shape (height, width, 3)."""
        ...


class ImageFiles:
    """Image files, in the order of the numbers in their names.

    Args:
        paths: The files.
    """

    def __init__(self, paths: list[Path]) -> None:
        self.paths = sorted(paths, key=lambda path: (_NaturalKey(path), str(path)))

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.paths)

    def __iter__(self) -> Iterator[Image]:
        """Reads one after the other."""
        return map(ReadImage, self.paths)


class Video:
    """The frames of a video file.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @property
    def count(self) -> None:
        """Not known: what a video says of its length is often wrong."""
        return None

    def __iter__(self) -> Iterator[Image]:
        """Decodes one frame after the other."""
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        try:
            read, frame = capture.read()
            if not read:
                raise ImageSourceError(f"{self.path}: not a video that can be decoded")
            while read:
                yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
                read, frame = capture.read()
        finally:
            capture.release()


def OpenImages(source: str) -> ImageSource:
    """Finds images.

    Args:
        source: A folder, whose image files count; a pattern such as ``left/*.png``; a video; or one
            image file.

    Returns:
        The images; files come in the order of the numbers in their names.

    Raises:
        ImageSourceError: When there are none.
    """
    path = Path(source)
    if path.is_dir():
        files = [p for p in path.iterdir() if p.suffix.lower() in _SUFFIXES and p.is_file()]
        if not files:
            raise ImageSourceError(
                f"{source}: the folder has no images ({', '.join(sorted(_SUFFIXES))})"
            )
        return ImageFiles(files)
    if path.is_file():
        return Video(path) if path.suffix.lower() in _VIDEOS else ImageFiles([path])
    files = [Path(name) for name in glob.glob(source, recursive=True) if Path(name).is_file()]
    if not files:
        raise ImageSourceError(f"{source}: no such folder, image or video, and nothing matches it")
    return ImageFiles(files)


def ReadImage(path: Path | str) -> Image:
    """Reads a color image.

    Args:
        path: The file.

    Returns:
        RGB, uint8, shape (height, width, 3).

    Raises:
        ImageSourceError: When it is no image, grey, or not of 8 bits a channel.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "red.png"
        >>> SaveImage(np.full((480, 640, 3), (255, 0, 0), dtype=np.uint8), file)
        >>> ReadImage(file)[0, 0]
        array([255,   0,   0], dtype=uint8)
    """
    return DecodeImage(np.frombuffer(Path(path).read_bytes(), dtype=np.uint8), path)


def DecodeImage(data: NDArray[np.uint8], path: Path | str) -> Image:
    """Decodes a color image of any file format.

    Args:
        data: The file's content.
        path: Where it is from, for messages.

    Returns:
        RGB, uint8, shape (height, width, 3).

    Raises:
        ImageSourceError: When it is no image, grey, or not of 8 bits a channel.
    """
    import cv2

    image = _Decode(data, path)
    if image.ndim != 3:
        raise ImageSourceError(f"{path}: the image is grey; colors are needed")
    if image.dtype != np.uint8:
        raise ImageSourceError(f"{path}: the image must have 8 bits a channel, not {image.dtype}")
    conversion = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
    converted: Image = cv2.cvtColor(image, conversion)
    return converted


def ReadMask(path: Path | str) -> NDArray[np.bool_]:
    """Reads which pixels a mask marks.

    Args:
        path: An image: where it has an alpha channel, its opaque pixels are marked, otherwise its
            bright ones.

    Returns:
        Shape (height, width).

    Raises:
        ImageSourceError: When it is no image.
    """
    image = _Decode(np.frombuffer(Path(path).read_bytes(), dtype=np.uint8), path)
    if image.ndim == 3:
        image = image[:, :, 3] if image.shape[2] == 4 else image.max(axis=2)
    return np.asarray(image > 0.5 * image.max()) & (image > 0)


def EncodePng(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An RGB image of shape (height, width, 3) as a PNG file's content."""
    import cv2

    encoded: NDArray[np.uint8] = cv2.imencode(".png", image[:, :, ::-1])[1]
    return encoded.reshape(-1)


def SaveImage(image: NDArray[np.uint8], path: Path | str) -> None:
    """Writes an RGB image as PNG, whole or not at all.

    Args:
        image: Shape (height, width, 3).
        path: The file.

    Raises:
        OSError: When it cannot be written.

    Example:
        >>> import tempfile
        >>> file = Path(tempfile.mkdtemp()) / "red.png"
        >>> SaveImage(np.full((480, 640, 3), (255, 0, 0), dtype=np.uint8), file)
        >>> ReadImage(file).shape
        (480, 640, 3)
    """
    with WholeFile(path) as part:
        part.write_bytes(EncodePng(image).tobytes())


def RemoveNumbered(folder: Path, start: int = 0) -> None:
    """Removes what an earlier command left: images ``000000.png`` and so on.

    Args:
        folder: Where they are; anything else there stays.
        start: The first number that is removed.
    """
    for path in folder.glob(f"{6 * '[0-9]'}.png"):
        if int(path.stem) >= start:
            path.unlink()


def _Decode(data: NDArray[np.uint8], path: Path | str) -> NDArray[Any]:
    """An image as OpenCV decodes it, without the warning that it would print."""
    import cv2

    image = None
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        if len(data):
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error:  # where it is said to be larger than any
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        raise ImageSourceError(f"{path}: not an image that can be read")
    decoded: NDArray[Any] = image
    return decoded


def _NaturalKey(path: Path) -> list[tuple[int, int | str]]:
    """Sorts img2 before img10."""
    parts = re.split(r"(\d+)", str(path))
    return [(1, int(part)) if part.isdecimal() else (0, part) for part in parts]
