"""Draws docs/experiment_run.jpg: the experimenter's page of ``highfive experiment run``, and the participant's.

Needs Chromium. Where there is no graphics card the processor draws the same, which takes a while.
"""

import re
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

from highfive.hil.view.browser import Browser

SIZE, PATIENCE_S = (900, 620), 240.0
HIGHFIVE = [sys.executable, "-m", "highfive.hil.cli.main", "experiment"]
SAYS = "document.querySelector('.participant')?.className ?? ''"
GO = "document.querySelector('.participant .go')?.click()"


def main() -> None:
    """Plays the first trial of a study, and keeps what both pages show as the question is asked."""
    with TemporaryDirectory() as folder:
        for words in (("--template", "high_five"), ("high_five.toml", "--study", "study", "--participants", "2")):
            subprocess.run([*HIGHFIVE, "plan", *words], cwd=folder, check=True, capture_output=True)
        command = [*HIGHFIVE, "run", "--study", "study", "--participant", "P00", "--consent", "1", "--no-open"]
        with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as served:
            assert served.stderr is not None
            try:
                address = next(found[0] for line in served.stderr if (found := re.search(r"http://\S+", line)))
                with Browser(SIZE) as experimenter, Browser(SIZE) as participant:
                    experimenter.go(address)
                    participant.go(f"{address}&role=participant")
                    _wait(participant, "ready")
                    participant.evaluate(GO)
                    _wait(participant, "question")
                    pictures = []
                    for number, browser in enumerate((experimenter, participant)):
                        shot = Path(folder, f"{number}.png")
                        browser.picture(shot)
                        pictures.append(Image.open(shot).convert("RGB"))
            finally:
                served.terminate()
    both = Image.new("RGB", (2 * SIZE[0], SIZE[1]))
    for number, picture in enumerate(pictures):
        both.paste(picture.resize(SIZE), (number * SIZE[0], 0))
    both.save(Path(__file__).with_name("experiment_run.jpg"), quality=85, optimize=True)


def _wait(page: Browser, phase: str) -> None:
    """Until the participant's page is at a phase."""
    end = time.monotonic() + PATIENCE_S
    while phase not in str(page.evaluate(SAYS)).split():
        if time.monotonic() > end:
            raise SystemExit(f"the page did not come to {phase} within {PATIENCE_S:g} s")
        time.sleep(0.2)


if __name__ == "__main__":
    main()
