"""A shift: where the vehicle stands, what has just beeped, and what somebody reads who may not act."""

from playwright.sync_api import expect

from operating import expect_standing, log_in, stage, step, tile
from vehicle import Client

READER = ("aron", "lantern-48-harbour")


def reader(server, page):
    server.add_user(*READER, role="authority")
    context = page.context.browser.new_context(viewport={"width": 1280, "height": 800}, locale="en-GB")
    context.add_cookies(Client(server, *READER).browser_cookies())
    looks = context.new_page()
    looks.goto(server.url + "/")
    return looks


def test_after_a_wrong_choice_the_stop_is_chosen_again(server, vehicle, page, trouble):
    log_in(page, server)
    stage(page, "localizing")
    expect(page.locator("#step [data-known]")).to_have_count(0)
    looks = reader(server, page)
    told = looks.locator("#instruction .for-reader")
    expect(told).to_have_text("The operator chooses the stop.")
    expect(looks.locator("#instruction strong")).to_be_hidden()
    expect(page.locator("#instruction .for-reader")).to_be_hidden()
    # The colour of the next step is for who takes it.
    ground = lambda it: it.locator("#instruction").evaluate("it => getComputedStyle(it).backgroundColor")
    plain = looks.locator(".board").evaluate("it => getComputedStyle(it).backgroundColor")
    assert ground(looks) == plain != ground(page), (ground(looks), ground(page))

    vehicle.set("localization: tf_quality", 2, "jumps")
    expect(page.locator("body")).to_have_attribute("data-live", "live")
    step(page, "localize").last.click()
    expect(tile(page, "localization")).to_have_attribute("data-state", "error")
    expect(page.locator("#instruction strong")).to_have_text("Choose the stop again.")
    expect(page.locator("#instruction")).to_contain_text("Chosen: Campus")
    # Advice is for the operator, who may act on it.
    expect(looks.locator("#causes .help").first).to_be_hidden()
    # Another choice is not accused of the ERROR of the one before.
    expect(page.locator("#step button[name=localize]").last).to_contain_text("Campus")
    page.locator("#step button[value=station]").click()
    expect(page.locator("#step")).to_contain_text("Checking the position: Main Station")
    # It lasts.
    expect(page.locator("#instruction strong")).to_have_text("Choose the stop again.")
    # What was not confirmed is no knowledge.
    expect(page.locator("#all-stops [data-known]")).to_have_count(0)

    vehicle.set("localization: tf_quality", 0)
    stage(page, "standby")
    expect_standing(page)
    expect(told).not_to_have_text("The operator chooses the stop.")
    known = page.locator("#all-stops button").first
    expect(known).to_have_attribute("value", "station")
    expect(known.locator(".told")).to_have_text("Chosen here last")
    # The next operator finds it, also after a restart.
    step(page, "logout").click()
    page.wait_for_url(server.url + "/login*")
    server.stop()
    server.start()
    log_in(page, server)
    stage(page, "localizing")
    expect(page.locator("#step [data-known]")).to_have_attribute("value", "station")
    trouble.expect("ERR_CONNECTION", "WebSocket", "401", "Failed to fetch")
    looks.context.close()


def test_what_has_just_beeped_is_one_tap_away(server, vehicle, page, trouble):
    log_in(page, server)
    expect_standing(page)
    vehicle.set("gnss: fix", 2, "2 satellites")
    expect(tile(page, "sensors")).to_have_attribute("data-state", "error")
    vehicle.set("gnss: fix", 0)
    expect(tile(page, "sensors")).to_have_attribute("data-state", "ok")
    page.locator("#causes button[name=acknowledge]").first.click()
    expect(page.locator("#causes .cause")).to_have_count(0)

    page.locator("#causes-last").click()
    alarm = page.locator("#sheet-last .alarm")
    expect(alarm).to_have_count(1)
    expect(alarm).to_have_attribute("data-state", "error")
    expect(alarm).to_contain_text("Satellite reception poor")
    expect(alarm).to_contain_text("lasted")
    expect(alarm).to_contain_text("seen")
    expect(alarm.locator("time.clock").first).not_to_be_empty()
    # It covers the board alone.
    expect(page.locator("#motion")).to_be_in_viewport(ratio=1)
    # Its row opens the component that it names.
    alarm.locator(".open").click()
    expect(page.locator("#panel-sensors")).to_be_visible()
