"""Text over rendered pictures: title, clock, legend and labels. Pillow, and the font that
Matplotlib brings.
"""

import functools
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from dronecombat_jax.report.stage import ENLARGEMENT, TARGET_COLOUR, TEAM_COLOURS
from dronecombat_jax.types import SIDES

_WHITE, _GREY, _PANEL = (255, 255, 255), (205, 212, 220), (16, 22, 30, 170)
Colour = tuple[int, int, int]


class Caption:
    """Draws over one picture; all sizes are shares of its height, so any resolution looks the same."""

    def __init__(self, pixels: np.ndarray):
        self.image = Image.fromarray(pixels).convert("RGBA")
        self.width, self.height = self.image.size
        self.layer = Image.new("RGBA", self.image.size, (0, 0, 0, 0))
        self.draw = ImageDraw.Draw(self.layer)

    def title(self, title: str, subtitle: str) -> None:
        """A centred heading with a line below it, on a dark band at the top."""
        band = round(0.125 * self.height)
        self.draw.rectangle((0, 0, self.width, band), fill=_PANEL)
        self._text((self.width / 2, 0.042 * self.height), title, 0.040, bold=True, anchor="mm")
        self._text(
            (self.width / 2, 0.092 * self.height), subtitle, 0.026, colour=_GREY, anchor="mm"
        )

    def legend(self, note: str) -> None:
        """Who has which colour, and `note`, on a dark band at the bottom."""
        band, size = round(0.062 * self.height), 0.026
        middle = self.height - band / 2
        self.draw.rectangle((0, self.height - band, self.width, self.height), fill=_PANEL)
        left = 0.03 * self.width
        for name, colour in (*zip(SIDES, TEAM_COLOURS, strict=True), ("target", TARGET_COLOUR)):
            radius = 0.011 * self.height
            self.draw.ellipse(
                (left - radius, middle - radius, left + radius, middle + radius),
                fill=to_bytes(colour),
            )
            self._text((left + 2 * radius, middle), name, size, anchor="lm")
            left += 4.5 * radius + self._font(size, False).getlength(name)
        self._text((0.97 * self.width, middle), note, size, colour=_GREY, anchor="rm")

    def label(
        self, at: np.ndarray, text: str, colour: Sequence[float], below: float = 0.05
    ) -> None:
        """A word below the point `at` [2], each in [-1, 1] with y up, kept inside the picture."""
        size = 0.024
        half = self._font(size, True).getlength(text) / 2 + 0.012 * self.height
        x = float(np.clip((at[0] + 1) / 2 * self.width, half, self.width - half))
        y = float(
            np.clip(
                (1 - at[1]) / 2 * self.height + below * self.height,
                0.15 * self.height,
                0.9 * self.height,
            )
        )
        tall = 0.019 * self.height
        self.draw.rounded_rectangle(
            (x - half, y - tall, x + half, y + tall), radius=tall / 2, fill=_PANEL
        )
        self._text((x, y), text, size, colour=lighten(colour), bold=True, anchor="mm")

    def inset(
        self, pixels: np.ndarray, left: int, top: int, text: str, colour: Sequence[float]
    ) -> None:
        """Another picture inside a coloured frame, named at its lower left."""
        height, width = pixels.shape[:2]
        frame = max(2, round(0.004 * self.height))
        box = (left - frame, top - frame, left + width + frame - 1, top + height + frame - 1)
        ImageDraw.Draw(self.image).rectangle(box, fill=to_bytes(colour))
        self.image.paste(Image.fromarray(np.ascontiguousarray(pixels)), (left, top))
        size = 0.022
        tall, wide = (
            0.036 * self.height,
            self._font(size, True).getlength(text) + 0.02 * self.height,
        )
        self.draw.rectangle((left, top + height - tall, left + wide, top + height - 1), fill=_PANEL)
        at = (left + wide / 2, top + height - tall / 2)
        self._text(at, text, size, colour=lighten(colour), bold=True, anchor="mm")

    def banner(self, text: str, colour: Sequence[float]) -> None:
        """The outcome, large, in the middle of the lower third."""
        size, y = 0.052, 0.80 * self.height
        half, tall = (
            self._font(size, True).getlength(text) / 2 + 0.03 * self.height,
            0.048 * self.height,
        )
        x = self.width / 2
        self.draw.rounded_rectangle(
            (x - half, y - tall, x + half, y + tall), radius=tall / 3, fill=(16, 22, 30, 215)
        )
        self._text((x, y), text, size, colour=lighten(colour), bold=True, anchor="mm")

    def pixels(self) -> np.ndarray:
        """The finished picture, uint8 [height, width, 3]."""
        return np.asarray(Image.alpha_composite(self.image, self.layer).convert("RGB"))

    def _text(
        self,
        at: tuple[float, float],
        text: str,
        size: float,
        colour: Colour = _WHITE,
        bold: bool = False,
        anchor: str = "lm",
    ) -> None:
        self.draw.text(at, text, font=self._font(size, bold), fill=colour, anchor=anchor)

    def _font(self, size: float, bold: bool) -> ImageFont.FreeTypeFont:
        return _load_font(max(8, round(size * self.height)), bold)


def drawn_note(speed: float | None = None) -> str:
    """What a viewer must know about the picture: the drones' enlargement and the playing speed."""
    note = f"drones drawn {ENLARGEMENT:g} times their size"
    return note if speed in (None, 1.0) else f"{note}, played at {speed:g} times real speed"


def to_bytes(colour: Sequence[float]) -> Colour:
    """A colour of [0, 1] as bytes."""
    red, green, blue = (round(255 * part) for part in colour[:3])
    return red, green, blue


def lighten(colour: Sequence[float], share: float = 0.35) -> Colour:
    """A colour of [0, 1] mixed with white, readable on the dark panel, as bytes."""
    return to_bytes([part + (1.0 - part) * share for part in colour[:3]])


@functools.cache
def _load_font(points: int, bold: bool) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name, points)
