"""Moving pictures for places that play no video: GIF and WebP, as a README or a slide shows them.

What does not live here: the frames, and h264 (`video`).
"""

import io
from collections.abc import Iterator

import numpy as np
from PIL import Image

GIF_WIDTH, WEBP_WIDTH = 560, 720  # pixels, at most
# Of the frames one in so many: a GIF counts hundredths of a second, and both grow with every frame.
EVERY = 2
WEBP_QUALITY = 72


def encode_gif(frames: Iterator[np.ndarray], rate: int) -> bytes:
    """Frames, uint8 [height, width, 3] at `rate` a second, as a GIF that plays for ever."""
    images = _smaller(frames, GIF_WIDTH)
    palette = _side_by_side(images[:: max(1, len(images) // 8)]).quantize(255)
    drawn = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    return _saved(drawn, "GIF", round(1000 * EVERY / rate), optimize=False, disposal=1)


def encode_webp(frames: Iterator[np.ndarray], rate: int) -> bytes:
    """The same as an animated WebP."""
    images = _smaller(frames, WEBP_WIDTH)
    return _saved(images, "WEBP", round(1000 * EVERY / rate), quality=WEBP_QUALITY, method=3)


def _smaller(frames: Iterator[np.ndarray], width: int) -> list[Image.Image]:
    images = []
    for index, pixels in enumerate(frames):
        if index % EVERY == 0:
            image = Image.fromarray(pixels)
            wide = min(width, image.width)
            size = (wide, round(image.height * wide / image.width))
            images.append(image.resize(size, Image.Resampling.LANCZOS))
    return images


def _side_by_side(images: list[Image.Image]) -> Image.Image:
    """One picture that has the colours of all."""
    width, height = images[0].size
    sheet = Image.new("RGB", (width, height * len(images)))
    for index, image in enumerate(images):
        sheet.paste(image, (0, height * index))
    return sheet


def _saved(images: list[Image.Image], kind: str, milliseconds: int, **options) -> bytes:
    content = io.BytesIO()
    first, *others = images
    options |= {"append_images": others, "duration": milliseconds}
    first.save(content, kind, save_all=True, loop=0, **options)
    return content.getvalue()
