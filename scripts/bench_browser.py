"""How quick the browser workbench is: first paint, point to drawn, frames while 5,000 points are moved, weight.

Times in seconds of a quiet machine; nothing fails here. Needs Chromium and the extra `dev`.

    scripts/bench_browser.py
"""

from __future__ import annotations

import http.client
import importlib.metadata
import json
import re
import shutil
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from playwright.sync_api import Page, expect, sync_playwright  # noqa: E402

import workbench as wb  # noqa: E402
from tests.ui_server import Ui, browser_workbench  # noqa: E402

POINTS = 5000
NEEDED = ("starlette", "uvicorn", "h11", "click", "anyio", "idna", "tomlkit")

# Each picture begins with an empty canvas.
WATCH = """
    window.drawn = [];
    const clear = CanvasRenderingContext2D.prototype.clearRect;
    CanvasRenderingContext2D.prototype.clearRect = function (...all) {
      window.drawn.push(Date.now());
      return clear.apply(this, all);
    };
"""
FRAMES = """() => {
    window.frames_seen = [];
    const next = (now) => { window.frames_seen.push(now); window.counting = requestAnimationFrame(next); };
    window.counting = requestAnimationFrame(next);
}"""


def listen(ui: Ui, heard: list[float]) -> None:
    """Note when the server tells of each point [ms]."""
    link = http.client.HTTPConnection(ui.host, timeout=60)
    link.request("GET", "/api/events?last=0", headers={"Host": ui.host, "Cookie": ui.cookie})
    answer = link.getresponse()
    while True:
        line = answer.readline()
        if not line:
            return
        if line.startswith(b"data:"):
            event = json.loads(line[5:])
            if event.get("event") == "progress" and event.get("point"):
                heard.append(1e3 * time.time())
            if event.get("command") == "nfr" and event.get("state") == "done":
                return


def first_paint(page: Page, ui: Ui, begin: float) -> float:
    """Return when the page was first drawn, after the command began [s]."""
    page.goto(ui.address)
    expect(page.locator("h1")).to_be_visible()
    painted = page.evaluate(
        "performance.timeOrigin + performance.getEntriesByName('first-contentful-paint')[0].startTime"
    )
    return float(painted) / 1e3 - begin


def to_drawn(page: Page, ui: Ui) -> tuple[list[float], int]:
    """Return for each point how long it took from the server to the picture [ms], and how many points there were."""
    heard: list[float] = []
    page.goto(f"{ui.base}/#/open/fmu:Rudder/measure/nfr")
    page.fill("#field-amplitudes", "1,2,4,8")
    page.fill("#field-frequencies", ",".join(f"{f:.6g}" for f in np.geomspace(0.5, 20.0, 18)))
    listener = threading.Thread(target=listen, args=(ui, heard))
    listener.start()
    page.click("text=Run nfr")
    expect(page.locator("strong", has_text=re.compile("^done$"))).to_be_visible(timeout=60_000)
    listener.join(10.0)
    drawn = page.evaluate("window.drawn")
    return [min((d for d in drawn if d >= h), default=np.nan) - h for h in heard], len(heard)


def frames(page: Page, ui: Ui) -> float:
    """Return frames per second while 5,000 points are moved by the mouse."""
    with wb.load("fmu:FirstOrderLag") as model:
        wb.nfr(
            model, "u", "y", np.geomspace(1e-2, 1e2, POINTS), [1.0], store=ui.folder / "many", drift_check=False,
            in_process=True,
        )  # fmt: skip
    page.goto(f"{ui.base}/")
    page.click("a[data-name='many']")
    expect(page.locator("h1")).to_have_text("Store many")
    expect(page.locator(".legend li")).to_have_count(1)
    box = page.locator("main canvas").first.bounding_box()
    assert box is not None  # noqa: S101
    x, y = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate(FRAMES)
    for k in range(240):
        page.mouse.move(x + 100.0 * np.sin(k / 20.0), y + 40.0 * np.cos(k / 20.0))
    seen = page.evaluate("(cancelAnimationFrame(window.counting), window.frames_seen)")
    page.mouse.up()
    return float(1e3 * (len(seen) - 1) / (seen[-1] - seen[0]))


# The nearest point is looked for at each movement of the mouse.
NEAREST = """() => {
    const canvas = document.querySelector('main canvas');
    const box = canvas.getBoundingClientRect();
    const begin = performance.now();
    for (let k = 0; k < 100; k += 1) {
        const place = { clientX: box.x + box.width * (0.2 + 0.006 * k), clientY: box.y + 100, bubbles: true };
        canvas.dispatchEvent(new PointerEvent('pointermove', place));
    }
    return (performance.now() - begin) / 100;
}"""


def weight() -> tuple[float, float]:
    """Return what the page and the packages that it needs take on disk [kB]."""
    page = sum(f.stat().st_size for f in (ROOT / "workbench" / "ui").rglob("*") if f.suffix in {".js", ".css", ".html"})
    packages = 0
    for name in NEEDED:
        for f in importlib.metadata.files(name) or ():
            file = Path(str(f.locate()))
            packages += file.stat().st_size if file.suffix != ".pyc" and file.is_file() else 0
    return page / 1e3, packages / 1e3


def main() -> None:
    """Measure and print."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with tempfile.TemporaryDirectory() as name, sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_context(viewport={"width": 1200, "height": 900}).new_page()
        page.add_init_script(WATCH)
        begin = time.time()
        with browser_workbench(Path(name)) as ui:
            listening = time.time() - begin
            print(f"listening {listening:.2f} s, first paint {first_paint(page, ui, begin):.2f} s after the command")
            late, count = to_drawn(page, ui)
            print(
                f"point to drawn: median {statistics.median(late):.0f} ms, largest {max(late):.0f} ms, {count} points"
            )
            print(f"{POINTS} points moved: {frames(page, ui):.0f} frames/s")
            print(f"nearest of {POINTS} points: {page.evaluate(NEAREST):.2f} ms")
        browser.close()
    page_size, packages = weight()
    print(f"page {page_size:.0f} kB, packages {packages:.0f} kB")


if __name__ == "__main__":
    main()
