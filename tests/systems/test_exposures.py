"""The rows of a frame are those of its own exposure and of the one before, whatever the periods."""

import numpy as np
import pytest

from mffdrake.systems.timing import Timing
from mffdrake.systems.vision.exposures import Exposures

TIMINGS = [
    Timing(),
    Timing(vision_period=1 / 30),
    Timing(vision_period=1 / 24),
    Timing(vision_period=0.0025),
    Timing(control_period=0.002, vision_period=0.0073),
    Timing(control_period=0.0005, vision_period=0.0335),
    Timing(control_period=0.004, vision_period=0.004),
]


def latencies(timing):
    """Control ticks of 0 to 7 frames."""
    frame = timing.vision_period / timing.control_period
    some = (0.0, 0.03, 0.3, 0.97, 1.0, 1.03, 1.5, 2.0, 2.9, 3.0, 3.1, 5.03, 7.0)
    return sorted({round(frames * frame) for frames in some})


def run(timing, delay, num_frames):
    """At every tick: its number and the two rows, where the values are the number of the tick."""
    exposures = Exposures(timing, timing.TimeOfTick(delay))
    rows = np.full((exposures.num_samples, 2), np.nan)
    for tick in range(timing.TickOfFrame(num_frames)):
        time = timing.TimeOfTick(tick)
        yield tick, *exposures.Rows(time, rows=rows, now=np.array([tick]))
        if exposures.IsExposure(time):
            rows = np.vstack([[time, tick], rows[:-1]])


@pytest.mark.parametrize("timing", TIMINGS, ids=str)
def test_a_frame_shows_its_exposure_and_the_last_frame_its_own(timing):
    for delay in latencies(timing):
        frame = 0
        for tick, last, present in run(timing, delay, 40):
            if tick != timing.TickOfFrame(frame):
                continue
            for row, exposed in (
                (last, timing.TickOfFrame(frame - 1) - delay),
                (present, tick - delay),
            ):
                expected = [timing.TimeOfTick(exposed), exposed] if exposed >= 0 else [np.nan] * 2
                np.testing.assert_array_equal(row, expected)
            frame += 1
        assert frame == 40


@pytest.mark.parametrize("timing", TIMINGS, ids=str)
def test_between_frames_the_rows_are_of_successive_exposures_of_which_one_is_the_last_frames(
    timing,
):
    for delay in latencies(timing):
        for tick, last, present in run(timing, delay, 20):
            if np.isnan(last[1]):
                continue
            frame = timing.FrameAtTick(int(last[1]) + delay)
            assert timing.TickOfFrame(frame) == last[1] + delay
            if delay > 0:
                assert present[1] == timing.TickOfFrame(frame + 1) - delay
            before = timing.TickOfFrame(timing.FrameAtTick(tick - 1))
            assert before in (last[1] + delay, present[1] + delay)


@pytest.mark.parametrize("timing", TIMINGS, ids=str)
def test_the_next_frame(timing):
    exposures = Exposures(timing, 0.0)
    for tick in range(timing.TickOfFrame(5)):
        frame = exposures.NextFrame(timing.TimeOfTick(tick))
        assert timing.TickOfFrame(frame) >= tick
        assert frame == 0 or timing.TickOfFrame(frame - 1) < tick


def test_the_latency_is_whole_control_ticks():
    with pytest.raises(ValueError, match="latency must be at least 0 and a whole multiple"):
        Exposures(Timing(), 0.0005)
