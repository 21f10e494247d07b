"""Make the pictures of the gallery again: python docs/gallery.py [WORD of a heading …].

Under each heading of the page stand the commands and, by its name, the picture that they write.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).resolve().parent
PAGE = HERE / "gallery.md"
CASES = HERE / "gallery"
PICTURES = HERE / "pictures" / "gallery"
ENTRY = re.compile(r"^## (.+?)\n\n```text\n(.*?)```.*?\]\(pictures/gallery/(.+?)\)$", re.M | re.S)
WIDTH = 720
"""Largest width of a picture [pixels]."""
LARGEST = 60_000
"""Largest size of a picture [bytes]."""


def entries() -> list[tuple[str, list[list[str]], str]]:
    """Heading, commands without `drcmitsuba`, and name of the picture, of each entry."""
    found = ENTRY.findall(PAGE.read_text(encoding="utf-8"))
    return [
        (head, [line.split()[1:] for line in text.splitlines()], name) for head, text, name in found
    ]


def save(picture: Path, path: Path) -> None:
    """Save a picture with few colours, made smaller until its file is small enough."""
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    width = min(WIDTH, image.width)
    while True:
        size = (width, round(image.height * width / image.width))
        small = image.resize(size, Image.Resampling.LANCZOS)
        small.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size <= LARGEST:
            return
        width = round(width * 0.9)


def main(words: list[str]) -> None:
    """Run the commands of the entries whose headings have one of the words, or of all."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    for head, commands, name in entries():
        if words and not any(word.lower() in head.lower() for word in words):
            continue
        print(head, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(CASES, folder, dirs_exist_ok=True)
            for command in commands:
                program = [sys.executable, "-m", "drcmitsuba.cli", *command]
                subprocess.run(program, cwd=folder, check=True, stdout=subprocess.DEVNULL)
            save(next(iter(sorted(Path(folder).rglob(f"*{name}")))), PICTURES / name)


if __name__ == "__main__":
    main(sys.argv[1:])
