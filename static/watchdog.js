// Decides whether the display is live. It trusts only the server's heartbeat and the monotonic clock, not
// htmx and not the socket's state. A late heartbeat counts from when it was sent. The stylesheet defines
// the looks of "stale" and "dead".
(() => {
  "use strict";
  const STALE_MS = 1000;
  const DEAD_MS = 2000;
  const CHECK_MS = 100;
  // An alarm flashes once in this time.
  const CALL_MS = 1000;
  // A connection that hangs without an end, or brings everything late, is replaced after this.
  const HANG_MS = 4000;
  // A connection that is being opened gets longer: the server has just answered, and a browser may hold it
  // back.
  const OPENING_MS = 15000;
  // The pause between two attempts that failed.
  const RETRY_MS = 1000;

  const body = document.body;
  const mark = document.querySelector("#live .pulse");
  const clock = document.getElementById("clock");

  const lag = new Lag();
  const behind = new Behind();
  const server = new Server();
  // When the last heartbeat came, and how late it was.
  let lastBeat = performance.now();
  let late_ms = 0;
  let everBeat = false;
  let lastTry = performance.now();
  // The server's wall clock at the last heartbeat.
  let serverAt = NaN;
  // The first message that came and is not on the screen yet.
  let unshownSince = null;
  let received = -1;
  let opened = false;
  let opening = true;
  // The server is asked whether it answers.
  let asking = false;
  // The server is of another version than this page.
  let outdated = false;

  const setText = (element, text) => {
    if (element.textContent !== text) element.textContent = text;
  };

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
    const now = serverAt + late_ms + (performance.now() - lastBeat);
    for (const part of open) {
      for (const time of part.querySelectorAll("time[datetime]")) {
        setText(time, span(now - Date.parse(time.dateTime)));
      }
    }
  };

  // --- live, stale, dead

  const judge = () => {
    const now = performance.now();
    const age = Math.max(now - lastBeat + late_ms, unshownSince === null ? 0 : now - unshownSince);
    const live = age >= DEAD_MS ? "dead" : age >= STALE_MS || !everBeat ? "stale" : "live";
    if (body.dataset.live !== live) body.dataset.live = live;
    if (live === "dead") dispatchEvent(new Event("telltale:dead"));
    if (live === "live") tickTimes();
    body.toggleAttribute("data-ebb", now % CALL_MS >= CALL_MS / 2);
    behind.follow();
    renew();
    const isBad = live === "dead" || late_ms >= STALE_MS;
    if (isBad && now - lastTry > (opening ? OPENING_MS : HANG_MS)) reconnect(0);
  };

  const beat = (message) => {
    lastBeat = performance.now();
    late_ms = lag.of(message);
    everBeat = true;
    serverAt = Date.parse(message.at);
    // Each tap says with which heartbeat it was made.
    globalThis.telltale = { beatAt: message.at };
    delete body.dataset.waiting;
    mark.dataset.phase = message.beat % 8;
    setText(clock, new Date(serverAt).toTimeString().slice(0, 8));
    judge();
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
  const connect = (lang) => {
    lastTry = performance.now();
    opened = false;
    opening = true;
    htmx.swap({
      sourceElement: body,
      target: "#socket",
      swap: "outerHTML",
      text: `<div id="socket" hidden hx-ws:connect="/ws?lang=${lang === "de" ? "de" : "en"}"></div>`,
    });
  };

  // Opens another connection once the server answers, unless there is a good one by then.
  const reconnect = async (waitMs) => {
    if (asking) return;
    asking = true;
    await new Promise((resolve) => setTimeout(resolve, waitMs));
    await server.answers();
    asking = false;
    const isTried = opening && performance.now() - lastTry < OPENING_MS;
    const isGood = opened && body.dataset.live !== "dead" && late_ms < STALE_MS;
    if (!isTried && !isGood) connect(document.documentElement.lang);
  };

  // Reports what is on the screen. If nothing is painted nothing is reported, and the server knows.
  const confirmShown = (socket, { seq, beat }) => {
    requestAnimationFrame(() => {
      if (unshownSince === null && socket.readyState === WebSocket.OPEN) {
        socket.send(JSON.stringify({ shown: seq, beat }));
      }
    });
  };

  document.addEventListener("htmx:ws:before:connection", () => lag.try());

  document.addEventListener("htmx:ws:after:connection", (event) => {
    const { socket } = event.detail.connection;
    lag.open();
    behind.begin();
    opened = true;
    opening = false;
    lastTry = performance.now();
    unshownSince = null;
    socket.addEventListener("message", ({ data }) => {
      if (typeof data !== "string") return;
      let message;
      try {
        message = JSON.parse(data);
      } catch {
        return;
      }
      if (typeof message.beat === "number") {
        beat(message);
        confirmShown(socket, message);
      }
      if (typeof message.content === "string") {
        received = message.seq;
        unshownSince ??= performance.now();
      }
    });
  });

  document.addEventListener("htmx:ws:close", async (event) => {
    // It was replaced.
    if (event.detail.reason === "removed") return;
    if (event.detail.code === 1008) return void location.assign("/login");
    const wasOpen = opened;
    opened = false;
    opening = false;
    if (!wasOpen) await server.leaveIfLoggedOut("/");
    reconnect(wasOpen ? 0 : RETRY_MS);
  });

  // Large messages are parsed once: htmx takes the parts to swap in from here.
  document.addEventListener("htmx:ws:before:message:incoming", ({ detail: { message } }) => {
    if (typeof message.data !== "string") return;
    const read = JSON.parse(message.data);
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

  document.addEventListener("telltale:refresh", () => connect(document.documentElement.lang));

  document.addEventListener("telltale:language", (event) => {
    event.preventDefault();
    document.documentElement.lang = event.detail.lang;
    connect(event.detail.lang);
  });

  body.dataset.watched = "";
  setInterval(judge, CHECK_MS);
})();
