"""Draws docs/live_page.jpg: the page of ``highfive view`` shortly before a contact, as a graphics card draws it.

Needs Chromium. Where there is no graphics card the processor draws the same, which takes a while.
"""

import re
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from highfive.hil.view.browser import Browser

SIZE, TRIAL, BEFORE_S = (1200, 680), 1, 0.1
CARD = (  # the page asks the browser who draws
    "const asked = WebGL2RenderingContext.prototype.getParameter;"
    "WebGL2RenderingContext.prototype.getParameter = function (name)"
    " { return name === 37446 ? 'a graphics card' : asked.call(this, name); };"
    "window.requestAnimationFrame = again => { window.next = again; return 0; };"  # few pictures are enough
)
READY = """new Promise(done => {const look = setInterval(() => {
if (window.highfive?.stage?.ready && highfive.state().trials) {clearInterval(look); done()}}, 50)})"""
STILL = """(async () => {
  const {stage, connection, motion} = highfive, wait = ms => new Promise(r => setTimeout(r, ms));
  stage.quality.judge = () => false;
  connection.command("trial", %d);
  await wait(900);
  connection.command("again");
  await wait(700);
  const left = highfive.state().contact_s - %g;
  while (motion.newest.time < left - 0.02) await wait(5);
  connection.command("pause", true);
  connection.command("seek", left);
  await wait(900);
  for (const _ of [1, 2, 3]) { next(performance.now()); await wait(1400); }
  for (let i = 0; i < 20; i++) {  // figures of a moment in which this computer does nothing else
    Object.assign(connection.counts, {poses: 0, lost: 0});
    await wait(2000);
    if (connection.counts.poses > 230 && !connection.counts.lost) break;
  }
})()"""


def main() -> None:
    """Plays the recording that comes along, stops it, and keeps what the browser shows."""
    command = [sys.executable, "-m", "highfive.hil.cli.main", "view", "--no-open"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as served, TemporaryDirectory() as folder:
        assert served.stderr is not None
        address = next(found[0] for line in served.stderr if (found := re.search(r"http://\S+", line)))
        shot = Path(folder, "page.png")
        try:
            with Browser(SIZE) as browser:
                browser.call("Page.addScriptToEvaluateOnNewDocument", source=CARD)
                browser.go(address)
                browser.evaluate(READY)
                browser.evaluate(STILL % (TRIAL, BEFORE_S))
                browser.picture(shot)
        finally:
            served.terminate()
        picture = Image.open(BytesIO(shot.read_bytes())).convert("RGB")
    out = Path(__file__).with_name("live_page.jpg")
    picture.save(out, quality=90, optimize=True)
    print(f"{out.name}: {out.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
