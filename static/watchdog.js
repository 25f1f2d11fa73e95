// The operator's page while it is connected: takes in what the server sends, answers when it is on the
// screen, and lets times count on. `live.js` says whether the display is live.
(() => {
  "use strict";
  // An alarm calls once in this time.
  const CALL_MS = 1000;

  const body = document.body;
  const behind = new Behind();
  // The server's wall clock at the last heartbeat.
  let serverAt = NaN;
  // The first message that came and is not on the screen yet.
  let unshownSince = null;
  let received = -1;
  // The server is of another version than this page.
  let outdated = false;

  // --- times that count on by themselves

  const span = (ms) => {
    const s = Math.max(0, Math.round(ms / 1000));
    if (s < 60) return `${s} s`;
    if (s < 3600) return `${Math.floor(s / 60)} min`;
    if (s < 86400) return `${Math.floor(s / 3600)} h ${Math.floor((s % 3600) / 60)} min`;
    return `${Math.floor(s / 86400)} d`;
  };

  // Where there are times to be seen: in the list of what is wrong, and in what is open.
  const open = new Set([document.querySelector("aside")]);

  const tickTimes = () => {
    if (Number.isNaN(serverAt)) return;
    const now = serverAt + live.late_ms + (performance.now() - live.lastBeat);
    for (const part of open) {
      for (const time of part.querySelectorAll("time[datetime]")) {
        Live.setText(time, span(now - Date.parse(time.dateTime)));
      }
    }
  };

  // --- live, stale, dead

  const judged = (is, now) => {
    if (is === "dead") dispatchEvent(new Event("telltale:dead"));
    if (is === "live") tickTimes();
    body.toggleAttribute("data-ebb", now % CALL_MS >= CALL_MS / 2);
    behind.follow();
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

  // A new element closes the old connection and opens one of its own.
  const connect = () => {
    const lang = document.documentElement.lang === "de" ? "de" : "en";
    htmx.swap({
      sourceElement: body,
      target: "#socket",
      swap: "outerHTML",
      text: `<div id="socket" hidden hx-ws:connect="/ws?lang=${lang}"></div>`,
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
    if (typeof message.beat === "number") confirmShown(socket, message);
    if (typeof message.content !== "string") return;
    received = message.seq;
    unshownSince ??= performance.now();
  });

  document.addEventListener("htmx:ws:before:connection", () => live.trying());

  document.addEventListener("htmx:ws:after:connection", (event) => {
    behind.begin();
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
    message.json = async () => read;
    behind.hear(read);
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

  // --- what the swapped elements say about the page around them

  document.addEventListener("htmx:after:swap", () => {
    const { stage, layout } = document.getElementById("top").dataset;
    body.dataset.stage = stage;
    if (stage === "locked") return location.assign("/login");
    outdated = layout !== body.dataset.layout;
    renew();
    tickTimes();
  });

  document.addEventListener(
    "beforetoggle",
    ({ target, newState }) => {
      if (newState !== "open") return open.delete(target);
      behind.open(target);
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
