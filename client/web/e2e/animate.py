"""Puts pictures together as one that moves: animate.py FOLDER_OF_PNGS OUT.webp."""

import sys
from pathlib import Path

from PIL import Image

FRAME_MS = 90
LAST_FRAME_MS = 1500
WIDTH = 460
# Small enough for the first screen of a page.
QUALITY = 80

folder, out = map(Path, sys.argv[1:])
pictures = [Image.open(path).convert("RGB") for path in sorted(folder.glob("*.png"))]
height = round(WIDTH * pictures[0].height / pictures[0].width)
pictures = [picture.resize((WIDTH, height), Image.Resampling.LANCZOS) for picture in pictures]
durations = [FRAME_MS] * (len(pictures) - 1) + [LAST_FRAME_MS]
pictures[0].save(
    out, save_all=True, append_images=pictures[1:], duration=durations, loop=0, quality=QUALITY, method=6
)
print(f"{out}: {len(pictures)} pictures, {out.stat().st_size / 1e6:.2f} MB")
