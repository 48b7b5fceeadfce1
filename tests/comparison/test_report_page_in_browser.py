"""The page in a headless Chromium, as a reader uses it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium.webdriver import Chrome, ChromeOptions, ChromeService
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select, WebDriverWait

from tomoslam_stage.comparison import Findings, Run, report
from tomoslam_stage.comparison.page import contents, write_page
from tomoslam_stage.products import Event, Tracks

BROWSER = shutil.which("chromium") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not (BROWSER and DRIVER), reason="chromium and chromedriver are needed on the PATH"
)

WIDTHS = (1280, 600)
SLICES, SINOGRAM, ANGLES, FEATURES = "#slices", "#sinogram", "#angles", "#features"


@pytest.fixture(scope="module")
def browser() -> Iterator[Chrome]:
    options = ChromeOptions()
    options.binary_location = str(BROWSER)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(word)
    driver = Chrome(options=options, service=ChromeService(str(DRIVER)))
    yield driver
    driver.quit()


class Page:
    """A page that is open."""

    def __init__(
        self, browser: Chrome, path: Path, width: int = 1280, theme: str = "light"
    ) -> None:
        self.browser = browser
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        scheme = {"features": [{"name": "prefers-color-scheme", "value": theme}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", scheme)
        browser.get_log("browser")
        browser.get(path.as_uri())
        self.wait(lambda: all(c.get_attribute("data-ready") for c in self.all("canvas")))

    def wait(self, until: Callable[[], object]) -> None:
        WebDriverWait(self.browser, 10, 0.03).until(lambda _: until())

    def one(self, selector: str) -> WebElement:
        return self.browser.find_element(By.CSS_SELECTOR, selector)

    def all(self, selector: str) -> list[WebElement]:
        return [
            e for e in self.browser.find_elements(By.CSS_SELECTOR, selector) if e.is_displayed()
        ]

    def run(self, script: str, *given: object) -> Any:
        return self.browser.execute_script(script, *given)

    def picture(self, within: str) -> str:
        """What a canvas shows once all that was asked for is drawn."""
        drawn = "const done = arguments[1]; const canvas = document.querySelector(arguments[0]);"
        drawn += (
            "requestAnimationFrame(() => requestAnimationFrame(() => done(canvas.toDataURL())))"
        )
        picture: str = self.browser.execute_async_script(drawn, f"{within} canvas")
        return picture

    def press(self, within: str, *keys: str) -> None:
        """Press keys while the canvas or drawing of a section has the focus."""
        self.run("document.querySelector(arguments[0]).focus()", within)
        ActionChains(self.browser).send_keys(*keys).perform()

    def button(self, within: str, label: str) -> WebElement:
        return next(b for b in self.all(f"{within} button") if label in b.text)

    @property
    def troubles(self) -> list[Any]:
        return list(self.browser.get_log("browser"))


@pytest.fixture
def rich(complete: Findings) -> Findings:
    """Everything a page can show: truth, tracks, residuals, events, three slices."""
    rng = np.random.default_rng(2)
    feature, projection = np.repeat(np.arange(40), 30), np.tile(np.arange(30), 40)
    column, row = 20 + projection + rng.normal(0, 0.2, 1200), np.repeat(rng.uniform(1, 14, 40), 30)
    refinement = replace(
        complete.refinement,
        events=(Event(30, -1.5, 31.0, "lost step"), Event(60, 0.4, 8.0, "backlash")),
        sources={"features": "used", "map": "left out: <b>why</b>"},
        histograms={
            "track_lengths": np.full(40, 30.0),
            "sighting_residuals": rng.normal(size=1200),
        },
    )
    tracks = Tracks(feature, projection, column, row, np.full(90, 50))
    return replace(complete, refinement=refinement, tracks=tracks)


@pytest.fixture
def unrefined(findings: Findings) -> Findings:
    still = replace(findings.refinement, refined=findings.refinement.recorded, status="kept")
    return replace(findings, refinement=still)


@pytest.fixture
def opened(browser: Chrome, tmp_path: Path, run: Run) -> Callable[..., Page]:
    """Write the page of some findings, and open it."""

    def opened(findings: Findings, **how: Any) -> Page:
        write_page(tmp_path / "report.html", contents(findings, report(findings, run)))
        return Page(browser, tmp_path / "report.html", **how)

    return opened


@pytest.fixture
def page(opened: Callable[..., Page], rich: Findings) -> Page:
    return opened(rich)


@pytest.mark.parametrize("which", ["rich", "kept_findings", "unrefined"])
def test_pages_fit_every_width_in_light_and_dark_without_any_trouble(
    opened: Callable[..., Page], which: str, request: pytest.FixtureRequest
) -> None:
    findings = request.getfixturevalue(which)
    colours = set()
    for width in WIDTHS:
        for theme in ("light", "dark"):
            shown = opened(findings, width=width, theme=theme)
            sizes = shown.run(
                "const { scrollWidth, clientWidth } = document.documentElement;"
                "return [scrollWidth, clientWidth, innerWidth]"
            )
            assert sizes[0] == sizes[1] <= sizes[2] == width
            colours.add(shown.run("return getComputedStyle(document.body).backgroundColor"))
            assert shown.troubles == []
    assert len(colours) == 2


def test_a_scan_in_which_nothing_was_found_has_a_page_without_trouble(
    opened: Callable[..., Page], tiny: Callable[[int], Findings]
) -> None:
    shown = opened(tiny(1))
    assert shown.one("#verdict").text.startswith("Recorded angles kept")
    assert shown.troubles == []


def test_the_slider_moves_the_divider_and_says_where_it_is(page: Page) -> None:
    before = page.picture(SLICES)
    slider = page.one(f"{SLICES} input[aria-label=divider]")
    slider.send_keys(Keys.HOME)
    assert slider.get_attribute("aria-valuetext") == "0 %"
    refined = page.picture(SLICES)
    slider.send_keys(Keys.END)
    assert slider.get_attribute("aria-valuetext") == "100 %"
    assert len({before, refined, page.picture(SLICES)}) == 3


def test_dragging_wipes_when_the_picture_fits_and_pans_when_it_is_larger(page: Page) -> None:
    canvas = page.one(f"{SLICES} canvas")
    slider = page.one(f"{SLICES} input[aria-label=divider]")

    def drag(start: int, by: int) -> None:
        chain = ActionChains(page.browser).move_to_element_with_offset(canvas, start, 40)
        chain.click_and_hold().move_by_offset(by, 0).release().perform()

    drag(0, canvas.size["width"] // 4)
    assert float(slider.get_attribute("value") or 0) == pytest.approx(75, abs=1)
    page.button(SLICES, "+").click()
    before = page.picture(SLICES)
    drag(-canvas.size["width"] // 4, 60)
    assert float(slider.get_attribute("value") or 0) == pytest.approx(75, abs=1)
    assert page.picture(SLICES) != before


def test_two_fingers_zoom_about_the_place_between_them(page: Page) -> None:
    canvas = page.one(f"{SLICES} canvas")
    said = page.one(f"{SLICES} output")
    slider = page.one(f"{SLICES} input[aria-label=divider]")
    page.run("arguments[0].scrollIntoView()", canvas)
    box = page.run("return arguments[0].getBoundingClientRect().toJSON()", canvas)
    x, y = box["x"] + 0.35 * box["width"], box["y"] + 0.4 * box["height"]

    def touch(kind: str, *apart: int) -> None:
        points = [{"x": x + away, "y": y, "id": k} for k, away in enumerate(apart)]
        page.browser.execute_cdp_cmd(
            "Input.dispatchTouchEvent", {"type": kind, "touchPoints": points}
        )

    def pinch(start: int, end: int) -> None:
        touch("touchStart", -start)
        touch("touchStart", -start, start)
        for step in (1, 2, 3, 4):
            half = start + (end - start) * step // 4
            touch("touchMove", -half, half)
        touch("touchEnd")

    def under() -> str:
        for where in ({"x": x, "y": y + 1}, {"x": x, "y": y}):
            page.browser.execute_cdp_cmd(
                "Input.dispatchMouseEvent", {"type": "mouseMoved", **where}
            )
        return said.text.partition(":")[0]

    fitted, before = page.picture(SLICES), under()
    assert before.startswith("x ")
    pinch(20, 100)
    assert page.picture(SLICES) != fitted
    assert under() == before
    assert slider.get_attribute("aria-valuetext") == "50 %"
    pinch(100, 10)
    assert page.picture(SLICES) == fitted
    assert page.troubles == []


def test_keys_blink_choose_the_view_and_go_to_the_next_slice(page: Page) -> None:
    left = page.one(f"{SLICES} .name.left")
    canvas = f"{SLICES} canvas"
    page.press(canvas, "b")
    assert left.text == "refined angles"
    first = page.picture(SLICES)
    page.press(canvas, "b")
    assert left.text == "recorded angles"
    assert page.picture(SLICES) != first
    page.press(canvas, "d")
    assert left.text == "refined angles − recorded angles"
    page.press(canvas, "s")
    assert page.one(f"{SLICES} .name.right").text == "refined angles"
    page.press(canvas, "w", Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    slider = page.one(f"{SLICES} input[aria-label=divider]")
    assert slider.get_attribute("aria-valuetext") == "54 %"
    page.press(canvas, "n")
    picker = Select(page.one(f"{SLICES} select[aria-label=picture]"))
    page.wait(lambda: picker.first_selected_option.text == "detector row 11")
    fitted = page.picture(SLICES)
    page.press(canvas, "+")
    assert page.picture(SLICES) != fitted
    page.press(canvas, "0")
    assert page.picture(SLICES) == fitted


def test_recorded_and_refined_lie_over_each_other_at_every_zoom(page: Page) -> None:
    # Where both sides show the same angles, the divider must not be seen to move the picture.
    Select(page.one(f"{SLICES} select[aria-label=right]")).select_by_visible_text("recorded angles")
    page.press(f"{SLICES} canvas", "f", "b")
    first = page.picture(SLICES)
    page.press(f"{SLICES} canvas", "b")
    assert page.picture(SLICES) == first


def test_the_window_changes_the_greys_and_comes_back(page: Page) -> None:
    before = page.picture(SLICES)
    page.one(f"{SLICES} input[aria-label=white]").send_keys(Keys.HOME, *[Keys.ARROW_RIGHT] * 9)
    assert page.picture(SLICES) != before
    page.button(SLICES, "auto").click()
    assert page.picture(SLICES) == before


def test_values_under_the_pointer_are_told_for_all_angles(page: Page) -> None:
    canvas = page.one(f"{SLICES} canvas")
    ActionChains(page.browser).move_to_element(canvas).move_by_offset(3, 3).perform()
    said = page.one(f"{SLICES} output").text
    assert "recorded angles 0.01 · refined angles 0.01 · true angles 0.0" in said


def test_the_correction_is_told_with_its_sigma_by_arrow_keys_and_pointer(page: Page) -> None:
    drawing = f"{ANGLES} svg"
    page.press(drawing, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    tip = page.one(f"{ANGLES} .tip").text
    assert tip.startswith("projection 2\n")
    assert "± 0.02" in tip
    assert "true correction" in tip
    ActionChains(page.browser).move_to_element(page.one(drawing)).perform()
    assert page.one(f"{ANGLES} .tip").text.startswith("projection 4")


def test_shifts_of_the_sample_are_told_with_their_sigma(
    opened: Callable[..., Page], moved: Findings
) -> None:
    shown = opened(moved)
    assert [each.text for each in shown.all(f"{ANGLES} figcaption")] == [
        "refined − recorded",
        "shift of the sample on its stage",
        "reprojection residual on unused rows",
    ]
    drawing = f"{ANGLES} .chart-slot:nth-of-type(2) svg"
    shown.press(drawing, Keys.ARROW_RIGHT)
    tip = next(each.text for each in shown.all(f"{ANGLES} .tip"))
    found, true = moved.refinement.shift[0], tip.rpartition(" ")[2]  # type: ignore[index]
    assert f"shift: {found:.4g} ± 0.03".replace("-", "−") in tip
    # Two px to the right of all projections are the axis: they are nothing to compare.
    assert float(true.replace("−", "-")) == pytest.approx(found, abs=1e-3)
    assert shown.troubles == []


def test_events_are_marked_and_named(page: Page) -> None:
    assert len(page.all(f"{ANGLES} svg .mark")) == 2
    named = [entry.text for entry in page.all("#events li")]
    assert named[0] == "lost step -1.50°, 31 σ, before projection 30"


def test_the_projections_play_and_stop_with_their_features(page: Page) -> None:
    said = page.one(f"{FEATURES} output")
    assert said.text == "projection 0 · 40 features"
    first = page.picture(FEATURES)
    page.button(FEATURES, "play").click()
    page.wait(lambda: said.text.startswith("projection 3 "))
    page.button(FEATURES, "pause").click()
    at = said.text
    assert page.picture(FEATURES) != first
    page.press(f"{FEATURES} canvas", Keys.ARROW_RIGHT)
    assert said.text != at
    page.press(f"{FEATURES} canvas", " ")
    assert page.button(FEATURES, "pause")
    with_tracks = page.picture(FEATURES)
    page.press(f"{FEATURES} canvas", " ")
    page.one(f"{FEATURES} input[type=checkbox]").click()
    assert page.picture(FEATURES) != with_tracks


def test_the_theme_can_be_switched(page: Page) -> None:
    ground = "return getComputedStyle(document.body).backgroundColor"
    light = page.run(ground)
    page.one("#theme").click()
    assert page.run(ground) != light
    page.one("#theme").click()
    assert page.run(ground) == light


def test_names_are_shown_as_they_are(page: Page) -> None:
    assert page.one("#scan").text == "a$b$.h5"
    assert "left out: <b>why</b>" in page.one("#run").text


def test_the_pipeline_can_be_copied_or_is_selected_where_the_clipboard_is_closed(
    page: Page,
) -> None:
    page.button("#pipeline", "copy").click()
    page.wait(lambda: page.all("#pipeline button")[0].text in {"copied", "selected: press Ctrl+C"})


def test_whatever_can_be_used_has_a_name_and_takes_the_focus(page: Page) -> None:
    used = page.all("button, select, input, canvas, svg[tabindex]")
    assert len(used) > 30
    for control in used:
        name = control.accessible_name
        assert name, control.get_attribute("outerHTML")
        page.run("arguments[0].focus()", control)
        assert page.run("return document.activeElement === arguments[0]", control), name


def test_there_is_nothing_to_compare_without_a_second_set_of_angles(
    opened: Callable[..., Page], unrefined: Findings
) -> None:
    shown = opened(unrefined)
    assert shown.all(f"{SLICES} canvas")
    assert not shown.all(f"{SLICES} input[aria-label=divider], {SLICES} [data-key]")
    assert not shown.all(SINOGRAM)
    shown.one(f"{SLICES} summary").click()
    assert [key.text for key in shown.all(f"{SLICES} kbd")] == ["← → ↑ ↓", "+ − 0", "n"]
    assert not shown.all(f"{FEATURES} input[type=checkbox]")
    assert "refined" not in shown.one("#measures thead").text
    before = shown.picture(SLICES)
    shown.press(f"{SLICES} canvas", "b", "d", "s")
    assert shown.picture(SLICES) == before
    assert shown.troubles == []
