// Updates the operator's page: takes in what the server sends, confirms what is on the screen, and counts
// times on. `live.js` decides whether the display is live.
(() => {
  "use strict";
  // An alarm calls once in this time.
  const CALL_MS = 1000;

  const body = document.body;
  const hidden = new HiddenPanels();
  const alarms = new SteadyAlarms();
  // The server's wall clock at the last heartbeat.
  let serverAt = NaN;
  // The first message that came and is not on the screen yet.
  let unshownSince = null;
  let received = -1;
  // The server has another version than this page.
  let outdated = false;

  // --- times that count on by themselves

  const span = (ms) => {
    const s = Math.max(0, Math.round(ms / 1000));
    if (s < 60) return `${s} s`;
    if (s < 3600) return `${Math.floor(s / 60)} min`;
    if (s < 86400) return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
    return `${Math.floor(s / 86400)} d`;
  };

  const timeOfDay = (ms) => new Date(ms).toTimeString().slice(0, 5);

  // Where times are visible: in the list of faults, beside the steps and in open panels.
  const open = new Set([document.querySelector("aside"), document.getElementById("actions")]);

  const tickTimes = () => {
    if (Number.isNaN(serverAt)) return;
    const now = serverAt + live.late_ms + (performance.now() - live.lastBeat);
    for (const part of [...open, document.getElementById("instruction")]) {
      for (const time of part.querySelectorAll("time[datetime]")) {
        const then = Date.parse(time.dateTime);
        Live.setText(time, time.classList.contains("clock") ? timeOfDay(then) : span(now - then));
      }
    }
  };

  // --- what is wrong, spoken: no times, so that it changes with the meaning alone

  const said = document.getElementById("said");

  const announce = () => {
    const faults = [...document.querySelectorAll("#causes-list [data-node]:not([data-over]) .title")];
    const all = faults.length > 0 ? faults : [...document.querySelectorAll("#causes-calm")];
    Live.setText(said, all.map((it) => it.textContent.trim()).join(". "));
  };

  // --- live, stale, dead

  const judged = (is, now) => {
    if (is === "dead") {
      const at = document.getElementById("clock").textContent;
      for (const since of document.querySelectorAll(".frozen-at")) Live.setText(since, at);
      dispatchEvent(new Event("telltale:dead"));
    }
    if (is === "live" || is === "replay") tickTimes();
    body.toggleAttribute("data-ebb", now % CALL_MS >= CALL_MS / 2);
    hidden.updateNext();
    renew();
  };

  // Loads the page of the other version as soon as no tap waits for its answer: a reload would abort the
  // request, and nobody would report it.
  const renew = () => {
    if (!outdated || "unanswered" in body.dataset) return;
    outdated = false;
    location.reload();
  };

  // --- the connection

  // In a replay the address of the socket is another one.
  const socket = document.getElementById("socket").getAttribute("hx-ws:connect").split("?")[0];

  // A new element closes the old connection and opens one of its own.
  const connect = () => {
    const lang = encodeURIComponent(document.documentElement.lang);
    htmx.swap({
      sourceElement: body,
      target: "#socket",
      swap: "outerHTML",
      text: `<div id="socket" hidden hx-ws:connect="${socket}?lang=${lang}"></div>`,
    });
  };

  const live = new Live({
    address: "/",
    connect,
    beat: ({ at }) => (serverAt = Date.parse(at)),
    judged,
    unshown: (now) => (unshownSince === null ? 0 : now - unshownSince),
  });
  globalThis.telltale = { live };

  // Reports what is on the screen. If nothing is painted nothing is reported, and the server knows.
  const confirmShown = (socket, { seq, beat }) => {
    requestAnimationFrame(() => {
      if (unshownSince === null && socket.readyState === WebSocket.OPEN) {
        socket.send(JSON.stringify({ shown: seq, beat }));
      }
    });
  };

  live.listen((message, socket) => {
    if (typeof message.beat === "number") {
      confirmShown(socket, message);
      if (message.recorder && body.dataset.recorder !== message.recorder) body.dataset.recorder = message.recorder;
    }
    if (typeof message.content !== "string") return;
    received = message.seq;
    unshownSince ??= performance.now();
  });

  document.addEventListener("htmx:ws:before:connection", () => live.trying());

  document.addEventListener("htmx:ws:after:connection", (event) => {
    hidden.reset();
    unshownSince = null;
    live.opened(event.detail.connection.socket);
  });

  document.addEventListener("htmx:ws:close", (event) => {
    // It was replaced.
    if (event.detail.reason !== "removed") live.closed(event.detail.code);
  });

  // Large messages are parsed once: htmx takes the parts to swap in from here.
  document.addEventListener("htmx:ws:before:message:incoming", ({ detail: { message } }) => {
    if (typeof message.data !== "string") return;
    const read = Live.read(message.data);
    const { content } = read;
    const shown = typeof content === "string" ? { ...read, content: alarms.filter(content) } : read;
    message.json = async () => shown;
    hidden.receive(read);
  });

  document.addEventListener("htmx:ws:after:message:incoming", async (event) => {
    const { connection, message } = event.detail;
    const { seq, content } = await message.json();
    if (typeof content !== "string") return;
    requestAnimationFrame(() => {
      if (seq >= received) unshownSince = null;
      if (connection.socket?.readyState === WebSocket.OPEN) {
        connection.socket.send(JSON.stringify({ shown: seq }));
      }
    });
  });

  // --- attributes of swapped elements that concern the whole page

  document.addEventListener("htmx:after:swap", () => {
    const { stage, layout } = document.getElementById("top").dataset;
    body.dataset.stage = stage;
    if (stage === "locked" && body.dataset.replay === undefined) return Live.toLogin();
    outdated = layout !== body.dataset.layout;
    renew();
    tickTimes();
    announce();
  });

  document.addEventListener(
    "beforetoggle",
    ({ target, newState }) => {
      if (newState !== "open") return open.delete(target);
      hidden.open(target);
      open.add(target);
      return tickTimes();
    },
    { capture: true },
  );

  document.addEventListener("telltale:refresh", () => live.connect());

  document.addEventListener("telltale:language", (event) => {
    event.preventDefault();
    document.documentElement.lang = event.detail.lang;
    live.connect();
  });

  body.dataset.watched = "";
})();
