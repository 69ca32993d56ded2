"""Draws docs/experiment_plan.png and docs/experiment_effects.png: those of the study of docs/study_in_a_day.md."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

DOCS = Path(__file__).parent
HIGHFIVE = [sys.executable, "-m", "highfive.hil.cli.main", "experiment"]
PEOPLE = [f"P{number:02d}" for number in range(9)]  # of whom the first is the pilot


def main() -> None:
    """Plans the study, has simulated participants answer as the page says, and analyses it."""
    observer = re.search(r"cat > observer\.toml <<'END'\n(.*?)END\n", (DOCS / "study_in_a_day.md").read_text(), re.S)
    assert observer is not None, "the page no longer says how well participants answer"
    with TemporaryDirectory() as folder:
        Path(folder, "observer.toml").write_text(observer[1])
        _run(folder, "plan", "--template", "high_five")
        for study, people in (("four", "4"), ("study", "8")):
            _run(folder, "plan", "high_five.toml", "--study", study, "--participants", people)
        for who in PEOPLE:
            answers = ("--participant", who, "--no-avatar", "--simulate-participant", "observer.toml")
            _run(folder, "run", "--study", "study", *answers)
        _run(folder, "analyse", "study", "--out", "results")
        for picture, name in (("four/plan.png", "plan"), ("results/figures/effects.png", "effects")):
            shutil.copyfile(Path(folder, picture), DOCS / f"experiment_{name}.png")


def _run(folder: str, *words: str) -> None:
    subprocess.run([*HIGHFIVE, *words], cwd=folder, check=True, capture_output=True)


if __name__ == "__main__":
    main()
