// Controls of the developer pages: the fields of the timeline, the size of the graph, and keys. All
// listeners are on the document, because pages are replaced.
(() => {
  "use strict";

  // --- the timeline: its slider, its end, one node more

  const local = (ms) => {
    const at = new Date(ms);
    return new Date(ms - at.getTimezoneOffset() * 60000).toISOString().slice(0, 19);
  };

  // With a moment or an end, the page stays at its span; otherwise it follows the present.
  const fix = (changes) => {
    const asked = new URLSearchParams(location.search);
    if (!asked.get("until")) asked.set("until", document.getElementById("timeline").dataset.to);
    for (const [name, value] of Object.entries(changes)) asked.set(name, value);
    telltale.go(`?${asked}`, true);
  };

  document.addEventListener("input", ({ target: field }) => {
    if (!field.matches("[data-moment]")) return;
    const { from, to } = document.getElementById("timeline").dataset;
    fix({ at: Math.round(Number(from) + (Number(to) - Number(from)) * (field.value / 1000)) });
  });
  document.addEventListener("change", ({ target: field }) => {
    if (!field.matches("[data-until]")) return;
    const ms = new Date(field.value).getTime();
    if (!Number.isNaN(ms)) fix({ until: ms });
  });
  document.addEventListener("submit", (event) => {
    if (!event.target.matches("[data-add]")) return;
    event.preventDefault();
    const field = event.target.elements.namedItem("node");
    const input = field instanceof RadioNodeList ? field[field.length - 1] : field;
    const asked = new URLSearchParams(location.search);
    if (!asked.has("node")) {
      for (const lane of document.querySelectorAll(".lane[data-node]")) asked.append("node", lane.dataset.node);
    }
    if (input.value) asked.append("node", input.value);
    input.value = "";
    telltale.go(`?${asked}`);
  });

  const follow = () => {
    const timeline = document.getElementById("timeline");
    if (!timeline) return;
    const moment = document.querySelector("[data-moment]");
    const until = document.querySelector("[data-until]");
    const asked = new URLSearchParams(location.search);
    const [from, to] = [Number(timeline.dataset.from), Number(timeline.dataset.to)];
    // A moment outside of the span has no place on the slider.
    const place = Math.round((1000 * ((timeline.dataset.chosen ?? to) - from)) / Math.max(1, to - from));
    if (moment && document.activeElement !== moment) moment.value = place >= 0 && place <= 1000 ? place : 1000;
    if (document.activeElement !== until) until.value = asked.get("until") ? local(to) : "";
  };

  // --- the graph: larger and smaller, around the pointer

  let zoom = 1;
  const size = (graph) => {
    const { width, height } = graph.viewBox.baseVal;
    graph.style.width = `${width * zoom}px`;
    graph.style.height = `${height * zoom}px`;
  };
  const whole = () => {
    const graph = document.getElementById("graph");
    const { width, height } = graph.viewBox.baseVal;
    const frame = graph.parentElement;
    // Where it stands below the bar, without what is said between them while the page is old.
    const { top: begin } = document.querySelector("main").getBoundingClientRect();
    const top = document.querySelector(".dev-bar").offsetHeight + frame.getBoundingClientRect().top - begin;
    const high = Math.max(300, innerHeight - top - 40) / height;
    // What is too high for the window is scrolled, not made too small to be read.
    zoom = Math.min(1.3, (frame.clientWidth - 30) / width, Math.max(1, high));
    size(graph);
  };
  const zoomBy = (factor, x, y) => {
    const before = zoom;
    zoom = Math.min(4, Math.max(0.1, zoom * factor));
    const graph = document.getElementById("graph");
    const frame = graph.parentElement;
    const [left, top] = [frame.scrollLeft, frame.scrollTop];
    size(graph);
    frame.scrollLeft = (left + x) * (zoom / before) - x;
    frame.scrollTop = (top + y) * (zoom / before) - y;
  };
  document.addEventListener("click", (event) => {
    const how = event.target.closest?.("[data-zoom]")?.dataset.zoom;
    const frame = document.getElementById("picture");
    if (!how || !frame) return;
    if (how === "whole") return whole();
    zoomBy(how === "in" ? 1.25 : 0.8, frame.clientWidth / 2, frame.clientHeight / 2);
  });
  document.addEventListener(
    "wheel",
    (event) => {
      const frame = event.target.closest?.("#picture");
      if (!frame || event.shiftKey) return;
      event.preventDefault();
      const box = frame.getBoundingClientRect();
      zoomBy(event.deltaY < 0 ? 1.15 : 1 / 1.15, event.clientX - box.left, event.clientY - box.top);
    },
    { passive: false },
  );

  // Dragged like a map.
  let drag = null;
  document.addEventListener("pointerdown", (event) => {
    const frame = event.target.closest?.("#picture");
    if (frame && event.button === 0 && !event.target.closest("a")) {
      drag = { frame, x: event.clientX + frame.scrollLeft, y: event.clientY + frame.scrollTop };
    }
  });
  document.addEventListener("pointermove", (event) => {
    if (!drag) return;
    drag.frame.scrollLeft = drag.x - event.clientX;
    drag.frame.scrollTop = drag.y - event.clientY;
  });
  for (const type of ["pointerup", "pointercancel"]) document.addEventListener(type, () => (drag = null));

  // --- keys

  const help = document.getElementById("help");
  document.addEventListener("click", (event) => {
    if (event.target.closest?.("[data-help]")) help.showModal();
  });

  const rows = () => [...document.querySelectorAll("main [data-row]")];
  const target = (row) => (row.matches("a") ? row : (row.querySelector("[data-open]") ?? row.querySelector("a")));

  const move = (step) => {
    const all = rows();
    const at = all.findIndex((row) => row.contains(document.activeElement));
    const next = all[at < 0 ? (step > 0 ? 0 : all.length - 1) : Math.min(all.length - 1, Math.max(0, at + step))];
    if (next) target(next)?.focus();
  };

  // A whole row opens what it names, unless something in it was meant, or a text in it is marked.
  document.addEventListener("click", (event) => {
    const row = event.target.closest?.(":is(tr, li)[data-row]");
    if (!row || event.target.closest("a, button, input, select, label") || !getSelection().isCollapsed) return;
    const { ctrlKey, metaKey, shiftKey } = event;
    const click = new MouseEvent("click", { bubbles: true, cancelable: true, ctrlKey, metaKey, shiftKey });
    row.querySelector("[data-open]")?.dispatchEvent(click);
  });

  const press = {
    "/": () => document.querySelector("[data-search]")?.click(),
    f: () => document.getElementById("filter")?.focus(),
    "?": () => help.showModal(),
    j: () => move(1),
    k: () => move(-1),
    ArrowDown: () => move(1),
    ArrowUp: () => move(-1),
    p: () => document.activeElement?.closest("[data-row]")?.querySelector("[data-pin]")?.click(),
    n: () => document.querySelector("[data-go=next]")?.click(),
    b: () => document.querySelector("[data-go=previous]")?.click(),
    "+": () => document.querySelector("[data-zoom=in]")?.click(),
    "-": () => document.querySelector("[data-zoom=out]")?.click(),
    0: () => document.querySelector("[data-zoom=whole]")?.click(),
  };

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const field = event.target.closest?.("input, select, textarea");
    if (field) {
      if (event.key === "Escape") field.blur();
      return;
    }
    const page = /^[1-9]$/.test(event.key) && document.querySelector(`nav a[data-key="${event.key}"]`);
    const action = page ? () => page.click() : press[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });

  // --- pages that come, and what of them changes

  const resize = () => {
    const graph = document.getElementById("graph");
    if (graph) size(graph);
  };
  const begin = () => document.getElementById("graph") && whole();
  addEventListener("telltale:page", begin);
  for (const fit of [follow, resize]) addEventListener("telltale:shown", fit);
  begin();
  follow();
})();
