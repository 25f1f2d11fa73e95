"""Sizes of type and touch, and that nothing is cut or overlaps, in every window that a display may have."""

from playwright.sync_api import expect

# The reference display, a small one, a large one, and one that stands upright.
SIZES = [(1280, 800), (1024, 600), (1920, 1080), (800, 1280)]

# A phone, a small display, and the reference display at 200 %.
SMALL = [(390, 844), (800, 480), (640, 400)]

# At 149 dpi 15 mm are 88 px and 20 mm are 117 px.
FAULTS = """() => {
  const TOUCH = 88, TOUCH_FIRST = 117, faults = [];
  const box = it => it.getBoundingClientRect();
  const visible = it => {
    const { width, height } = box(it);
    return width > 1 && height > 1 && getComputedStyle(it).visibility === "visible" && !it.closest(".hush, svg svg, [data-beyond]");
  };
  const called = it => `${it.id || it.name || it.className.baseVal || it.className || it.tagName}: ${it.textContent.trim().replace(/\\s+/g, " ").slice(0, 30)}`;
  const all = selector => [...document.querySelectorAll(selector)].filter(visible);
  const scrolls = it => it.closest("[popover] ul, .sheet, .notice, .page-login, .page-demo");
  const type = it => parseFloat(getComputedStyle(it).fontSize);
  for (const it of all("body *")) {
    const { right, bottom, width, height } = box(it), style = getComputedStyle(it);
    if (!scrolls(it) && (right > innerWidth + 1 || bottom > innerHeight + 1)) faults.push(`outside: ${called(it)}`);
    // A tile's texts are compared with the tile itself, below.
    const hides = !it.matches(".tile") && style.overflow !== "visible" && style.display !== "inline" && !scrolls(it);
    // Glyphs are lower than their lines: 3 px of a line's edge hold nothing.
    if (hides && it.clientWidth && (it.scrollWidth > it.clientWidth + 1 || it.scrollHeight > it.clientHeight + 3)) {
      faults.push(`cut: ${called(it)}: ${it.scrollWidth}x${it.scrollHeight} in ${it.clientWidth}x${it.clientHeight}`);
    }
    const tile = it.closest(".tile");
    if (tile && tile !== it && (bottom > box(tile).bottom + 1 || right > box(tile).right + 1)) faults.push(`leaves its tile: ${called(it)}`);
    const speaks = [...it.childNodes].some(node => node.nodeType === Node.TEXT_NODE && node.data.trim());
    if (speaks && type(it) < 27.99) faults.push(`type of ${type(it)} px: ${called(it)}`);
    if (it.matches("button, a, input:not([type=hidden])")) {
      const least = it.matches(".primary") ? TOUCH_FIRST : TOUCH;
      if (height < least - 0.5 || width < Math.min(least, TOUCH) - 0.5) faults.push(`touch of ${width}x${height} px: ${called(it)}`);
    }
  }
  // The rectangles of an element's texts that are seen, as high as their glyphs.
  const texts = it => {
    const found = [], walk = document.createTreeWalker(it, NodeFilter.SHOW_TEXT);
    while (walk.nextNode()) {
      const node = walk.currentNode, range = document.createRange();
      const isSeen = visible(node.parentElement) && getComputedStyle(node.parentElement).clipPath === "none";
      if (!node.data.trim() || !isSeen) continue;
      range.selectNodeContents(node);
      const edge = 0.2 * type(node.parentElement);
      found.push(...[...range.getClientRects()].map(({ left, right, top, bottom }) => ({ left, right, top: top + edge, bottom: bottom - edge })));
    }
    return found;
  };
  for (const it of all("button:not(.tile), a, .live")) {
    const { left, right, top, bottom } = box(it);
    if (texts(it).some(a => a.left < left - 1 || a.right > right + 1 || a.top < top - 1 || a.bottom > bottom + 1)) faults.push(`its text leaves ${called(it)}`);
  }
  for (const it of all(".tile > .icon")) {
    const { left, right, top, bottom } = box(it);
    const over = a => Math.min(a.right, right) - Math.max(a.left, left) > 2 && Math.min(a.bottom, bottom) - Math.max(a.top, top) > 2;
    if (texts(it.parentElement).some(over)) faults.push(`its icon lies over the words of ${called(it.parentElement)}`);
  }
  for (const it of all(".tile > .own")) {
    const { left, right, top, bottom } = box(it);
    const over = a => Math.min(a.right, right) - Math.max(a.left, left) > 0.5 && Math.min(a.bottom, bottom) - Math.max(a.top, top) > 2;
    const words = [...it.parentElement.children].filter(other => other !== it && visible(other)).flatMap(texts);
    if (words.some(over)) faults.push(`its number lies over the words of ${called(it.parentElement)}`);
  }
  // Up to twelve components have room for both.
  if (all(".tile").length <= 12) for (const tile of all(".tile")) for (const part of [".icon", ".state"]) {
    const it = tile.querySelector(part);
    if (!visible(it) || getComputedStyle(it).clipPath !== "none") faults.push(`no ${part} in ${called(tile)}`);
  }
  for (const it of all("*").filter(it => getComputedStyle(it).textOverflow === "ellipsis")) {
    if (texts(it).some(a => a.right > box(it).right + 0.05)) faults.push(`ends with dots: ${called(it)}`);
  }
  // A word breaks at its hyphens only.
  for (const it of all(".cause .title, .next strong, .next .text, .instruction *, .calm span")) {
    for (const node of [...it.childNodes].filter(node => node.nodeType === Node.TEXT_NODE)) {
      for (const { 0: word, index } of node.data.matchAll(/[^\\s-]+/g)) {
        const letters = document.createRange();
        letters.setStart(node, index);
        letters.setEnd(node, index + word.length);
        if (!word.includes("\\u00ad") && letters.getClientRects().length > 1) faults.push(`breaks “${word}”: ${called(it)}`);
      }
    }
  }
  // What is said of a display that is not live lies under nothing.
  for (const it of all(".lost, .frozen h1, .frozen p")) {
    const { left, right, top, bottom } = box(it);
    const points = [top + 4, (top + bottom) / 2, bottom - 4].map(y => document.elementFromPoint((left + right) / 2, y));
    if (points.some(seen => !it.contains(seen) && !seen?.closest(".notice"))) faults.push(`covered: ${called(it)}`);
  }
  // Nothing lies over STOP, and it looks as it always does.
  for (const it of all("button[name=stop]")) {
    const { left, right, top, bottom } = box(it);
    const points = [[left, top], [right, top], [left, bottom], [right, bottom]].map(([x, y]) => [x + (x === left ? 12 : -12), y + (y === top ? 12 : -12)]);
    if (points.some(([x, y]) => !it.contains(document.elementFromPoint(x, y)))) faults.push("something lies over STOP");
    if (getComputedStyle(it).opacity !== "1") faults.push("STOP is pale");
    if (right - left < 379.5 || bottom - top < 116.5) faults.push(`STOP of ${right - left}x${bottom - top} px`);
  }
  const atLeast = (px, selector) => {
    for (const it of all(selector)) if (type(it) < px - 0.01) faults.push(`type of ${type(it)} px where ${px} are due: ${called(it)}`);
  };
  atLeast(44, "#motion, #instruction strong");
  atLeast(36, ".cause .title, #actions .primary, #actions .next strong, .row b, .tile:not([data-state=ignore], [data-state=unknown]) .state");
  atLeast(30, ".tile .state");
  const apart = selector => {
    const parts = all(selector).map(it => [it, box(it)]);
    parts.forEach(([one, a], index) => parts.slice(index + 1).forEach(([other, b]) => {
      const over = Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1;
      if (over) faults.push(`${called(one)} overlaps ${called(other)}`);
    }));
  };
  for (const parts of [".tile", ".bar > :not(.top), .top > *", ".page-operator > :is(.bar, .instruction, .board, aside, footer)", "#step > *, #causes > *", ".cause"]) apart(parts);
  return [...new Set(faults)];
}"""

# Buttons of the bar, and of an open question, that are not whole in the window, not free, or cut.
STEPS_NOT_WHOLE = """() => [...document.querySelectorAll("#step button, #confirm:not([hidden]) button")].filter(it => {
  if (!it.checkVisibility({ visibilityProperty: true })) return false;
  const { left, right, top, bottom, width } = it.getBoundingClientRect();
  if (width === 0) return false;
  const isFree = it.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2));
  return left < 0 || top < 0 || right > innerWidth + 1 || bottom > innerHeight + 1 || !isFree || it.scrollWidth > it.clientWidth + 1;
}).map(it => it.name)"""


def faults(page):
    """What is wrong in the window as it is."""
    # The page's script measures after a change of the size.
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return page.evaluate(FAULTS)


def check_sizes(page, name, also=lambda page: ""):
    """No fault in any window; `also` looks for others there, and says them in a text."""
    before = page.viewport_size
    found = []
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        found += [f"{width}x{height}: {fault}" for fault in faults(page)]
        found += [f"{width}x{height}: {other}" for other in [also(page)] if other]
    page.set_viewport_size(before)
    assert not found, f"{name}:\n" + "\n".join(found)


def check_steps_in_small_windows(page, name):
    """The step and its question are whole in each small window, in both languages."""
    offered = page.locator(f"#step button[name={name}]:not([aria-disabled])")
    expect(offered).to_be_visible(timeout=40_000)
    for _ in range(2):
        before = page.locator("html").get_attribute("lang")
        page.locator("[data-tool=language]").tap()
        expect(page.locator("html")).not_to_have_attribute("lang", before)
        expect(offered).to_be_visible()
        check_whole(page, name)
        offered.tap()
        expect(page.locator("#confirm [name=confirm]")).to_be_visible()
        # The tap that asked blocks a second one for a moment.
        expect(page.locator("#actions[data-quiet]")).to_have_count(0)
        check_whole(page, f"the question of {name}")
        page.keyboard.press("Escape")


def check_whole(page, name):
    before = page.viewport_size
    for width, height in SMALL:
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
        assert page.evaluate(STEPS_NOT_WHOLE) == [], f"{name} at {width}x{height}"
    page.set_viewport_size(before)


def check_elsewhere(name, button, asked, size):
    """A second tap where the first step was asked for must not hit this button."""
    beside = button["x"] >= asked["x"] + asked["width"] - 1 or asked["x"] >= button["x"] + button["width"] - 1
    apart = button["y"] >= asked["y"] + asked["height"] - 1 or asked["y"] >= button["y"] + button["height"] - 1
    assert beside or apart, f"{name} lies under the finger at {size}: {button}, {asked}"
