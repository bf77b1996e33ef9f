"""Images from folders, patterns and videos: their order, their colors, and what is none."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from mffdrake.recognition.recordings.image_files import (
    ImageFiles,
    ImageSourceError,
    OpenImages,
    ReadImage,
    ReadMask,
    RemoveNumbered,
    Video,
)

COLORS = np.array([(220, 40, 40), (40, 200, 60), (50, 60, 210), (200, 190, 30)], dtype=np.uint8)


def random_image(*shape):
    return np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)


def touch(folder, *names):
    folder.mkdir(exist_ok=True)
    for name in names:
        cv2.imwrite(str(folder / "x.png"), random_image(4, 6, 3))
        (folder / "x.png").rename(folder / name)


def names_of(source):
    return [path.name for path in OpenImages(str(source)).paths]


# Their order


def test_files_come_in_the_order_of_their_numbers(tmp_path):
    names = ["2.png", "10.png", "img1.png", "img2.png", "img10.png", "img10_3.png", "img10_20.png"]
    touch(tmp_path / "a", *reversed(names))
    expected = sorted(names, key=names.index)
    assert sorted(names) != expected  # the alphabet would not do
    assert names_of(tmp_path / "a") == expected
    assert names_of(tmp_path / "a" / "*.png") == expected
    assert names_of(tmp_path / "a" / "img*.png") == expected[2:]


def test_numbers_of_folders_count_too(tmp_path):
    for k in (10, 9, 1):
        touch(tmp_path / f"take{k}", "0.png")
    found = OpenImages(str(tmp_path / "take*" / "*.png")).paths
    assert [path.parent.name for path in found] == ["take1", "take9", "take10"]


def test_equal_numbers_have_an_order_too(tmp_path):
    touch(tmp_path / "a", "img1.png", "img01.png", "img001.png", "1²2.png")
    paths = OpenImages(str(tmp_path / "a")).paths
    for given in (paths, paths[::-1]):
        order = [path.name for path in ImageFiles(given).paths]
        assert order == ["1²2.png", "img001.png", "img01.png", "img1.png"]


def test_a_folder_s_images_are_its_files_of_that_kind(tmp_path):
    touch(tmp_path / "a", "1.PNG", "2.Jpg", "3.tiff")
    (tmp_path / "a" / "notes.txt").write_text("no image")
    (tmp_path / "a" / "4.png").mkdir()
    assert names_of(tmp_path / "a") == ["1.PNG", "2.Jpg", "3.tiff"]
    assert OpenImages(str(tmp_path / "a")).count == 3
    assert names_of(tmp_path / "a" / "2.Jpg") == ["2.Jpg"]


def test_a_folder_whose_name_looks_like_a_pattern(tmp_path):
    touch(tmp_path / "[a]", "1.png")
    assert names_of(tmp_path / "[a]") == ["1.png"]


# Their colors


def test_an_image_is_rgb_with_or_without_alpha(tmp_path):
    image = random_image(20, 30, 4)
    path = tmp_path / "a.png"
    for channels in (image, image[:, :, :3].copy()):
        cv2.imwrite(str(path), channels)
        read = ReadImage(path)
        np.testing.assert_array_equal(read, image[:, :, 2::-1])
        assert read.dtype == np.uint8


@pytest.mark.parametrize(("suffix", "code"), [("avi", "MJPG"), ("mp4", "mp4v")])
def test_a_video_is_read_frame_by_frame(tmp_path, suffix, code):
    """Frames of one color each, twice over: nothing is left out, turned around or bluish."""
    path = tmp_path / f"clip07.{suffix}"
    frames = np.tile(COLORS, (2, 1))[:7]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), 30.0, (64, 48))
    for color in frames:
        writer.write(np.full((48, 64, 3), color[::-1], dtype=np.uint8))
    writer.release()
    source = OpenImages(str(path))
    assert isinstance(source, Video)
    assert source.count is None
    for _ in range(2):  # and again from the beginning
        read = list(source)
        assert [image.shape for image in read] == 7 * [(48, 64, 3)]
        means = [image.reshape(-1, 3).mean(axis=0) for image in read]
        np.testing.assert_allclose(means, frames, rtol=0, atol=8)


# Masks


def test_a_mask_s_opaque_pixels_count_where_it_has_an_alpha_channel(tmp_path):
    marked = random_image(20, 30) > 128
    cut = np.dstack([random_image(20, 30, 3), np.where(marked, 255, 0).astype(np.uint8)])
    cv2.imwrite(str(tmp_path / "m.png"), cut)
    np.testing.assert_array_equal(ReadMask(tmp_path / "m.png"), marked)


@pytest.mark.parametrize(
    "bright", [np.uint8(255), np.uint8(1), np.uint16(40000), np.uint8((0, 0, 255))]
)
def test_a_mask_s_bright_pixels_count_where_it_has_none(tmp_path, bright):
    marked = random_image(20, 30) > 128
    shape = (20, 30, 3) if bright.shape else (20, 30)
    mask = np.zeros(shape, dtype=bright.dtype)
    mask[marked] = bright
    cv2.imwrite(str(tmp_path / "m.png"), mask)
    np.testing.assert_array_equal(ReadMask(tmp_path / "m.png"), marked)


def test_a_black_or_transparent_mask_marks_nothing(tmp_path):
    for shape in ((20, 30), (20, 30, 3), (20, 30, 4)):
        cv2.imwrite(str(tmp_path / "m.png"), np.zeros(shape, dtype=np.uint8))
        mask = ReadMask(tmp_path / "m.png")
        assert (mask.shape, mask.any()) == ((20, 30), False)


# What is no image


def png_of_size(side):
    """The first bytes of a PNG that is said to be so large."""
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    size, check = struct.pack(">I", 13), struct.pack(">I", zlib.crc32(header))
    return b"\x89PNG\r\n\x1a\n" + size + header + check + bytes(200)


def encoded(image, suffix=".png"):
    return cv2.imencode(suffix, image)[1].tobytes()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (encoded(random_image(9, 9)), "the image is grey; colors are needed"),
        (encoded(random_image(9, 9).astype(np.uint16)), "the image is grey"),
        (
            encoded(random_image(9, 9, 3).astype(np.uint16)),
            "the image must have 8 bits a channel, not uint16",
        ),
        (b"", "not an image that can be read"),
        (b"hello", "not an image that can be read"),
        (encoded(random_image(40, 40, 3))[:2000], "not an image that can be read"),
        (encoded(random_image(40, 40, 3), ".tiff")[:2000], "not an image that can be read"),
        (png_of_size(1 << 20), "not an image that can be read"),
    ],
    ids=["grey", "grey of 16 bits", "16 bits", "empty", "text", "half", "half a TIFF", "huge"],
)
def test_what_is_no_color_image_is_named_and_nothing_else_is_said(
    tmp_path, capfd, content, message
):
    path = tmp_path / "a.png"
    path.write_bytes(content)
    with pytest.raises(ImageSourceError) as caught:
        ReadImage(path)
    assert str(caught.value).startswith(f"{path}: {message}")
    assert capfd.readouterr() == ("", "")
    if message.startswith("not"):
        with pytest.raises(ImageSourceError, match="not an image"):
            ReadMask(path)


def test_what_is_not_there_is_named(tmp_path):
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "deeper.png").mkdir()
    with pytest.raises(ImageSourceError, match=r"the folder has no images \(\.bmp, \.jpeg, "):
        OpenImages(str(tmp_path))
    for source in ("none", "*.jpg", "deeper.p*"):
        with pytest.raises(ImageSourceError, match="no such folder, image or video, and nothing"):
            OpenImages(str(tmp_path / source))
    for read in (ReadImage, ReadMask):
        with pytest.raises(FileNotFoundError) as caught:
            read(tmp_path / "none.png")
        assert caught.value.filename == str(tmp_path / "none.png")


@pytest.mark.parametrize("name", ["a.mp4", "clip01.avi", "a.MKV"])
def test_what_is_no_video_is_named(tmp_path, name):
    for content in (b"", 100 * b"garbage"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ImageSourceError, match="not a video that can be decoded"):
            list(OpenImages(str(tmp_path / name)))


# What an earlier command left


def test_numbered_images_are_removed_and_nothing_else(tmp_path):
    kept = ["00001.png", "0000001.png", "000003.jpg", "a00003.png", "000001.png", "notes.txt"]
    touch(tmp_path / "a", *kept, "000002.png", "123456.png")
    RemoveNumbered(tmp_path / "a", start=2)
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == sorted(kept)
    RemoveNumbered(tmp_path / "a")
    assert not (tmp_path / "a" / "000001.png").exists()
