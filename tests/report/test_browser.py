"""The page in a browser: it fits the window, shows its figures, sorts its tables, and opens its folds for print.

Needs Chromium or Chrome; skipped where there is none.
"""

import json
import re
import shutil
import subprocess
from html import escape
from pathlib import Path

import pytest

from bayesdamp.report.sections import render

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), "")
pytestmark = pytest.mark.skipif(not BROWSER, reason=f"no browser: none of {', '.join(NAMES)} is installed")

WIDTHS = (1280, 390)
HEIGHT = 900
PROBE = """<script>
const visible = (element) => element.getClientRects().length > 0;
const box = (element) => element.getBoundingClientRect();
const out = {width: innerWidth, page: document.documentElement.scrollWidth};
out.broken = [...document.images].filter((i) => visible(i) && !i.naturalWidth).length;
out.figures = [...document.images].filter(visible).length;
out.smallest = Math.min(...[...document.querySelectorAll("main *")].filter((e) => visible(e) && e.children.length === 0
  && e.textContent.trim() && !e.closest("svg, sub")).map((e) => parseFloat(getComputedStyle(e).fontSize)));
out.scrolled = [...document.querySelectorAll(".scroll, figure > div")].filter((e) => e.scrollWidth > e.clientWidth + 1
  && getComputedStyle(e).overflowX !== "auto").length;
out.scales = [...document.images].filter(visible).map((i) => box(i).width / parseFloat(i.style.width));
const table = [...document.querySelectorAll("table")].find((t) => visible(t) && t.tHead.querySelector("[aria-sort]"));
const column = (i) => [...table.tBodies[0].rows].map((r) => r.cells[i].textContent);
if (table) {
  const heads = [...table.tHead.rows[0].cells];
  heads[0].click(); out.up = column(0); heads[0].click(); out.down = column(0);
  out.sort = heads[0].getAttribute("aria-sort");
}
const folded = () => document.querySelectorAll("details:not([open])").length;
out.folded = folded(); dispatchEvent(new Event("beforeprint")); out.printing = folded();
dispatchEvent(new Event("afterprint")); out.after = folded();
const result = parent.document.createElement("pre");
result.id = "probe"; result.textContent = JSON.stringify(out); parent.document.body.replaceChildren(result);
</script>"""


COMMAND = (
    BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--virtual-time-budget=4000",
    "--window-size=1400,1000", "--dump-dom",
)  # fmt: skip


def probed(html: str, folder: Path, width: int) -> dict:
    """Return the measurements of PROBE on a page in a window of this width."""
    at = folder / f"probe{width}.html"
    # In a frame: a window of its own is never narrower than 500 pixels.
    inside = escape(html.replace("</body>", f"{PROBE}</body>"))
    frame = f'<iframe width="{width}" height="{HEIGHT}" style="border:0" srcdoc="{inside}"></iframe>'
    at.write_text(f'<!DOCTYPE html><meta charset="utf-8"><body>{frame}</body>', encoding="utf-8")
    process = subprocess.run([*COMMAND, at.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    probes = re.search(r'<pre id="probe">(.*?)</pre>', process.stdout, re.DOTALL)
    assert probes, "the page's script did not run to its end"
    return json.loads(probes[1].replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&"))


@pytest.fixture(scope="module")
def html(whole_run: Path) -> str:
    return render(whole_run).read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def probes(html: str, tmp_path_factory) -> dict[int, dict]:
    folder = tmp_path_factory.mktemp("browser")
    return {width: probed(html, folder, width) for width in WIDTHS}


def test_nothing_is_wider_than_the_window_and_text_is_legible(probes, html, tmp_path):
    """Letters in figures have at least 7 pt, so a figure on a phone must have at least 3/4 of its size.

    Control: a block of 3,000 pixels."""
    for width in WIDTHS:
        assert probes[width]["width"] == width
        assert probes[width]["page"] <= width
        assert probes[width]["scrolled"] == probes[width]["broken"] == 0
        assert probes[width]["figures"] > 5
        assert probes[width]["smallest"] >= 12
    assert min(probes[390]["scales"]) >= 0.75
    wide = html.replace("<main>", '<main><div style="width:3000px">wide</div>')
    assert probed(wide, tmp_path, 390)["page"] > 2900


def test_tables_sort(probes):
    probe = probes[1280]
    assert probe["up"] != probe["down"]
    assert sorted(probe["up"]) == sorted(probe["down"])
    assert probe["sort"] == "descending"


def test_collapsed_sections_are_open_in_print(probes):
    probe = probes[1280]
    assert probe["folded"] > 3
    assert probe["printing"] == 0
    assert probe["after"] == probe["folded"]
