"""report.html in headless Chromium: it draws, its controls work, it prints, and it asks no network for anything.

Each page is opened with two scripts added: one before all others that notes errors, and one at the end that uses the
controls and writes what became of the picture into the page, which Chromium then prints.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from stickslip.workflows.commands.report import report
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read

pytestmark = pytest.mark.slow
SCENES = ("block", "cad_part", "fretting")
LARGEST = 10e6  # bytes
LIMIT = 120  # s for Chromium
NAMES = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-dev-shm-usage", "--disable-background-networking", "--no-first-run"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a graphics card
    *("--virtual-time-budget=20000", "--enable-logging=stderr", "--window-size=1200,1600", "--hide-scrollbars"),
)
ASKED = re.compile(r'"initiator":"(?!not an origin).*"url":"(https?://[^"]*)"')  # by a page, not by Chromium itself
NOTES = """<script>
const noted = [];
addEventListener("error", (event) => noted.push(`${event.message}`));
addEventListener("unhandledrejection", (event) => noted.push(`${event.reason}`));
addEventListener("securitypolicyviolation", (event) => noted.push(`refused: ${event.blockedURI}`));
for (const kind of ["error", "warn"]) console[kind] = (...words) => noted.push(words.join(" "));
</script>"""
USE = """<script>
addEventListener("load", async () => {
  const $ = (id) => document.getElementById(id), canvas = $("canvas"), gl = canvas.getContext("webgl2");
  const pixels = () => {
    const found = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, found);
    return found;
  };
  const wait = () => new Promise((done) => setTimeout(done, 100));
  let last = pixels();
  const share = (test) => {
    let count = 0;
    for (let k = 0; k < last.length; k += 4) count += test(k);
    return 4 * count / last.length;
  };
  const colours = () => new Set(new Uint32Array(last.buffer)).size;
  const changed = async (act) => {
    const before = last;
    act();
    await wait();
    last = pixels();
    return share((k) => before[k] !== last[k] || before[k + 1] !== last[k + 1] || before[k + 2] !== last[k + 2]);
  };
  const set = (id, value) => () => { $(id).value = value; $(id).dispatchEvent(new Event("input")); };
  const mouse = { pointerId: 1, button: 0, buttons: 1, pointerType: "mouse", bubbles: true };
  const pointer = (type, x, y) => canvas.dispatchEvent(new PointerEvent(type, { ...mouse, clientX: x, clientY: y }));
  const drag = () => {
    pointer("pointerdown", 400, 400);
    pointer("pointermove", 520, 460);
    pointer("pointerup", 520, 460);
  };
  canvas.setPointerCapture = canvas.releasePointerCapture = () => {}; // these refuse pointers that are not there
  const told = { drawn: share((k) => last[k] + last[k + 1] + last[k + 2] < 750), colours: colours() };
  told.time = await changed(set("time", 0));
  told.factor = await changed(set("factor", $("factor").max));
  for (const quantity of ["von Mises stress", "contact pressure", "contact status"]) {
    told[quantity] = await changed(set("quantity", quantity));
  }
  told.lines = await changed(() => $("lines").click());
  told.turned = await changed(drag);
  told.home = await changed(() => $("home").click());
  told.noted = noted;
  told.loaded = performance.getEntriesByType("resource").map((entry) => entry.name.slice(0, 60));
  const outcome = document.createElement("pre");
  outcome.id = "outcome";
  outcome.textContent = JSON.stringify(told);
  document.body.append(outcome);
});
</script>"""


@pytest.fixture(scope="module", params=SCENES)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a ready scene."""
    folder = tmp_path_factory.mktemp(request.param)
    run(read(request.param), folder / "out")
    report(folder / "out", folder / "page.html")
    return folder / "page.html"


def chromium(page: Path, *words: str) -> tuple[str, str]:
    """Open a page: what Chromium prints on stdout and stderr."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    assert program is not None, "these tests need Chromium: make browser"
    command = [program, *OPTIONS, f"--user-data-dir={page.parent / 'profile'}", *words, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


def used(page: Path) -> dict[str, Any]:
    """What the picture did when the controls were used: shares of the picture that changed."""
    text = page.read_text()
    tried = page.with_name("tried.html")
    tried.write_text(text.replace("<title>", f"{NOTES}<title>", 1).replace("</body>", f"{USE}</body>"))
    found = re.search(r'<pre id="outcome">(.*?)</pre>', chromium(tried, "--dump-dom")[0])
    assert found is not None, "the page does not come to its end"
    told: dict[str, Any] = json.loads(found[1].replace("&gt;", ">").replace("&lt;", "<").replace("&amp;", "&"))
    return told


def test_the_page_draws_and_its_controls_work(made: Path) -> None:
    told = used(made)
    assert told["noted"] == []
    assert told["loaded"] == []
    assert told["drawn"] > 0.1
    assert told["colours"] > 50
    for what in ("time", "factor", "von Mises stress", "contact pressure", "contact status", "lines", "turned", "home"):
        assert told[what] > 1e-3, f"{what} changes nothing: {told}"


def test_the_page_asks_for_nothing_and_says_nothing_on_the_console(made: Path) -> None:
    picture, log = made.with_name("page.png"), made.with_name("net.json")
    _, err = chromium(made, f"--screenshot={picture}", f"--log-net-log={log}")
    assert "CONSOLE" not in err
    assert picture.stat().st_size > 50_000
    assert ASKED.findall(log.read_text(errors="replace")) == []
    assert made.stat().st_size < LARGEST


def test_a_page_that_asks_is_noticed(tmp_path: Path) -> None:
    page, log = tmp_path / "asks.html", tmp_path / "net.json"
    page.write_text('<script>console.log("hear")</script><img src="http://stickslip.invalid/x.png">')
    _, err = chromium(page, f"--screenshot={tmp_path / 'page.png'}", f"--log-net-log={log}")
    assert "CONSOLE" in err
    assert set(ASKED.findall(log.read_text(errors="replace"))) == {"http://stickslip.invalid/x.png"}


def test_the_page_prints(made: Path) -> None:
    printed = made.with_name("page.pdf")
    chromium(made, f"--print-to-pdf={printed}", "--no-pdf-header-footer")
    content = printed.read_bytes()
    assert content.startswith(b"%PDF")
    assert 3 <= len(re.findall(rb"/Type\s*/Page\b", content)) <= 20
    assert len(re.findall(rb"/Subtype\s*/Image", content)) >= 3, "the pictures and the view"
