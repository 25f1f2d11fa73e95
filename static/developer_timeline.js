// Strips over time: a crosshair with the time in milliseconds and what each strip shows under it, and where the page
// can show another span (`data-zoomed`), zooming by dragging and by the wheel. What is shown stands in the address;
// links and keys lead to the same addresses.
(() => {
  "use strict";
  // A pointer that moved less was no drag.
  const DRAG_PX = 5;
  const WHEEL = 1.25;
  // Further right is the end.
  const EDGE = 0.98;
  // Between two requests while the wheel turns.
  const WHEEL_MS = 120;
  const SPAN_MIN_MS = 1000;
  const SPAN_MAX_MS = 7 * 24 * 3600 * 1000;
  const DAY_MS = 24 * 3600 * 1000;

  const body = document.body;
  // Where the pointer is: its lanes, and its share of their time. With the span that the wheel asks for.
  let pointed = null;
  let drag = null;
  let wanted = null;

  const span = ({ dataset }) => [Number(dataset.start), Number(dataset.end)];
  const box = (lanes) => lanes.querySelector(".lane > svg").getBoundingClientRect();
  const timeAt = (lanes, share) => {
    const [start, end] = span(lanes);
    return start + (end - start) * share;
  };

  const find = ({ target, clientX }) => {
    const lanes = target.closest?.(".lanes[data-start]");
    const strip = lanes && target.closest(".lane > svg, .lane > .chart") && box(lanes);
    if (!strip?.width) return null;
    const share = (clientX - strip.left) / strip.width;
    return share >= 0 && share <= 1 ? { lanes, share } : null;
  };

  // --- the crosshair

  const clock = (ms, whole) => {
    const at = new Date(ms);
    const exact = `${at.toTimeString().slice(0, 8)}.${String(at.getMilliseconds()).padStart(3, "0")}`;
    return whole > DAY_MS ? `${at.toLocaleDateString(document.documentElement.lang, { dateStyle: "medium" })} ${exact}` : exact;
  };

  const STATES = { attributed: "error", masked: "ignore", "not-relevant": "ignore" };
  const LEVELS = ["ok", "warning", "error", "ignore", "unknown"];
  const isZoomed = (at) => at?.lanes?.dataset.zoomed !== undefined;
  const tell = (lane, share) => {
    const under = lane.querySelector(".under");
    if (!under) return;
    const holds = (bar) => {
      const [from, width] = ["x", "width"].map((name) => parseFloat(bar.getAttribute(name)));
      return from <= share * 100 && share * 100 <= from + width;
    };
    const bar = [...lane.querySelectorAll(".bar")].filter(holds).pop();
    // Its words, its time, and then why.
    const [word, , ...why] = (bar?.parentElement.querySelector("title").textContent ?? "").split(", ");
    const look = [...(bar?.classList ?? [])].find((name) => name.startsWith("bar-"))?.slice(4);
    const state = STATES[look] ?? look;
    if (!under.firstChild) {
      under.append(Object.assign(document.createElement("span"), { className: "chip" }), " ", document.createElement("small"));
    }
    const chip = under.querySelector(".chip");
    chip.dataset.state = LEVELS.includes(state) ? state : "level";
    Live.setText(chip, word || under.dataset.none);
    Live.setText(under.querySelector("small"), why.join(", "));
  };

  const crossOf = (lanes) => {
    const cross = Object.assign(document.createElement("div"), { className: "cross" });
    cross.dataset.own = "";
    cross.append(document.createElement("output"));
    lanes.prepend(cross);
    return cross;
  };

  const point = () => {
    const { lanes, share } = pointed;
    const strip = box(lanes);
    const cross = lanes.querySelector(".cross") ?? crossOf(lanes);
    const [start, end] = span(lanes);
    cross.style.left = `${strip.left - lanes.getBoundingClientRect().left + share * strip.width}px`;
    Live.setText(cross.querySelector("output"), clock(timeAt(lanes, share), end - start));
    for (const lane of lanes.querySelectorAll(".lane")) tell(lane, share);
    body.dataset.pointing = "";
    dispatchEvent(new CustomEvent("telltale:point", { detail: share }));
  };
  const leave = () => {
    pointed = null;
    if (body.dataset.pointing === undefined) return;
    delete body.dataset.pointing;
    for (const under of document.querySelectorAll(".under")) under.replaceChildren();
  };

  // --- another span

  const address = (lanes, from, to, share) => {
    const asked = new URLSearchParams(location.search);
    asked.set("span", Math.max(1, Math.ceil((to - from) / 1000)));
    // What ends in the present goes on with it, unless a moment was chosen.
    if (lanes.dataset.present !== undefined && share > EDGE && !asked.has("at")) asked.delete("until");
    else asked.set("until", Math.round(Math.min(to, Date.now())));
    return `?${asked}`;
  };

  const choose = (first, second) => {
    const { lanes } = first;
    const shares = [first.share, second].sort((a, b) => a - b);
    telltale.go(address(lanes, ...shares.map((share) => timeAt(lanes, share)), shares[1]));
  };

  const select = () => {
    const { lanes, share, last } = drag;
    const [strip, area] = [box(lanes), lanes.querySelector(".selected")];
    const left = strip.left - lanes.getBoundingClientRect().left;
    area.style.left = `${left + Math.min(share, last) * strip.width}px`;
    area.style.width = `${Math.abs(last - share) * strip.width}px`;
    body.dataset.dragging = "";
  };
  const drop = () => {
    drag = null;
    delete body.dataset.dragging;
  };

  // A click chooses the moment, for this page and for those to which it leads. In a replay it is the replay's.
  const setMoment = (at) => {
    const { from, to } = document.getElementById("timeline").dataset;
    const moment = Math.round(Math.min(Number(to), Math.max(Number(from), at)));
    if (body.dataset.replay !== undefined) {
      if (parent !== window) parent.dispatchEvent(new CustomEvent("telltale:moment", { detail: moment }));
      return;
    }
    const asked = new URLSearchParams(location.search);
    if (!asked.get("until")) asked.set("until", to);
    asked.set("at", moment);
    asked.delete("unrecorded");
    telltale.go(`?${asked}`, true);
  };
  // The address is ahead of the content.
  const chosen = () => document.getElementById("timeline") && new URLSearchParams(location.search).get("at");

  // Until it is given up, links lead to the other pages as they were then, however they are opened. `data-now` keeps
  // where they lead without it.
  const lead = () => {
    if (body.dataset.replay !== undefined) return;
    const at = chosen();
    for (const link of document.querySelectorAll("a[data-then]")) {
      const shown = link.getAttribute("href");
      if (!shown.startsWith("/developer/moment?")) link.dataset.now = shown;
      const { now } = link.dataset;
      const leads = at && !link.hasAttribute("aria-current") ? `/developer/moment?${new URLSearchParams({ at, screen: now })}` : now;
      if (shown !== leads) link.setAttribute("href", leads);
    }
  };
  addEventListener("telltale:shown", lead);
  // The address may have changed since, and the search has found others.
  for (const type of ["pointerdown", "keydown", "click"]) document.addEventListener(type, lead, true);
  lead();

  document.addEventListener("pointermove", (event) => {
    if (drag) {
      const strip = box(drag.lanes);
      drag.last = Math.min(1, Math.max(0, (event.clientX - strip.left) / strip.width));
      if (Math.abs(event.clientX - drag.x) > DRAG_PX) select();
    }
    pointed = find(event);
    if (pointed) point();
    else leave();
  });
  document.addEventListener("pointerdown", (event) => {
    const at = event.button === 0 && find(event);
    if (isZoomed(at)) drag = { ...at, last: at.share, x: event.clientX };
  });
  document.addEventListener("pointerup", (event) => {
    if (!drag) return;
    const { lanes, share, last, x } = drag;
    drop();
    if (Math.abs(event.clientX - x) > DRAG_PX) choose({ lanes, share }, last);
    else if (lanes.closest("#timeline")) setMoment(timeAt(lanes, share));
  });
  document.addEventListener("pointercancel", drop);
  document.documentElement.addEventListener("pointerleave", leave);

  document.addEventListener("wheel", (event) => {
    const at = !event.shiftKey && !event.ctrlKey && find(event);
    if (!isZoomed(at)) return;
    event.preventDefault();
    const [start, end] = wanted?.span ?? span(at.lanes);
    const whole = Math.min(SPAN_MAX_MS, Math.max(SPAN_MIN_MS, (end - start) * (event.deltaY < 0 ? 1 / WHEEL : WHEEL)));
    const middle = start + (end - start) * at.share;
    const to = middle + whole * (1 - at.share);
    if (!wanted) {
      setTimeout(() => {
        // A key or a link asked for another span meanwhile.
        if (wanted.from === location.href) telltale.go(address(at.lanes, ...wanted.span, wanted.share), true);
        wanted = null;
      }, WHEEL_MS);
    }
    wanted = { span: [to - whole, to], share: at.share, from: wanted?.from ?? location.href };
  }, { passive: false });

  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape") drop();
    const step = { ArrowLeft: -10, ArrowRight: 10 }[event.key];
    const lanes = document.querySelector("#timeline .lanes");
    if (!step || !lanes || event.ctrlKey || event.metaKey || event.altKey || event.target.closest("input, select, dialog")) return;
    event.preventDefault();
    const [start, end] = span(lanes);
    const part = (event.shiftKey ? step / 10 : step) / 1000;
    setMoment(Number(chosen() ?? end) + part * (end - start));
  });

  // The field of the span follows what links, the wheel and dragging have chosen.
  const words = (seconds) => (seconds % 60 ? `${seconds} s` : `${seconds / 60} min`);
  const follow = () => {
    const lanes = document.querySelector(".lanes[data-zoomed]");
    const field = document.querySelector("main select[name=span]");
    if (!lanes || !field || field === document.activeElement) return;
    const [start, end] = span(lanes);
    const seconds = String(Math.round((end - start) / 1000));
    const has = [...field.options].some(({ value }) => value === seconds);
    if (!has) field.add(new Option(words(Number(seconds)), seconds));
    if (field.value !== seconds) field.value = seconds;
  };
  addEventListener("telltale:shown", follow);

  // The time goes on under a pointer that rests.
  addEventListener("telltale:shown", () => {
    if (pointed?.lanes.isConnected) point();
    else leave();
  });
})();
