"""Frame number as black and white squares in the corner of a picture."""

import numpy as np
from numpy.typing import NDArray

BITS = 20
SIDE = 16  # side of a square in pixels: a whole JPEG block, so that it stays black or white


def stamp(pixels: NDArray[np.uint8], number: int) -> None:
    """Draw ``number`` (below 2^20) into the upper left corner, and its inverted bits below."""
    for row, value in enumerate((number, ~number)):
        for bit in range(BITS):
            square = pixels[row * SIDE : (row + 1) * SIDE, bit * SIDE : (bit + 1) * SIDE]
            square[:] = 255 if value >> bit & 1 else 0


def read_in_page(picture: str) -> str:
    """Script that records, in each frame of the browser, the number about to be shown.

    ``picture`` is an expression for the element, or null. ``window.seenFrames`` has rows of the
    number and the time in ms.
    """
    return f"""
() => {{
  const bits = {BITS}, side = {SIDE};
  const canvas = document.createElement("canvas");
  canvas.width = bits * side;
  canvas.height = 2 * side;
  const pen = canvas.getContext("2d", {{ willReadFrequently: true }});
  const seen = (window.seenFrames = []);
  let last = -1;
  function read() {{
    const image = {picture};
    if (image && image.complete !== false && image.naturalWidth !== 0) {{
      pen.drawImage(image, 0, 0, canvas.width, canvas.height, 0, 0, canvas.width, canvas.height);
      const data = pen.getImageData(0, 0, canvas.width, canvas.height).data;
      const lit = (row, bit) =>
        data[4 * ((row * side + side / 2) * canvas.width + bit * side + side / 2)] > 127;
      let number = 0, whole = true;
      for (let bit = 0; bit < bits; bit++) {{
        if (lit(0, bit)) number += 2 ** bit;
        whole = whole && lit(0, bit) !== lit(1, bit);
      }}
      if (whole && number !== last) {{
        last = number;
        seen.push([number, performance.timeOrigin + performance.now()]);
      }}
    }}
    requestAnimationFrame(read);
  }}
  requestAnimationFrame(read);
}}
"""
