"""Videos of trajectories: MP4 by PyAV, which brings its own ffmpeg; GIF and PNG by Pillow."""

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from salpchain.checks import check_kinds
from salpchain.errors import InputError
from salpchain.evaluation.trajectory import Trajectory, as_swims
from salpchain.files import StrPath, write_bytes
from salpchain.given import function, instance, path
from salpchain.installation import install_command
from salpchain.report.canvas import Canvas
from salpchain.report.scene import DONE, INK, SHINE, Box, Scene, water
from salpchain.report.shapes import place_colours
from salpchain.report.strip import strip

SUFFIXES = (".mp4", ".gif", ".png")
SMALLEST, LARGEST = 64, 4096  # pixels, of a side of a video
REST = 1.0  # s that the last moment stays (chosen)
FASTEST = 100.0  # s of swimming in each second of a video (chosen)
PAPER_STEP = 0.1  # s, a control step of the paper's chains
GAP = 6  # pixels between panels
COLOURS = 128  # of a GIF (chosen)
PLACES = 16  # shades of a chain among them (chosen)
SQUARENESS = 1.5  # wanted width of a panel for its height (chosen)

Pixels = UInt8[np.ndarray, "height width 4"]
Progress = Callable[[float], None]
Told = Callable[[Iterable[Any], int, int], Iterator[Any]]


def _unheard(_: float) -> None:
    """Nobody wants to know the progress."""


@dataclass(frozen=True)
class Film:
    """How a video looks.

    Raises:
        InputError: an invalid size, rate or speed.
    """

    width: int = 1280  # pixels
    height: int = 720
    rate: float = 30.0  # frames for each second of the video
    speed: float = 2.0  # s of swimming for each second of the video

    def __post_init__(self) -> None:
        check_kinds(self)
        for name, size in (("width", self.width), ("height", self.height)):
            if not SMALLEST <= size <= LARGEST or size % 2:
                raise InputError(
                    f"{name} must be an even number of pixels from {SMALLEST} to {LARGEST},"
                    f" got {size}"
                )
        if not 1 <= self.rate <= 120:
            raise InputError(f"the frame rate must be 1 to 120 per second, got {self.rate}")
        if not 0.05 <= self.speed <= FASTEST:
            raise InputError(f"speed must be 0.05 to 100, got {self.speed}")


DEFAULTS = {".mp4": Film(), ".gif": Film(640, 360, 15.0, 4.0), ".png": Film(320, 220)}


def write_video(
    swims: Trajectory | Sequence[Trajectory],
    out: StrPath,
    film: Film | None = None,
    progress: Progress = _unheard,
) -> Path:
    """The trajectories side by side in one video; returns its path.

    The suffix chooses the form: `.mp4`, `.gif` (goes round for ever), or `.png`: a strip with a
    row for each swim, of moments from its start to its end, each as large as the film.

    Raises:
        InputError: no trajectories, an unknown suffix, or PyAV is missing and an MP4 is wanted.
        OSError: the folder is missing or not writable, or the disk is full.
    """
    out = path("out", out)
    suffix = check_suffix(out)
    swims = as_swims(swims)
    function("progress", progress)
    film = paced(DEFAULTS[suffix], swims) if film is None else film
    film = instance("film", film, Film, "a Film")
    if suffix == ".png":
        content = strip(swims, film.width, film.height)
    else:
        write = _mp4 if suffix == ".mp4" else _gif
        content = write(frames(swims, film), film, _counted(num_frames(swims, film), progress))
    write_bytes(out, content)
    progress(1.0)
    return out


def check_suffix(out: StrPath) -> str:
    """The suffix of a video's name, in small letters.

    Raises:
        InputError: none that can be written, or `.mp4` without PyAV.
    """
    suffix = Path(out).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"a video's name must end in .mp4, .gif or .png (a strip of moments), got {out}"
        )
    if suffix == ".mp4":
        _av()
    return suffix


def num_frames(swims: Sequence[Trajectory], film: Film) -> int:
    """Frames that `frames` yields."""
    longest = max(swim.duration for swim in swims)
    return int(np.ceil((longest / film.speed + REST) * film.rate)) + 1


def frames(swims: Sequence[Trajectory], film: Film) -> Iterator[Pixels]:
    """The frames of the video, one after the other.

    A frame is overwritten when the next one is asked for.
    """
    picture = Picture(swims, film)
    for index in range(num_frames(swims, film)):
        yield picture.at(index / film.rate * film.speed)


class Picture:
    """Trajectories side by side, drawn at any time."""

    def __init__(self, swims: Sequence[Trajectory], film: Film) -> None:
        """Draws what stays the same once."""
        self._canvas = Canvas(film.width, film.height)
        boxes = layout(len(swims), film)
        self._scenes = [
            Scene(swim, box, _title(swim, swims)) for swim, box in zip(swims, boxes, strict=True)
        ]
        water(self._canvas, boxes)
        for scene in self._scenes:
            scene.draw_still(self._canvas)
        self._still = self._canvas.copy()

    def at(self, time: float) -> Pixels:
        """The picture at a time (s); the pixels are those of the canvas, not a copy."""
        self._canvas.paste(self._still)
        for scene in self._scenes:
            scene.draw(self._canvas, time)
        return self._canvas.pixels


def _title(swim: Trajectory, swims: Sequence[Trajectory]) -> str:
    units = f"{swim.length} units"
    alike = len({other.policy for other in swims}) == 1
    units = units if alike and len(swims) > 1 else f"{swim.policy}, {units}"
    return ", ".join([units, *swim.unusual])


def layout(count: int, film: Film) -> list[Box]:
    """A rectangle for each panel, in lines that fill the picture; the last line's are wider."""
    columns = int(np.ceil(np.sqrt(count * film.width / film.height / SQUARENESS)))
    columns = min(max(columns, 1), count)
    lines = int(np.ceil(count / columns))
    height = (film.height - GAP * (lines - 1)) / lines
    boxes: list[Box] = []
    for line in range(lines):
        here = count // lines + (line < count % lines)
        width = (film.width - GAP * (here - 1)) / here
        low = film.height - height - line * (height + GAP)
        boxes += [Box(k * (width + GAP), low, width, height) for k in range(here)]
    return boxes


def _counted(count: int, progress: Progress) -> Told:
    """What gives on the same frames and reports the share of all work that was done before each.

    Called with the frames of a pass over them, which of how many passes it is, and how many.
    """

    def told(made: Iterable[Any], which: int, passes: int) -> Iterator[Any]:
        for index, frame in enumerate(made):
            progress((which * count + index) / (passes * count))
            yield frame

    return told


def _av() -> Any:
    try:
        import av
    except ImportError:
        raise InputError(
            f"an .mp4 needs PyAV: run {install_command('video')}, or write a .gif or a .png"
        ) from None
    return av


def _mp4(made: Iterator[Pixels], film: Film, told: Told) -> bytes:
    """H.264 that every browser plays."""
    av, content = _av(), io.BytesIO()
    rate = round(film.rate)
    options = {"crf": "20", "preset": "veryfast"}
    with av.open(content, mode="w", format="mp4") as file:
        stream = file.add_stream("libx264", rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = film.width, film.height, "yuv420p"
        for pixels in told(made, 0, 1):
            frame = av.VideoFrame.from_ndarray(pixels, format="rgba")
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return content.getvalue()


def _gif(made: Iterator[Pixels], film: Film, told: Told) -> bytes:
    """All frames with the colours of a frame in which all is seen."""
    from PIL import Image

    images = [Image.fromarray(pixels[..., :3].copy()) for pixels in told(made, 0, 2)]
    palette = _palette(images[len(images) // 2])
    plain = [
        image.quantize(palette=palette, dither=Image.Dither.NONE) for image in told(images, 1, 2)
    ]
    content = io.BytesIO()
    plain[0].save(
        content, "gif", save_all=True, append_images=plain[1:], loop=0,
        duration=round(1000 / film.rate), optimize=False,
    )  # fmt: skip
    return content.getvalue()


def _palette(image: Any) -> Any:
    """Colours of a picture, with those of chains and words, too few pixels to be chosen."""
    from PIL import Image

    places = place_colours(PLACES)
    kept = np.vstack([places, places + SHINE * (1 - places), INK, DONE])
    chosen = image.quantize(COLOURS - len(kept), Image.Quantize.MEDIANCUT).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*chosen, *np.round(255 * kept).astype(int).ravel().tolist()])
    return palette


def paced(film: Film, swims: Sequence[Trajectory]) -> Film:
    """The film with as many control steps in each second as it has of the paper's chains."""
    step = max((swim.dt for swim in swims if swim.is_rigid), default=PAPER_STEP)
    return replace(film, speed=min(film.speed * step / PAPER_STEP, FASTEST))


def with_defaults(out: StrPath, **given: Any) -> Film:
    """The film that suits the suffix, with what is given (not None) in its place."""
    chosen = {name: value for name, value in given.items() if value is not None}
    return replace(DEFAULTS[check_suffix(out)], **chosen)
