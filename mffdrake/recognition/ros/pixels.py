"""Images of ROS's messages as RGB arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mffdrake.recognition.recordings.image_files import DecodeImage
from mffdrake.recognition.ros.messages import RosError

__all__ = ["decode"]

Image = NDArray[np.uint8]

# Encoding to channels and, where they are not RGB, what OpenCV calls the conversion; it names Bayer
# patterns by the pixel on the second row and column.
_ENCODINGS = {
    "rgb8": (3, ""), "bgr8": (3, "BGR2RGB"), "8uc3": (3, "BGR2RGB"),
    "rgba8": (4, "RGBA2RGB"), "bgra8": (4, "BGRA2RGB"), "8uc4": (4, "BGRA2RGB"),
    "bayer_rggb8": (1, "BayerBG2RGB"), "bayer_bggr8": (1, "BayerRG2RGB"),
    "bayer_gbrg8": (1, "BayerGR2RGB"), "bayer_grbg8": (1, "BayerGB2RGB"),
    "yuv422": (2, "YUV2RGB_UYVY"), "uyvy": (2, "YUV2RGB_UYVY"),
    "yuv422_yuy2": (2, "YUV2RGB_YUY2"), "yuyv": (2, "YUV2RGB_YUY2"),
}  # fmt: skip


def decode(message: Any, where: str) -> Image:
    """An image.

    Args:
        message: ``sensor_msgs/Image`` or ``CompressedImage``.
        where: Where it is from, for messages.

    Returns:
        RGB, uint8, shape (height, width, 3).

    Raises:
        RosError: When it has no colors, or an encoding that is not known.
        ImageSourceError: When a compressed image cannot be decoded, or is grey.
    """
    if hasattr(message, "format"):
        return DecodeImage(np.asarray(message.data), where)
    import cv2

    encoding = str(message.encoding).lower()
    if encoding not in _ENCODINGS:
        grey = encoding.startswith("mono") or encoding.endswith("c1")
        reason = "is grey" if grey else "is of no encoding that is known"
        raise RosError(
            f"{where}: an image of encoding '{encoding}' {reason}; colors are needed, of "
            f"{', '.join(_ENCODINGS)}: choose other topics by --images NAME=/TOPIC"
        )
    channels, conversion = _ENCODINGS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    if step < width * channels or len(data) < height * step:
        raise RosError(f"{where}: an image of {width} x {height} pixels lacks bytes")
    rows = data[: height * step].reshape(height, step)[:, : width * channels]
    image = np.ascontiguousarray(rows).reshape(height, width, channels)
    if not conversion:
        return image
    converted: Image = cv2.cvtColor(image, getattr(cv2, f"COLOR_{conversion}"))
    return converted
