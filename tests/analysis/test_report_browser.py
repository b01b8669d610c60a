"""The report page in a real browser: it opens, draws, responds, fits a phone, and runs no hostile text."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.report import write_report
from analysis.report.page import write_html
from analysis.report.run_page import run_page
from analysis.report.viewer import viewer_data
from tests.analysis import chromium
from tests.analysis.report_tables import HOSTILE, made_drive, write_campaign, write_recording, write_run

pytestmark = pytest.mark.skipif(bool(chromium.why_not()), reason=chromium.why_not() or "there is one")

PARTS = {"run": ["#map", "#timeline", "#camera", "#birdseye"], "campaign": [], "recording": []}
CHOOSE = """
    const list = document.getElementById('vehicle');
    list.value = arguments[0];
    list.dispatchEvent(new Event('change'));
"""
PICTURES = {"run": 7, "campaign": 10, "recording": 2}


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    with chromium.browser(tmp_path_factory.mktemp("profile")) as one:
        yield one


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    page = run_page(write_run(folder / "run", HOSTILE), frames=False)
    page.drives = [viewer_data(made_drive(name)) for name in HOSTILE]
    return {
        "run": write_html(page, folder / "run.html"),
        "campaign": write_report(write_campaign(folder / "campaign")),
        "recording": write_report(write_recording(folder / "recording")),
    }


@pytest.mark.parametrize("size", chromium.SIZES)
@pytest.mark.parametrize("kind", ["run", "campaign", "recording"])
def test_page_opens_whole_and_in_order(kind: str, size: str, driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages[kind], size)
    assert chromium.complaints(driver) == []
    assert driver.execute_script("return document.documentElement.scrollWidth") <= chromium.SIZES[size][0]
    widths = driver.execute_script("return Array.from(document.images, image => image.naturalWidth)")
    assert len(widths) == PICTURES[kind]
    assert min(widths) > 100
    boxes = np.array(
        driver.execute_script(
            "return Array.from(document.querySelectorAll('header, section, footer'),"
            " e => { const r = e.getBoundingClientRect(); return [r.top, r.bottom, r.left, r.right]; })"
        )
    )
    assert (boxes[1:, 0] >= boxes[:-1, 1] - 0.5).all()  # one under the other
    assert (boxes[:, 1] - boxes[:, 0] > 20).all()
    for selector in [*PARTS[kind], ".card"]:
        assert _drawn(chromium.picture(driver, selector)) > 0.01, selector
    page = chromium.picture(driver)
    empty = np.flatnonzero(np.diff(np.flatnonzero(page.std(axis=(1, 2)) > 3.0)) > 400)
    assert not len(empty)  # no empty gap of half a screen


def _drawn(picture: np.ndarray) -> float:
    """Share of pixels that differ from the commonest grey."""
    grey = picture.mean(axis=2).astype(int)
    return float((np.abs(grey - np.bincount(grey.ravel()).argmax()) > 12).mean())


def test_texts_of_a_run_do_nothing(driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages["run"])
    options = driver.execute_script(
        "return Array.from(document.querySelectorAll('#vehicle option'), o => o.value)"
    )
    assert sorted(options) == sorted(HOSTILE)
    for name in HOSTILE:  # every drawing with each of them
        driver.execute_script(
            CHOOSE,
            name,
        )
    driver.execute_script(
        "Plotly.Fx.hover(document.getElementById('map'), [{curveNumber: 4, pointNumber: 0},"
        " {curveNumber: 4, pointNumber: 1}, {curveNumber: 4, pointNumber: 2}]);"
    )
    hover = driver.execute_script("return document.querySelector('#map .hoverlayer').textContent")
    assert any(name[:12] in hover for name in HOSTILE)  # shown as they are written
    assert driver.execute_script("return window.hacked === undefined")
    assert driver.execute_script("return document.querySelectorAll('img:not([alt]), b').length") == 0
    fetched = driver.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in fetched if not name.startswith(("data:", "blob:"))] == []
    assert chromium.complaints(driver) == []


def test_slider_answers(driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages["run"])
    waits, seen = [], []
    for index in (0, 7, 20, 33, 39):
        waits.append(
            driver.execute_async_script(
                "const [index, done] = arguments, slider = document.getElementById('slider');"
                "slider.value = index; const begin = performance.now();"
                "slider.dispatchEvent(new Event('input'));"
                "const wait = () => slider.dataset.drawn === String(index)"
                " ? requestAnimationFrame(() => done(performance.now() - begin)) : setTimeout(wait, 1);"
                "wait();",
                index,
            )
        )
        row = driver.execute_script(
            "const c = document.getElementById('camera');"
            "return Array.from(c.getContext('2d').getImageData(0, 20, c.width, 1).data);"
        )
        seen.append(int(np.argmax(np.convolve(np.array(row[::4]), np.ones(40), "valid"))) / 2)
    assert np.median(waits) < 100.0  # milliseconds
    assert seen == pytest.approx([5 * index for index in (0, 7, 20, 33, 39)], abs=4)  # the bar of each frame
    assert driver.execute_script("return document.getElementById('now').value") == "13.9 s"
    alert = driver.execute_script("return document.querySelector('#readout .alert').textContent")
    assert alert == "warning left"


def test_play_moves_on_and_stops(driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages["run"])
    label, moved, took = driver.execute_async_script(
        """
        const done = arguments[0], play = document.getElementById('play');
        const slider = document.getElementById('slider');
        document.getElementById('rate').value = '2';
        slider.value = 0;
        slider.dispatchEvent(new Event('input'));
        const begin = performance.now();
        play.click();
        const label = play.textContent;
        setTimeout(() => {
            play.click();
            done([label, Number(slider.value), performance.now() - begin]);
        }, 500);
        """
    )
    assert label == "Pause"
    assert 2 <= moved <= took / 50.0 + 1.0  # twice as fast as the steps of 0.1 s; a busy machine is slower
    assert (
        driver.execute_script("return document.getElementById('play').getAttribute('aria-pressed')")
        == "false"
    )


def test_timeline_and_viewer_point_at_one_moment(driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages["run"])
    driver.execute_script(
        "window.dispatchEvent(new CustomEvent('moment', {detail: {vehicle: arguments[0], time: 12.5}}));",
        HOSTILE[1],
    )
    driver.execute_script(
        CHOOSE,
        HOSTILE[1],
    )
    assert driver.execute_script("return document.getElementById('now').value") == "12.5 s"
    cursor, axis = driver.execute_script(
        "const p = document.getElementById('timeline'), l = p._fullLayout;"
        "return [parseFloat(p.querySelector('.cursor').style.left), l._size.l + l.xaxis.l2p(12.5)];"
    )
    assert cursor == pytest.approx(axis, abs=1.0)


def test_everything_has_a_name_for_those_who_do_not_see(driver: Any, pages: dict[str, Path]) -> None:
    chromium.open_page(driver, pages["run"], "phone")
    nameless = driver.execute_script(
        "const all = document.querySelectorAll('img, canvas, select, button, input');"
        "return Array.from(all).filter(e => !(e.getAttribute('aria-hidden') || e.alt"
        " || e.getAttribute('aria-label') || e.textContent.trim()"
        " || (e.labels && e.labels.length) || e.closest('.modebar'))).map(e => e.outerHTML.slice(0, 80))"
    )
    assert nameless == []
