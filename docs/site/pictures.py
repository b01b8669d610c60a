"""The pictures of the README and the site, by the project's own commands: `make pictures`.

Pages are photographed by chromium (Debian: apt-get install chromium); PNGs are brought down to 256 colours.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parents[1] / "pictures"
RUN = Path("out/pictures")


def main() -> None:
    """Run the commands, write docs/pictures/*.png; exit status 1 without chromium."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("no chromium: the page cannot be photographed")
    HERE.mkdir(exist_ok=True)
    command("run", "highway", "--seed", "1", "--duration", "60", "--out", RUN)
    command("video", RUN, "--out", HERE / "drive.png")
    command("plot", RUN, "timeline", "--out", HERE / "timeline.png")
    command("report", RUN, "--no-frames")
    photograph(browser, RUN / "report.html", HERE / "report.png", (1280, 1000))
    for picture in HERE.glob("*.png"):
        shrink(picture)


def command(*words: str | Path) -> None:
    """Run a command of sumo-adas, in this environment."""
    print("sumo-adas", *words, flush=True)
    code = "from analysis.cli import main; main()"
    subprocess.run([sys.executable, "-c", code, *map(str, words)], check=True)


def photograph(browser: str, page: Path, out: Path, size_px: tuple[int, int]) -> None:
    """The upper part of a page, as a window of size_px (width, height) shows it."""
    with tempfile.TemporaryDirectory() as profile:  # chromium's own, and gone afterwards
        options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        size = f"--window-size={size_px[0]},{size_px[1]}"
        where = [f"--user-data-dir={profile}", f"--screenshot={out.resolve()}", page.resolve().as_uri()]
        words = [browser, *options, size, "--virtual-time-budget=5000", *where]
        subprocess.run(words, check=True, capture_output=True, timeout=300)


def shrink(picture: Path, widest_px: int = 1280) -> None:
    """At most so wide, 256 colours of its own."""
    image = Image.open(picture).convert("RGB")
    if image.width > widest_px:
        image = image.resize((widest_px, round(image.height * widest_px / image.width)))
    image.quantize(256, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    main()
