// The developer's pages: their address is their whole state, the server renders it, and this asks
// anew when the server's pulse says that there is news. Says by itself when what stands here is old.
(() => {
  "use strict";
  const STALE_MS = 1000;
  const DEAD_MS = 2000;
  const CHECK_MS = 100;
  // Between two answers: whoever looks sees four a second as live.
  const RENEW_MIN_MS = 250;
  const ANSWER_MS = 5000;
  // News that is not on the page for so long makes it stale, and dead.
  const BEHIND_STALE_MS = 2000;
  const BEHIND_DEAD_MS = 5000;
  const RECONNECT_MS = 500;
  const HANG_MS = 4000;

  const root = document.documentElement;
  const body = document.body;
  const mark = document.querySelector("#live .pulse");
  const clock = document.getElementById("clock");
  const stage = document.getElementById("dev-stage");
  const content = () => document.getElementById("dev");

  const lag = new Lag();
  let lastBeat = performance.now();
  let late_ms = 0;
  let everBeat = false;
  let newest = Number(content().dataset.revision);
  // What a locked vehicle shows is another page, but for those that tell nothing of its parts.
  const locked = body.dataset.stage === "locked";
  let behindSince = null;
  let renewedAt = performance.now();
  let renewing = null;

  const setText = (element, text) => {
    if (element.textContent !== text) element.textContent = text;
  };

  const localTimes = () => {
    for (const time of document.querySelectorAll("time.clock")) {
      const at = new Date(time.dateTime);
      if (Number.isNaN(at.getTime())) continue;
      const clock = at.toTimeString().slice(0, 8);
      setText(time, time.classList.contains("whole") ? `${at.toLocaleDateString(root.lang)} ${clock}` : clock);
    }
    for (const text of document.querySelectorAll("[data-clock]")) {
      setText(text, new Date(text.dataset.clock).toTimeString().slice(0, 8));
    }
  };

  // --- what stands here

  const show = async (text) => {
    await htmx.swap({ sourceElement: body, target: "#dev", select: "#dev", swap: "outerMorph", text });
    localTimes();
    afterShow();
  };

  // One at a time; a newer wish ends an older one.
  // The server is told by the header that nobody did anything: an open page keeps no session alive.
  const RENEWAL = { "Telltale-Renewal": "1" };
  const renew = async (byItself) => {
    renewing?.abort();
    const abort = new AbortController();
    renewing = abort;
    const limit = setTimeout(() => abort.abort(), ANSWER_MS);
    try {
      const answer = await fetch(location.href, { headers: byItself ? RENEWAL : {}, cache: "no-store", signal: abort.signal });
      if (answer.redirected) return location.assign(answer.url);
      if (!answer.ok) throw new Error(`status ${answer.status}`);
      const text = await answer.text();
      if (renewing !== abort) return;
      await show(text);
      if (Number(content().dataset.revision) >= newest) behindSince = null;
    } catch {
      // What failed shows as the page's age.
    } finally {
      clearTimeout(limit);
      if (renewing === abort) {
        renewing = null;
        renewedAt = performance.now();
      }
    }
  };

  const renewIfDue = () => {
    const every = Number(content().dataset.renew);
    const wait = performance.now() - renewedAt;
    if (renewing || wait < RENEW_MIN_MS || document.hidden || !everBeat) return;
    if (content().dataset.static !== undefined) return;
    const news = Number(content().dataset.revision) < newest;
    if (news || (every > 0 && wait >= every)) renew(true);
  };

  // --- live, stale, dead

  const judge = () => {
    const now = performance.now();
    const age = now - lastBeat + late_ms;
    const behind = behindSince === null ? 0 : now - behindSince;
    const live =
      age >= DEAD_MS || behind >= BEHIND_DEAD_MS ? "dead"
      : age >= STALE_MS || behind >= BEHIND_STALE_MS || !everBeat ? "stale"
      : "live";
    if (body.dataset.live !== live) body.dataset.live = live;
    renewIfDue();
  };

  const beat = (message) => {
    lastBeat = performance.now();
    late_ms = lag.of(message);
    everBeat = true;
    delete body.dataset.waiting;
    mark.dataset.phase = message.beat % 8;
    setText(clock, new Date(message.at).toTimeString().slice(0, 8));
    body.dataset.stage = message.stage;
    stage.dataset.overall = message.overall;
    setText(stage.querySelector(".word"), message.word);
    // Another configuration or another server counts anew.
    newest = message.revision;
    const renews = content().dataset.static === undefined;
    if (renews && Number(content().dataset.revision) < newest && !document.hidden) behindSince ??= lastBeat;
    if (renews && (message.stage === "locked") !== locked) location.reload();
    judge();
  };

  const connect = () => {
    lag.try();
    const socket = new WebSocket(body.dataset.socket);
    let opened = false;
    const hang = setInterval(() => {
      if (performance.now() - lastBeat > HANG_MS || late_ms >= STALE_MS) socket.close();
    }, HANG_MS);
    socket.addEventListener("open", () => {
      lag.open();
      opened = true;
    });
    socket.addEventListener("message", ({ data }) => beat(JSON.parse(data)));
    socket.addEventListener("close", async ({ code }) => {
      clearInterval(hang);
      if (code === 1008) return location.assign("/login");
      if (!opened) await leaveIfLoggedOut();
      setTimeout(connect, RECONNECT_MS);
    });
  };

  const leaveIfLoggedOut = async () => {
    try {
      const answer = await fetch("/developer", { method: "HEAD", headers: RENEWAL, redirect: "manual", cache: "no-store" });
      if (answer.type === "opaqueredirect") location.assign("/login");
    } catch {
      // Nobody answers: the page says so already.
    }
  };

  // --- another address of the same page

  const go = (address, replace) => {
    if (replace) history.replaceState(null, "", address);
    else history.pushState(null, "", address);
    keepForm();
    return renew();
  };

  // The form keeps what links have changed: pins, the order.
  const keepForm = () => {
    for (const form of document.querySelectorAll("form[data-soft]")) {
      for (const hidden of form.querySelectorAll("input[type=hidden]")) hidden.remove();
      const named = new Set([...form.elements].map((element) => element.name));
      for (const [name, value] of new URLSearchParams(location.search)) {
        // What another filter leaves is looked at from its beginning.
        if (named.has(name) || name.startsWith("page")) continue;
        form.prepend(Object.assign(document.createElement("input"), { type: "hidden", name, value }));
      }
    }
  };

  const fill = () => {
    const asked = new URLSearchParams(location.search);
    for (const form of document.querySelectorAll("form[data-soft]")) {
      for (const element of form.elements) {
        if (element.name && element.type !== "hidden") element.value = asked.get(element.name) ?? element.dataset.plain ?? "";
      }
    }
    keepForm();
  };

  const addressOf = (form) => {
    const asked = new URLSearchParams();
    for (const [name, value] of new FormData(form)) if (value !== "") asked.append(name, value);
    return `${location.pathname}?${asked}`;
  };

  document.addEventListener("click", (event) => {
    const link = event.target.closest?.("a[data-soft]");
    if (!link || event.ctrlKey || event.metaKey || event.shiftKey || event.button !== 0) return;
    event.preventDefault();
    go(link.getAttribute("href"));
  });
  for (const type of ["input", "submit"]) {
    document.addEventListener(type, (event) => {
      const form = event.target.closest?.("form[data-soft]");
      if (!form || (type === "input" && event.target.dataset.late !== undefined)) return;
      event.preventDefault();
      go(addressOf(form), true);
    });
  }
  addEventListener("popstate", () => {
    fill();
    renew();
  });

  // --- the timeline: its slider, its end, one node more

  const timeline = document.querySelector("[data-timeline]");
  const moment = timeline?.querySelector("[data-moment]");
  const until = timeline?.querySelector("[data-until]");

  const local = (ms) => {
    const at = new Date(ms);
    return new Date(ms - at.getTimezoneOffset() * 60000).toISOString().slice(0, 19);
  };

  // A moment and an end stand still: the present does not.
  const fix = (changes) => {
    const asked = new URLSearchParams(location.search);
    if (!asked.get("until")) asked.set("until", document.getElementById("timeline").dataset.to);
    for (const [name, value] of Object.entries(changes)) asked.set(name, value);
    go(`?${asked}`, true);
  };

  moment?.addEventListener("input", () => fix({ at: moment.value }));
  until?.addEventListener("change", () => {
    const ms = new Date(until.value).getTime();
    if (!Number.isNaN(ms)) fix({ until: ms });
  });
  timeline?.querySelector("[data-add]").addEventListener("submit", (event) => {
    event.preventDefault();
    const field = event.target.elements.namedItem("node");
    const input = field instanceof RadioNodeList ? field[field.length - 1] : field;
    const asked = new URLSearchParams(location.search);
    if (!asked.has("node")) {
      for (const lane of document.querySelectorAll(".lane[data-node]")) asked.append("node", lane.dataset.node);
    }
    if (input.value) asked.append("node", input.value);
    input.value = "";
    go(`?${asked}`);
  });

  const afterShow = () => {
    applyZoom();
    if (timeline) {
      const asked = new URLSearchParams(location.search);
      if (!asked.get("at") && document.activeElement !== moment) moment.value = 1000;
      const to = Number(document.getElementById("timeline").dataset.to);
      if (document.activeElement !== until) until.value = asked.get("until") ? local(to) : "";
    }
  };

  // --- the graph: larger and smaller, around the pointer

  let zoom = 1;
  const applyZoom = (x, y, before) => {
    const graph = document.getElementById("graph");
    if (!graph) return;
    const { width, height } = graph.viewBox.baseVal;
    graph.style.width = `${width * zoom}px`;
    graph.style.height = `${height * zoom}px`;
    if (before === undefined) return;
    const frame = graph.parentElement;
    frame.scrollLeft = (frame.scrollLeft + x) * (zoom / before) - x;
    frame.scrollTop = (frame.scrollTop + y) * (zoom / before) - y;
  };
  const whole = () => {
    const graph = document.getElementById("graph");
    const { width, height } = graph.viewBox.baseVal;
    const frame = graph.parentElement;
    zoom = Math.min(1.3, (frame.clientWidth - 30) / width, Math.max(300, innerHeight - frame.offsetTop - 40) / height);
    applyZoom();
  };
  const zoomBy = (factor, x, y) => {
    const before = zoom;
    zoom = Math.min(4, Math.max(0.1, zoom * factor));
    applyZoom(x, y, before);
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

  const rows = () => [...document.querySelectorAll("[data-row]")];
  const target = (row) => (row.matches("a") ? row : row.querySelector("[data-open], a"));
  const move = (step) => {
    const all = rows();
    const at = all.findIndex((row) => row.contains(document.activeElement));
    const next = all[at < 0 ? (step > 0 ? 0 : all.length - 1) : Math.min(all.length - 1, Math.max(0, at + step))];
    if (next) target(next)?.focus();
  };

  const press = {
    "/": () => document.getElementById("filter")?.focus(),
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
    if (event.ctrlKey || event.metaKey || event.altKey || help.open) return;
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

  for (const form of document.querySelectorAll("form[data-soft]")) form.dataset.scripted = "";
  localTimes();
  if (document.getElementById("graph")) whole();
  afterShow();
  keepForm();
  connect();
  setInterval(judge, CHECK_MS);
})();
