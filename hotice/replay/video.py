"""A rollout as a film of 1080 lines: drawn by MuJoCo's renderer, with shadows, and encoded by ffmpeg."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Generator, Iterator
from contextlib import closing
from functools import lru_cache
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from hotice.errors import InvalidConfig, OutputError
from hotice.files import written_aside
from hotice.replay.html import describe
from hotice.replay.offscreen import find_renderer
from hotice.replay.palette import FAILURE_COLOR, INK, OUTCOME_COLORS
from hotice.replay.rollout import RolloutRecord
from hotice.replay.stage import Stage

FRAMES_PER_S = 25
SIZE_PX = (1920, 1080)
"""Width and height, even as the codec needs them."""
STILL_S = 1.0
"""Time that the last frame is shown [s]."""


def write_video(
    record: RolloutRecord,
    path: str | Path,
    on_frame: Callable[[int, int], None] | None = None,
    *,
    most_s: float = math.inf,
    size_px: tuple[int, int] = SIZE_PX,
) -> Path:
    """Writes an MP4 (H.264, 25 frames/s) of a rollout in its own time; its end is held for a second.

    Args:
        record: the rollout.
        path: the .mp4 file; appears when it is whole.
        on_frame: called with the frames drawn so far and their number in all.
        most_s: of a longer film the last so many seconds are kept.
        size_px: width and height, even numbers.

    Raises:
        InvalidConfig: what encodes is not installed, or `path` is no .mp4.
        NoRenderer: nothing draws without a screen.
        OutputError: `path` cannot be written.
    """
    path = Path(path)
    if path.suffix != ".mp4":
        raise InvalidConfig(f"{path}: a film is an .mp4 file")
    find_encoder()
    frames = film_frames(record, most_s)
    with written_aside(path) as aside:
        try:
            with closing(_encode(aside, size_px)) as film:
                film.send(None)
                for n, image in enumerate(_images(record, frames, size_px), 1):
                    film.send(image)
                    if on_frame:
                        on_frame(n, len(frames))
            written = _frames_in(aside)
        except OSError as error:
            raise OutputError(f"cannot write {path}: ffmpeg ended before the film did, is the disk full?") from error
        if written != len(frames):
            raise OutputError(f"cannot write {path}: ffmpeg wrote {written} of {len(frames)} frames, is the disk full?")
    return path


def film_frames(record: RolloutRecord, most_s: float = math.inf) -> list[int]:
    """Frame of the record at every 1/25 s, the last one repeated for `STILL_S`; the last `most_s` of them all."""
    time = record.time_s - record.time_s[0]
    ticks = np.arange(0.0, time[-1] + STILL_S, 1.0 / FRAMES_PER_S)
    frames = np.clip(np.searchsorted(time, ticks + 1e-9, side="right") - 1, 0, len(time) - 1).tolist()
    return frames[-round(min(most_s * FRAMES_PER_S, len(frames))) :]


def check_film() -> str:
    """A look for all that a film needs, before any work: what is to be said of it, empty where nothing is.

    Raises `InvalidConfig` without an encoder, `NoRenderer` where nothing draws.
    """
    find_encoder()
    name, faults = find_renderer()
    return f"the film is drawn by {name} ({faults})" if faults else ""


@lru_cache
def find_encoder() -> None:
    """A try whether films can be encoded, by one of a single small frame. Raises `InvalidConfig`."""
    try:
        import imageio_ffmpeg
    except ImportError:
        raise InvalidConfig("a film needs imageio-ffmpeg: pip install 'hotice[video]'") from None
    try:
        imageio_ffmpeg.get_ffmpeg_exe()
        with tempfile.TemporaryDirectory() as folder:
            path, size_px = Path(folder) / "one.mp4", (64, 64)
            with closing(_encode(path, size_px)) as film:
                film.send(None)
                film.send(np.zeros((*size_px, 3), np.uint8))
            if _frames_in(path) == 1:
                return
            why = "it writes no H.264"
    except (RuntimeError, OSError) as error:
        why = str(error).strip().splitlines()[0]
    raise InvalidConfig(
        f"a film needs an ffmpeg that writes H.264 ({why}): reinstall imageio-ffmpeg, which brings one for most "
        "machines, or install ffmpeg and name its file in IMAGEIO_FFMPEG_EXE"
    )


def _encode(path: Path, size_px: tuple[int, int]) -> Generator[None, Any, None]:
    """A generator that takes images and writes them into a film; raises `OSError` when ffmpeg ends."""
    from imageio_ffmpeg import write_frames

    # the index first: a page shows the film before it has all of it
    early = ["-movflags", "+faststart"]
    return write_frames(
        str(path),
        size_px,
        fps=FRAMES_PER_S,
        quality=6,
        macro_block_size=2,
        ffmpeg_log_level="fatal",
        output_params=early,
    )


def _frames_in(path: Path) -> int:
    """Number of frames of a film; 0 for a file that is none."""
    from imageio_ffmpeg import count_frames_and_secs

    try:
        return int(count_frames_and_secs(str(path))[0] or 0)
    except RuntimeError:
        return 0


def _images(record: RolloutRecord, frames: list[int], size_px: tuple[int, int]) -> Iterator[NDArray[np.uint8]]:
    """Images (H, W, 3); a frame that comes again is not drawn again."""
    last, image = -1, np.zeros(0, np.uint8)
    with Stage(record, size_px) as stage:
        for frame in frames:
            if frame != last:
                image, last = _with_caption(stage.draw(frame), record, frame), frame
            yield image


def _with_caption(image: NDArray[np.uint8], record: RolloutRecord, frame: int) -> NDArray[np.uint8]:
    picture = Image.fromarray(image)
    width, height = picture.size
    draw, edge, line = ImageDraw.Draw(picture), 0.02 * width, 0.045 * height
    draw.text((edge, edge), f"{record.scene.name}   {record.policy}, {describe(record.carried)}", INK, _font(height))
    draw.text((edge, edge + line), f"{record.time_s[frame] - record.time_s[0]:.2f} s", INK, _font(height))
    if frame == len(record.time_s) - 1:
        color = OUTCOME_COLORS.get(record.outcome, FAILURE_COLOR)
        ending = f"{record.outcome.replace('_', ' ')}, {record.distance_m:.2f} m from the goal"
        draw.text((width - edge, edge), ending, color, _font(height, "DejaVuSans-Bold"), anchor="ra")
    return np.asarray(picture)


@lru_cache
def _font(height: int, name: str = "DejaVuSans") -> ImageFont.FreeTypeFont:
    """For images of a height [px]; comes with matplotlib."""
    return ImageFont.truetype(f"{matplotlib.get_data_path()}/fonts/ttf/{name}.ttf", round(0.026 * height))
