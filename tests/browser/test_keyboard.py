"""The operator's page by keys alone: a confirmation has the focus, Escape cancels, a key that is held is one press."""

from playwright.sync_api import expect

from operating import expect_tile, step


def ready_to_go_on(page):
    """A stopped vehicle that may go on; the bar takes keys."""
    step(page, "stop").click()
    release = page.locator("#step button[name=release]")
    expect(release).to_be_visible()
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    return release


def test_a_confirmation_takes_the_focus_keeps_it_and_gives_it_back(driving, vehicle, trouble):
    page = driving
    release, confirm, question = ready_to_go_on(page), step(page, "confirm"), page.locator("#confirm .next")
    release.press("Enter")
    expect(confirm).to_be_visible()
    expect(question).to_be_focused()
    # Not on its button: the same key does not confirm what it asked for.
    page.keyboard.press("Enter")
    vehicle.set("gnss: fix", 1, "3 satellites")
    expect_tile(page, "sensors", "warning")
    expect(question).to_be_focused()
    page.keyboard.press("Escape")
    expect(confirm).to_be_hidden()
    expect(release).to_be_focused()
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_be_visible()

    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    page.keyboard.press("Enter")
    expect(question).to_be_focused()
    page.keyboard.press("Tab")
    expect(confirm).to_be_focused()
    # In its first moment it takes no key.
    expect(page.locator("#actions[data-quiet]")).to_have_count(0)
    page.keyboard.press("Enter")
    expect(release).to_have_count(0)
    expect(page.locator("#countermeasure[data-request=maneuver_stop]")).to_have_count(0)


def test_escape_closes_a_panel_before_it_cancels(driving, trouble):
    page = driving
    release = ready_to_go_on(page)
    release.press("Enter")
    expect(step(page, "confirm")).to_be_visible()
    page.locator("#tile-can").press("Enter")
    expect(page.locator("#panel-can")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#panel-can")).to_be_hidden()
    expect(step(page, "confirm")).to_be_visible()
    page.keyboard.press("Escape")
    expect(step(page, "confirm")).to_be_hidden()


def test_a_key_that_is_held_is_one_press(driving, trouble):
    page, posted = driving, []
    release = ready_to_go_on(page)
    page.on("request", lambda request: request.method == "POST" and posted.append(request.url))
    release.focus()
    for _ in range(5):
        page.keyboard.down("Enter")
    page.keyboard.up("Enter")
    expect(step(page, "confirm")).to_be_visible()
    assert [url.rsplit("/", 1)[1] for url in posted] == ["release"], posted


def test_a_key_is_not_taken_by_a_button_that_has_just_appeared(driving, trouble):
    page, notice, posted = driving, driving.locator("#notice"), []
    release = ready_to_go_on(page)
    page.on("request", lambda request: request.method == "POST" and posted.append(request.url))
    page.locator("#actions").evaluate("bar => void (bar.dataset.quiet = '')")
    release.press("Enter")
    expect(notice).to_be_visible()
    assert posted == []
    page.keyboard.press("Escape")
    expect(notice).to_be_hidden()
