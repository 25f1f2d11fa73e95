// Fits the operator's page into its window: hides the entries of a list that have no room and counts them, and
// tells the stylesheet where the board is, because panels cover exactly that.
(() => {
  "use strict";
  const board = document.querySelector(".board");

  // Glyphs are higher than their lines: so many pixels of a list's edge hold nothing.
  const GLYPHS = 3;

  // The first entry always stays. The others stand on the sheet that the button opens, too. A check that holds is
  // left out without being counted.
  const fit = (list) => {
    const more = document.getElementById(list.dataset.fit);
    const entries = [...list.children];
    const unlisted = Number(list.dataset.count) - entries.length;
    const show = (count) => {
      entries.forEach((entry, index) => entry.toggleAttribute("data-beyond", index >= count));
      const beyond = unlisted + entries.slice(count).filter((entry) => !entry.matches(".holds")).length;
      more.hidden = beyond === 0;
      Live.setText(more.querySelector(".count"), String(beyond));
    };
    const fits = () => list.scrollHeight <= list.clientHeight + GLYPHS;
    list.removeAttribute("data-brief");
    list.removeAttribute("data-tight");
    if (list.offsetParent === null) return show(0);
    let count = entries.length;
    show(count);
    if (fits()) return undefined;
    // Advice gives way before an entry does.
    list.setAttribute("data-brief", "");
    if (fits()) return undefined;
    // The button that counts the rest takes room as well.
    more.hidden = count === 1 && more.hidden;
    while (count > 1 && !fits()) show(--count);
    if (!fits()) return list.setAttribute("data-tight", "");
    list.removeAttribute("data-brief");
    if (!fits()) list.setAttribute("data-brief", "");
    return undefined;
  };

  // Below this a text is hard to read, and wraps instead.
  const NARROW_MIN = 0.68;

  // Many rows of tiles may have room for their names alone.
  const keepNames = () => {
    board.removeAttribute("data-names-only");
    const isLow = board.matches(".rows-4, .rows-5, .rows-6, .rows-7");
    const tiles = isLow ? [...board.querySelectorAll(".tile")] : [];
    board.toggleAttribute("data-names-only", tiles.some((tile) => tile.scrollHeight > tile.clientHeight + 1));
  };

  // The motion and the texts of tiles stand in one line each. All are measured before any is changed: the browser lays out once.
  const narrow = () => {
    const motion = document.getElementById("motion");
    motion.style.removeProperty("--narrow");
    const texts = [...document.querySelectorAll(".tile > span")];
    for (const text of texts) {
      text.style.removeProperty("--narrow");
      text.removeAttribute("data-wraps");
      text.parentElement.removeAttribute("data-crowded");
    }
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
      const isCrowded = beside > 0 && room / width < NARROW_MIN;
      if (isCrowded) text.parentElement.setAttribute("data-crowded", "");
      const share = room / (isCrowded ? width - beside : width);
      if (share < NARROW_MIN) text.setAttribute("data-wraps", "");
      else if (share < 1) text.style.setProperty("--narrow", share.toFixed(3));
    }
  };

  const fitAll = () => {
    keepNames();
    narrow();
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
  new ResizeObserver(fitAll).observe(document.querySelector("aside"));
  document.addEventListener("htmx:after:swap", fitAll);
  document.fonts?.ready.then(fitAll);
})();
