// Fits the operator's page into its window: hides the entries of a list that have no room and counts them, and
// tells the stylesheet where the board is, because panels cover exactly that.
(() => {
  "use strict";
  const board = document.querySelector(".board");

  // Glyphs are higher than their lines: so many pixels of a list's edge hold nothing.
  const GLYPHS = 3;

  // In the order in which they keep their place: each component at fault has one entry before another has its second,
  // and what is over comes last.
  const ranked = (list) => {
    const named = new Set();
    const rank = (entry) => {
      if (entry.matches("[data-past]")) return 2;
      const component = entry.querySelector(":scope > [popovertarget]")?.getAttribute("popovertarget");
      if (!component) return 0;
      const isSecond = named.has(component);
      named.add(component);
      return Number(isSecond);
    };
    const ranks = new Map([...list.children].map((entry) => [entry, rank(entry)]));
    return [...list.children].sort((a, b) => ranks.get(a) - ranks.get(b));
  };

  // The first entry always stays. The others stand on the sheet that the button opens, too. A check that holds is
  // left out without being counted.
  const fit = (list) => {
    const more = document.getElementById(list.dataset.fit);
    const entries = ranked(list);
    const unlisted = Number(list.dataset.count) - entries.length;
    const show = (count) => {
      entries.forEach((entry, index) => {
        entry.toggleAttribute("data-beyond", index >= count);
      });
      const beyond = unlisted + entries.slice(count).filter((entry) => !entry.matches(".holds")).length;
      more.hidden = beyond === 0;
      // Nobody looks behind the button for a fault that is there if all of them are over.
      more.toggleAttribute("data-over", unlisted === 0 && entries.slice(count).every((entry) => entry.matches("[data-past]")));
      Live.setText(more.querySelector(".count"), String(beyond));
    };
    const fits = () => list.scrollHeight <= list.clientHeight + GLYPHS;
    list.removeAttribute("data-brief");
    list.removeAttribute("data-tight");
    list.removeAttribute("data-short-of-room");
    if (list.offsetParent === null) return show(0);
    let count = entries.length;
    show(count);
    if (list.id === "causes-list") yieldLast(fits);
    if (fits()) return undefined;
    // How many parts wait gives way first, because the board shows it, and for how long.
    list.setAttribute("data-short-of-room", "");
    if (fits()) return undefined;
    // What is over stands last, and gives way before the advice of a live fault does. The button that counts the rest
    // takes room as well.
    const live = entries.filter((entry) => !entry.matches("[data-past]")).length;
    while (count > Math.max(live, 1) && !fits()) show(--count);
    if (fits()) return undefined;
    // Advice gives way before an entry does.
    list.setAttribute("data-brief", "");
    if (fits()) return undefined;
    more.hidden = count === 1 && more.hidden;
    while (count > 1 && !fits()) show(--count);
    if (!fits()) return list.setAttribute("data-tight", "");
    for (const gives of ["data-brief", "data-short-of-room"]) {
      list.removeAttribute(gives);
      if (!fits()) list.setAttribute(gives, "");
    }
    return undefined;
  };

  // The way to the last alarms gives way before anything that is wrong now.
  const yieldLast = (fits) => {
    const last = document.getElementById("causes-last");
    if (last === null) return;
    last.hidden = false;
    const causes = document.getElementById("causes");
    // In a narrow list both buttons of the row may not be whole.
    const isCut = (button) => button.scrollWidth > button.clientWidth + 1;
    const overflows = causes.scrollHeight > causes.clientHeight + GLYPHS;
    last.hidden = !fits() || overflows || [...last.parentElement.querySelectorAll("button")].some(isCut);
  };

  // Below this a text is hard to read, and wraps instead.
  const NARROW_MIN = 0.68;

  // An icon has an edge of so many pixels that shows nothing.
  const OVERLAP = 3;

  // Low tiles may have room for their names alone.
  const keepNames = () => {
    board.removeAttribute("data-names-only");
    const tiles = [...board.querySelectorAll(".tile")];
    const isLow = (tile) => tile.scrollHeight > tile.clientHeight + GLYPHS;
    // The count gives way before the word of the state does.
    if (tiles.some(isLow)) for (const tile of tiles) tile.toggleAttribute("data-brief", tile.dataset.reason !== "masked");
    board.toggleAttribute("data-names-only", tiles.some(isLow));
  };

  // The motion and the texts of tiles stand in one line each. All are measured before any is changed, so the browser lays out
  // once; names that wrap, which are few, are measured again.
  const narrow = () => {
    const motion = document.getElementById("motion");
    motion.style.removeProperty("--narrow");
    const texts = [...document.querySelectorAll(".tile > span")];
    const padding = (element, side) => parseFloat(getComputedStyle(element)[`padding${side}`]);
    const measured = texts.map((text) => {
      const tile = text.parentElement;
      const room = tile.clientWidth - padding(tile, "Left") - padding(tile, "Right");
      return { text, room, width: text.offsetWidth, beside: padding(text, "Right") };
    });
    // Widths are rounded to whole pixels, and a text that is wider by a part of one is cut.
    const share = (motion.clientWidth - 1) / (motion.scrollWidth + 1);
    if (motion.scrollWidth > motion.clientWidth) motion.style.setProperty("--narrow", Math.max(share, NARROW_MIN).toFixed(3));
    for (const { text, room, width, beside } of measured) {
      // A long word takes the place of the icon beside it.
      const isCrowded = beside > 0 && (room - beside) / (width - beside) < NARROW_MIN;
      if (isCrowded) text.parentElement.setAttribute("data-crowded", "");
      let share = (isCrowded ? room : room - beside) / (width - beside);
      if (share < NARROW_MIN) {
        // No word breaks that could be narrower.
        share = Math.max(room / longestWord(text), NARROW_MIN);
        text.setAttribute("data-wraps", "");
      }
      if (share < 1) text.style.setProperty("--narrow", share.toFixed(3));
    }
    leaveRoom();
    crowd();
  };

  const longestWord = (text) => {
    const words = document.createRange();
    const node = text.firstChild;
    let longest = 0;
    for (const { 0: word, index } of node.data.matchAll(/[^\s-]+-?/g)) {
      words.setStart(node, index);
      words.setEnd(node, index + word.length);
      longest = Math.max(longest, words.getBoundingClientRect().width);
    }
    // Widths are rounded.
    return longest + 1;
  };

  // The lines of a long name for which its tile has room.
  const leaveRoom = () => {
    const names = [...board.querySelectorAll(".name[data-wraps]")].map((name) => {
      const tile = name.parentElement;
      const style = getComputedStyle(tile);
      const others = [...tile.children].filter((it) => it !== name && getComputedStyle(it).position !== "absolute");
      const taken = others.reduce((sum, it) => sum + it.getBoundingClientRect().height, 0);
      const room = tile.clientHeight - parseFloat(style.paddingTop) - parseFloat(style.paddingBottom) - taken;
      return { name, lines: Math.max(Math.floor(room / parseFloat(getComputedStyle(name).lineHeight)), 1) };
    });
    for (const { name, lines } of names) {
      name.style.setProperty("--lines", lines);
      if (lines === 1) name.style.setProperty("--narrow", NARROW_MIN);
    }
    for (const { name } of names) shorten(name);
  };

  // A name without room loses its middle: similar names differ at their ends.
  const shorten = (name) => {
    name.removeAttribute("data-short");
    const text = name.firstChild;
    if (text === null) return;
    const full = text.data;
    const fits = () => name.scrollHeight <= name.clientHeight + GLYPHS;
    if (fits()) return;
    const short = (kept) => {
      const begin = Math.floor(0.4 * kept);
      return `${full.slice(0, begin)}…${full.slice(full.length - (kept - begin))}`;
    };
    let [least, most] = [2, full.length - 1];
    while (least < most) {
      const kept = Math.ceil((least + most) / 2);
      text.data = short(kept);
      if (fits()) least = kept;
      else most = kept - 1;
    }
    // The page keeps the whole name, for screen readers and for the next comparison with the server.
    text.data = full;
    name.dataset.short = short(least);
  };

  // Where the icon would lie over a text, the count gives way to it, then the word grows narrower; if that is not
  // enough, the text stands alone.
  const crowd = () => {
    if (board.matches("[data-names-only]")) return;
    const shared = (a, b, from, to) => Math.min(a[to], b[to]) - Math.max(a[from], b[from]);
    const covers = (tile) => {
      const icon = tile.querySelector(".icon").getBoundingClientRect();
      const isOver = (line) =>
        shared(icon, line, "left", "right") > OVERLAP && shared(icon, line, "top", "bottom") > OVERLAP;
      return [...tile.querySelectorAll(":scope > span")].some((text) => shownLines(text).some(isOver));
    };
    // All are measured before any is changed.
    const crowded = [...board.querySelectorAll(".tile")].filter(covers);
    const counting = crowded.filter((tile) => tile.dataset.reason !== "masked");
    for (const tile of counting) tile.setAttribute("data-brief", "");
    const beside = counting.filter(covers).map((tile) => {
      const [word, icon] = [".state", ".icon"].map((part) => tile.querySelector(part).getBoundingClientRect());
      return { word: tile.querySelector(".state"), share: (icon.left - word.left) / word.width };
    });
    for (const { word, share } of beside) {
      const whole = Number(word.style.getPropertyValue("--narrow") || 1);
      if (whole * share >= NARROW_MIN) word.style.setProperty("--narrow", (whole * share).toFixed(3));
    }
    for (const tile of crowded.filter(covers)) tile.setAttribute("data-crowded", "");
  };

  const shownLines = (text) => {
    const { bottom } = text.getBoundingClientRect();
    const lines = document.createRange();
    lines.selectNodeContents(text);
    return [...lines.getClientRects()].filter((line) => line.top < bottom - OVERLAP);
  };

  const reset = () => {
    for (const text of document.querySelectorAll(".tile > span")) {
      text.style.removeProperty("--narrow");
      text.removeAttribute("data-wraps");
      text.removeAttribute("data-short");
      text.parentElement.removeAttribute("data-crowded");
      text.parentElement.removeAttribute("data-brief");
    }
  };

  // On a page that scrolls the list ends above the action bar, which lies over what is below.
  const aside = document.querySelector("aside");
  const bar = document.getElementById("actions");
  const leaveBar = () => {
    const room = innerHeight - bar.offsetHeight - (aside.getBoundingClientRect().top + scrollY);
    document.body.style.setProperty("--above-bar", `${Math.floor(room) - GLYPHS}px`);
  };

  const fitAll = () => {
    reset();
    keepNames();
    narrow();
    leaveBar();
    document.querySelectorAll("[data-fit]").forEach(fit);
  };

  const measure = () => {
    const { top, left, width, height } = board.getBoundingClientRect();
    for (const [name, px] of Object.entries({ top, left, width, height })) {
      document.body.style.setProperty(`--board-${name}`, `${px}px`);
    }
    fitAll();
  };

  new ResizeObserver(measure).observe(board);
  const observer = new ResizeObserver(fitAll);
  for (const part of [aside, bar, document.getElementById("instruction")]) observer.observe(part);
  document.addEventListener("htmx:after:swap", fitAll);
  document.fonts?.ready.then(fitAll);
})();
