"""The page in a real browser beside a real market."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from support.gateway_process import Gateway

pytestmark = [pytest.mark.browser, pytest.mark.timeout(180)]


def charts_drawn(page: Page) -> None:
    """Wait until Plotly has drawn lines in every chart of the day."""
    for chart in ("c-prices", "c-power", "c-soc"):
        expect(page.locator(f"#{chart} .scatterlayer .trace").first).to_be_attached()
    expect(page.locator("#c-bills .bars .point").first).to_be_attached()


@contextmanager
def afternoon(page: Page, gateway: Gateway) -> Iterator[None]:
    """Let the market stand still at 17:00, when the grid pays most; the page shows it."""
    gateway.market.wait_for_slot(72)
    gateway.post("/v1/control", {"command": "pause"})
    try:
        still = gateway.market.wait_for_status(lambda status: status.state == "paused", missing="the pause").slot
        gateway.post("/v1/control", {"command": "step", "slots": (18 - still) % 24 or 24})
        expect(page.locator("#time")).to_have_text("17:00")
        expect(page.locator("#state")).to_have_text("paused")
        page.wait_for_timeout(1500)  # until the charts have caught up
        yield
    finally:
        gateway.post("/v1/control", {"command": "resume"})


def test_the_first_row_shows_prices_sellers_reserve_and_verdict(
    page: Page, gateway: Gateway, screenshots: Path
) -> None:
    """Its screenshot, of a summer's afternoon, is the one in the documentation."""
    expect(page.locator("#buy")).to_have_text(re.compile(r"^\d+\.\d$"))
    expect(page.locator("#sell")).to_have_text(re.compile(r"^(5\.0|9\.5)$"))
    expect(page.locator("#selling-of")).to_have_text(re.compile("of 3 homes"))
    expect(page.locator("#reserve")).to_have_text(re.compile("Yes|No"))
    expect(page.locator("#verdict")).to_have_text(re.compile("Yes|No|Partly|The same"))
    expect(page.locator("#scenario")).to_contain_text("case study")
    expect(page.locator("#flows .flow")).to_have_count(3)
    charts_drawn(page)
    with afternoon(page, gateway):
        page.screenshot(path=screenshots / "page.png", full_page=True)


def test_prices_change_during_the_day(page: Page) -> None:
    before = page.locator("#time").inner_text()
    expect(page.locator("#time")).not_to_have_text(before)
    # The grid pays 5, 7 and 10 cents in the course of a day, and the page says each of them.
    for price in ("5.0", "7.0", "10.0"):
        expect(page.locator("#buy")).to_have_text(price)


def test_a_home_is_added_and_removed(page: Page, gateway: Gateway, screenshots: Path) -> None:
    page.get_by_role("button", name="Add a home").click()
    dialog = page.get_by_role("dialog")
    expect(dialog.get_by_label("Name")).to_have_value("p4")
    dialog.get_by_label("Solar panels").fill("6")
    page.screenshot(path=screenshots / "add.png")
    dialog.get_by_role("button", name="Add it").click()
    row = page.locator('tr[data-id="p4"]')
    expect(row).to_be_visible()
    assert gateway.get("/v1/spawners")["spawners"][0]["processes"][0]["id"] == "p4"
    assert gateway.get("/v1/prosumers/p4")["pv_rated_kw"] == 6
    expect(page.locator("#selling-of")).to_have_text("of 4 homes")
    page.evaluate("scrollTo(0, 0)")
    page.screenshot(path=screenshots / "four-homes.png", full_page=True)
    row.get_by_role("button", name="Remove p4").click()
    expect(row).to_have_count(0)


def test_a_home_that_is_refused_shows_the_reason(browser: Browser, gateway: Gateway) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(gateway.url)
        page.get_by_role("button", name="Add a home").click()
        dialog = page.get_by_role("dialog")
        dialog.get_by_label("Name").fill("p1")
        dialog.get_by_role("button", name="Add it").click()
        expect(dialog.get_by_role("alert")).to_contain_text("another process plays it")
        dialog.get_by_label("Name").fill("Not a name")
        dialog.get_by_role("button", name="Add it").click()
        expect(dialog.get_by_role("alert")).to_contain_text("id:")
        dialog.get_by_role("button", name="Cancel").click()
        expect(dialog).to_be_hidden()


def test_the_market_is_controlled_by_keyboard(page: Page) -> None:
    page.keyboard.press("Space")
    expect(page.locator("#state")).to_have_text("paused")
    expect(page.locator("#pause")).to_have_text("Go on")
    before = page.locator("#time").inner_text()
    page.keyboard.press(".")
    expect(page.locator("#time")).not_to_have_text(before)
    expect(page.locator("#state")).to_have_text("paused")
    page.keyboard.press("Space")
    expect(page.locator("#state")).to_contain_text("live")
    page.get_by_label("Speed").select_option("3600")
    expect(page.locator("#speed")).to_have_value("3600")
    page.get_by_label("Speed").select_option("14400")
    page.get_by_label("Speed").focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "theme"


def test_an_earlier_day_is_shown(page: Page, gateway: Gateway) -> None:
    gateway.market.wait_for_slot(50)
    charts_drawn(page)
    page.get_by_label("Day", exact=True).fill("0")
    page.get_by_label("Day", exact=True).press("Enter")
    expect(page.locator("#h-charts")).to_have_text("Day 0")
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Later").click()
    expect(page.locator("#h-charts")).to_have_text("Day 1")
    page.get_by_label("Span").select_option("7")
    expect(page.locator("#h-charts")).to_have_text(re.compile(r"Days 0 to \d+"))
    page.get_by_role("button", name="Now", exact=True).click()
    page.get_by_label("Span").select_option("1")
    expect(page.locator("#follow")).to_have_attribute("aria-pressed", "true")


def test_a_policy_is_queried_from_the_page(page: Page, screenshots: Path) -> None:
    expect(page.locator("#c-policy .heatmaplayer image, #c-policy .hm image").first).to_be_attached()
    expect(page.locator("#ask-caption")).to_contain_text("p1 plays conventional")
    panel = page.locator(".ask")
    panel.get_by_label("Agent").select_option("grid")
    expect(page.locator("#ask-caption")).to_contain_text("it would pay")
    panel.get_by_label("Agent").select_option("p1")
    expect(page.locator("#ask-caption")).to_contain_text("p1 plays conventional")
    panel.get_by_label("Up").select_option("load_kw")
    expect(page.locator("#c-policy .ytitle")).to_have_text("consumption")
    page.locator(".ask").screenshot(path=screenshots / "policy.png")


def test_the_page_follows_the_dark_color_scheme(browser: Browser, gateway: Gateway, screenshots: Path) -> None:
    with browser.new_context(viewport={"width": 1280, "height": 900}, color_scheme="dark") as context:
        page = context.new_page()
        page.goto(gateway.url)
        expect(page.locator("html")).to_have_attribute("data-theme", "dark")
        charts_drawn(page)
        with afternoon(page, gateway):
            page.screenshot(path=screenshots / "dark.png", full_page=True)
        page.get_by_role("button", name="Dark or light").click()
        expect(page.locator("html")).to_have_attribute("data-theme", "light")
        page.reload()
        expect(page.locator("html")).to_have_attribute("data-theme", "light")


def test_the_page_fits_a_phone(browser: Browser, gateway: Gateway, screenshots: Path) -> None:
    with browser.new_context(
        viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True, color_scheme="dark"
    ) as context:
        page = context.new_page()
        page.goto(gateway.url)
        expect(page.locator("#state")).to_contain_text("live")
        charts_drawn(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        with afternoon(page, gateway):
            page.screenshot(path=screenshots / "phone.png")
            page.screenshot(path=screenshots / "phone-whole.png", full_page=True)


def test_the_market_dies_and_comes_back(browser: Browser, gateway: Gateway, screenshots: Path) -> None:
    """The last test: it leaves another clock behind."""
    with browser.new_context(viewport={"width": 1280, "height": 900}) as context:
        page = context.new_page()
        page.goto(gateway.url)
        expect(page.locator("#state")).to_contain_text("live")
        gateway.market.processes["clock"].kill()
        expect(page.locator("#state")).to_have_text("away")
        expect(page.get_by_role("alert").first).to_contain_text("The market is away")
        expect(page.locator("#pause")).to_be_disabled()
        page.screenshot(path=screenshots / "away.png")
        gateway.market.start_clock("--resume", "--speed", "18000x")
        expect(page.locator("#state")).to_contain_text("live")
        expect(page.locator("#notice")).to_be_hidden()
        before = page.locator("#time").inner_text()
        expect(page.locator("#time")).not_to_have_text(before)
        gateway.process.kill()
        expect(page.get_by_role("alert").first).to_contain_text("The gateway does not answer")
