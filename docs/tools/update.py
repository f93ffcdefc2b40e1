"""Write what the examples show into the pages, and their pictures into `docs/pictures/`: those that are named, or all.

python -m docs.tools.update [PAGE.md ..]
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from docs.tools.examples import compare, pictures_of, run_page, with_shown
from docs.tools.given import provide
from workbench.errors import close_names

DOCS = Path(__file__).resolve().parents[1]
LARGEST = 60_000  # bytes of a picture
_WIDEST = 1152  # [px], as most pictures are drawn
# Width over the widest, and colours: few of these shift light shades, so they come last.
_SMALLER = ((1.0, 256), (0.92, 256), (0.83, 256), (0.83, 64), (0.83, 32))


def main(arguments: list[str]) -> int:
    """Update the named pages, or all; 1 if something is left that does not agree, 2 if there is no such page."""
    if {"-h", "--help"} & set(arguments):
        sys.stdout.write(f"{__doc__}\n")
        return 0
    every = sorted(DOCS.rglob("*.md"))
    pages = [Path(a).resolve() for a in arguments] or every
    for page in pages:
        if page not in every:
            near = close_names(page.name, [known.name for known in every])[:1]
            meant = ", ".join(f"docs/{known.relative_to(DOCS)}" for known in every if known.name in near)
            sys.stderr.write(f"{page}: no such page; {f'did you mean {meant}?' if near else f'they are in {DOCS}'}\n")
            return 2
    return max(map(_update, pages), default=0)


def _update(path: Path) -> int:
    page = path.read_text(encoding="utf-8")
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if not provide(page, folder):
            sys.stdout.write(f"{path.relative_to(DOCS)}: not run, the FMU of another tool is missing\n")
            return 0
        shown = run_page(page, folder)
        path.write_text(with_shown(page, shown), encoding="utf-8")
        for owner, picture in pictures_of(page):
            if owner == path.stem and not (folder / picture).exists():
                sys.stdout.write(f"{path.relative_to(DOCS)}: {picture} is of no block and stays as it is\n")
            elif owner == path.stem:
                (DOCS / "pictures" / owner).mkdir(parents=True, exist_ok=True)
                _keep(folder / picture, DOCS / "pictures" / owner / picture)
    # What was written in place agrees by itself; blocks with gaps are the author's.
    left = [words for one in shown if one.gaps for words in compare([one])]
    for words in left:
        sys.stdout.write(f"{path.relative_to(DOCS)}: {words}\n")
    if shown:
        sys.stdout.write(f"{path.relative_to(DOCS)}: {len(shown)} runs, {time.monotonic() - begin:.1f} s\n")
    return 1 if left else 0


def _keep(source: Path, target: Path) -> None:
    """Copy a picture, as large as its size on disk allows, its colours so chosen that those of small marks stay."""
    if source.suffix != ".png":
        shutil.copy(source, target)
        return
    with Image.open(source) as picture:
        whole = picture.convert("RGB")
    for width, colours in _SMALLER:
        small = whole.copy()
        small.thumbnail((round(width * _WIDEST), whole.height), Image.Resampling.LANCZOS)
        few = small.quantize(colors=colours, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(target, optimize=True)
        if target.stat().st_size <= LARGEST:
            return


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
