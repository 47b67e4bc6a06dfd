"""A rollout as a film: drawn in software, so that it needs no graphics driver, and encoded by ffmpeg."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from hotice.errors import InvalidConfig
from hotice.files import written_aside
from hotice.replay.html import describe
from hotice.replay.picture import FAILURE_COLOR, OUTCOME_COLORS, draw_frame
from hotice.replay.rollout import RolloutRecord

FRAMES_PER_S = 25
SIZE_PX = (720, 784)
"""Width and height, multiples of 16 as video codecs like it."""
AZIMUTH_RAD, ELEVATION_RAD = np.radians(-55.0), np.radians(12.0)
STILL_S = 1.0
"""Time that the last frame is shown [s]."""


def write_video(record: RolloutRecord, path: str | Path, on_frame: Callable[[int, int], None] | None = None) -> Path:
    """Writes an MP4 (H.264, 25 frames/s) of a rollout in its own time; its end is held for a second.

    Args:
        record: the rollout.
        path: the .mp4 file; appears when it is whole.
        on_frame: called with the frames drawn so far and their number in all.

    Raises:
        InvalidConfig: imageio-ffmpeg, which brings the encoder, is not installed, or `path` is no .mp4.
        OutputError: `path` cannot be written.
    """
    write_frames = _encoder()
    path = Path(path)
    if path.suffix != ".mp4":
        raise InvalidConfig(f"{path}: a film is an .mp4 file")
    frames = film_frames(record)
    with written_aside(path) as aside:
        film = write_frames(str(aside), SIZE_PX, fps=FRAMES_PER_S, quality=7, ffmpeg_log_level="error")
        film.send(None)
        for n, image in enumerate(_images(record, frames), 1):
            film.send(image)
            if on_frame:
                on_frame(n, len(frames))
        film.close()
    return path


def film_frames(record: RolloutRecord) -> list[int]:
    """Frame of the record at every 1/25 s, the last one repeated for `STILL_S`."""
    time = record.time_s - record.time_s[0]
    ticks = np.arange(0.0, time[-1] + STILL_S, 1.0 / FRAMES_PER_S)
    return np.clip(np.searchsorted(time, ticks + 1e-9, side="right") - 1, 0, len(time) - 1).tolist()


def _images(record: RolloutRecord, frames: list[int]) -> Iterator[np.ndarray]:
    """Images (H, W, 3) uint8; a frame that comes again is not drawn again."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    dpi = 100
    figure = Figure(figsize=(SIZE_PX[0] / dpi, SIZE_PX[1] / dpi), dpi=dpi)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 0.92))
    last, image = -1, np.zeros(0)
    for frame in frames:
        if frame != last:
            axes.clear()
            axes.set_axis_off()
            draw_frame(axes, record, frame, AZIMUTH_RAD, ELEVATION_RAD, arrows=True)
            _caption(figure, record, frame)
            canvas.draw()
            image = np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])
            last = frame
        yield image


def _caption(figure, record: RolloutRecord, frame: int) -> None:
    for text in list(figure.texts):
        text.remove()
    figure.text(
        0.02, 0.975, f"{record.scene.name}   {record.policy}, {describe(record.carried)}", va="top", fontsize=11
    )
    figure.text(0.02, 0.94, f"{record.time_s[frame] - record.time_s[0]:.2f} s", va="top", fontsize=11)
    if frame == len(record.time_s) - 1:
        color = OUTCOME_COLORS.get(record.outcome, FAILURE_COLOR)
        ending = f"{record.outcome.replace('_', ' ')}, {record.distance_m:.2f} m from the goal"
        figure.text(0.98, 0.94, ending, va="top", ha="right", fontsize=11, color=color, fontweight="bold")


def _encoder() -> Callable:
    try:
        from imageio_ffmpeg import write_frames
    except ImportError:
        raise InvalidConfig("a film needs imageio-ffmpeg: pip install 'hotice[video]'") from None
    return write_frames
