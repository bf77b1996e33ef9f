"""Pictures of every frame: as images with the frames' numbers, or as a video that plays."""

import cv2
import numpy as np
import pytest

from mffdrake.recognition.recordings.overlay import OVERLAYS, MakeOverlay

COLORS = np.array([(220, 40, 40), (40, 200, 60), (50, 60, 210)], dtype=np.uint8)


def picture(color, height=48, width=64):
    return np.full((height, width, 3), color, dtype=np.uint8)


def played(path):
    """A video's frames, RGB, and how many it shows a second."""
    capture = cv2.VideoCapture(str(path))
    rate, frames = capture.get(cv2.CAP_PROP_FPS), []
    while (read := capture.read())[0]:
        frames.append(read[1][:, :, ::-1])
    return frames, rate


def test_images_have_the_frames_numbers(tmp_path):
    rng = np.random.default_rng(0)
    pictures = {k: rng.integers(0, 256, (9, 7, 3), dtype=np.uint8) for k in (0, 3, 123456)}
    with MakeOverlay("images", tmp_path, 30.0) as add:
        for frame, image in pictures.items():
            add(frame, image)
            path = tmp_path / "overlay" / f"{frame:06d}.png"
            np.testing.assert_array_equal(cv2.imread(str(path))[:, :, ::-1], image)
    assert len(list((tmp_path / "overlay").iterdir())) == 3


def test_images_of_an_earlier_run_do_not_stay(tmp_path):
    for frames in ((0, 1, 2), (0, 2)):
        with MakeOverlay("images", tmp_path, 30.0) as add:
            for frame in frames:
                add(frame, picture(COLORS[0]))
    assert sorted(p.name for p in (tmp_path / "overlay").iterdir()) == ["000000.png", "000002.png"]


@pytest.mark.parametrize(
    ("rate", "shown"),
    [
        (30.0, 30.0),
        (1.0 / 0.033, 30.3),
        (23.976, 23.98),
        (1.0 / 0.015, 66.67),
        (120.0, 120.0),
        (0.5, 0.5),
        (1e-3, 0.1),
        (1e6, 500.0),
    ],
)
def test_a_video_plays_all_frames_at_any_rate(tmp_path, rate, shown):
    with MakeOverlay("video", tmp_path, rate) as add:
        for frame, color in enumerate(COLORS):
            add(frame, picture(color))
    frames, played_rate = played(tmp_path / "overlay.mp4")
    assert played_rate == pytest.approx(shown, abs=1e-3)
    means = [frame.reshape(-1, 3).mean(axis=0) for frame in frames]
    np.testing.assert_allclose(means, COLORS, rtol=0, atol=8)
    assert [path.name for path in tmp_path.iterdir()] == ["overlay.mp4"]


def test_a_video_of_odd_pictures_has_the_next_even_size(tmp_path):
    with MakeOverlay("video", tmp_path, 30.0) as add:
        add(0, picture(COLORS[0], 41, 63))
    frames, _ = played(tmp_path / "overlay.mp4")
    assert [frame.shape for frame in frames] == [(42, 64, 3)]
    np.testing.assert_allclose(frames[0][:40, :62].mean(axis=(0, 1)), COLORS[0], rtol=0, atol=8)


def test_a_video_is_there_whole_or_not_at_all(tmp_path):
    with pytest.raises(KeyboardInterrupt), MakeOverlay("video", tmp_path, 30.0) as add:
        add(0, picture(COLORS[0]))
        assert not (tmp_path / "overlay.mp4").exists()
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_without_a_kind_nothing_is_written(tmp_path):
    with MakeOverlay(None, tmp_path, 30.0) as add:
        add(0, picture(COLORS[0]))
    assert list(tmp_path.iterdir()) == []
    assert OVERLAYS == ("images", "video")


def test_where_nothing_can_be_written_that_is_named(tmp_path):
    (tmp_path / "overlay").write_text("a file")
    (tmp_path / "overlay.mp4").mkdir()
    for kind in OVERLAYS:
        with pytest.raises(OSError) as caught, MakeOverlay(kind, tmp_path, 30.0) as add:
            add(0, picture(COLORS[0]))
        assert "overlay" in str(caught.value.filename)
