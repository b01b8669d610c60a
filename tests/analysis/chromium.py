"""A real browser for the pages: Debian's chromium, driven by selenium, with a profile of its own."""

import base64
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--force-color-profile=srgb",
)
SIZES = {"desktop": (1280, 900), "phone": (390, 844)}


def why_not() -> str:
    """Why no browser is available, '' if one is."""
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        return "no chromium and chromedriver on the path (apt-get install chromium chromium-driver)"
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "no selenium (pip install 'sumo-adas[dev]')"
    return ""


@contextmanager
def browser(profile: Path) -> Iterator[Any]:
    """A headless chromium with a fresh profile in `profile`."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(str(shutil.which("chromedriver"))))
    driver.set_script_timeout(60)
    try:
        yield driver
    finally:
        driver.quit()


def open_page(driver: Any, page: Path, size: str = "desktop") -> None:
    """Open a page at a size, and wait until its plots, if any, are drawn."""
    width, height = SIZES[size]
    driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": size == "phone"},
    )
    driver.get(page.resolve().as_uri())
    driver.execute_async_script(
        "const done = arguments[0], wait = () => !document.getElementById('scene')"
        " || document.documentElement.dataset.plots"
        " ? requestAnimationFrame(() => requestAnimationFrame(done))"
        " : setTimeout(wait, 20); wait();"
    )


def complaints(driver: Any) -> list[str]:
    """Console messages since the last call."""
    return [entry["message"] for entry in driver.get_log("browser")]


def picture(driver: Any, selector: str | None = None) -> np.ndarray:
    """(H, W, 3) BGR of an element, or of the whole page."""
    box = driver.execute_script(
        "const e = arguments[0] ? document.querySelector(arguments[0]) : document.documentElement;"
        "const r = e.getBoundingClientRect();"
        "const height = Math.max(r.height, arguments[0] ? 0 : e.scrollHeight);"
        "return [r.x + scrollX, r.y + scrollY, r.width, height];",
        selector,
    )
    clip = dict(zip(("x", "y", "width", "height"), box, strict=True)) | {"scale": 1}
    shot = driver.execute_cdp_cmd("Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip})
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(shot["data"]), np.uint8), cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.asarray(decoded)
