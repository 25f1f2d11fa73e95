// Decides whether a page is live, by the age of the server's heartbeats. Opens the page's connection again
// when it is lost, and shows the pulse.
(() => {
  "use strict";
  const STALE_MS = 1000;
  const DEAD_MS = 2000;
  const CHECK_MS = 100;
  // A connection that hangs without an end, or brings everything late, is replaced after this.
  const HANG_MS = 4000;
  // A connection that is being opened gets more time, because a browser may hold it back.
  const OPENING_MS = 15000;
  // Between two attempts that failed.
  const RETRY_MS = 1000;
  const ANSWER_MS = 2000;
  const ASK_AGAIN_MS = 500;
  // With this header a request keeps no session alive, because no person made it.
  const RENEWAL = { "Telltale-Renewal": "1" };

  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

  const setText = (element, text) => {
    if (element.textContent !== text) element.textContent = text;
  };

  // Once: the answer to a logout and the end of its connection come together, and a second navigation
  // aborts the first.
  let leaves = false;
  const toLogin = () => {
    if (!leaves) location.assign("/login");
    leaves = true;
  };
  // The browser's way back shows the page as it was left.
  addEventListener("pageshow", () => {
    leaves = false;
  });

  // How late heartbeats come. Each has the time of the server's monotonic clock; its difference to the
  // page's monotonic clock grows only by delay on the way. The page's wall clock takes no part.
  class Lag {
    // Two clocks that both run right drift apart by less than this.
    static DRIFT = 0.0002;
    // A connection that took longer to open may have been as late as that from its beginning.
    static OPENING_MS = 500;
    #opening = 0;
    #least = Infinity;
    #leastAt = 0;

    // A new connection: differences of an earlier one do not count.
    begin(opening) {
      this.#opening = opening > Lag.OPENING_MS ? opening : 0;
      this.#least = Infinity;
    }

    // How late a heartbeat is, in milliseconds: `ms` is the server's monotonic clock, `at` its wall clock.
    of({ ms, at }) {
      const now = performance.now();
      const apart = now - (typeof ms === "number" ? ms : Date.parse(at));
      this.#least = Math.min(this.#least + (now - this.#leastAt) * Lag.DRIFT, apart);
      this.#leastAt = now;
      return apart - this.#least + this.#opening;
    }
  }

  // One request at a time: a browser has few connections to one server, and a stop needs one.
  const ask = async (address, options) => {
    const signal = AbortSignal.timeout(ANSWER_MS);
    try {
      return await fetch(address, { headers: RENEWAL, redirect: "manual", cache: "no-store", signal, ...options });
    } catch {
      return null;
    }
  };

  // Browsers hold back sockets after some that failed, but never requests. So a request is sent first; any
  // answer will do.
  const serverAnswers = async () => {
    while (!(await ask("/readyz"))) await pause(ASK_AGAIN_MS);
  };

  // A large message is parsed once, for all listeners.
  let last = { data: null, message: null };
  const read = (data) => {
    if (last.data !== data) last = { data, message: JSON.parse(data) };
    return last.message;
  };

  // Each page makes one of these, from:
  //   address   the address of the page
  //   connect   opens a connection in place of the one that is there
  //   beat      takes a heartbeat
  //   judged    is called after each judgement with its result
  //   unshown   for how long a received message has waited to be shown, in milliseconds
  //   behind    the age of content that does not come over the connection
  globalThis.Live = class {
    static STALE_MS = STALE_MS;
    static DEAD_MS = DEAD_MS;
    static RENEWAL = RENEWAL;
    static read = read;
    static setText = setText;
    static toLogin = toLogin;

    // The connection that brings the heartbeats, once it is open.
    socket = null;
    // The server's wall clock at the last heartbeat, as it was sent: a tap carries it as its time.
    beatAt = "";
    everBeat = false;
    // When the last heartbeat came, and how late it was.
    lastBeat = performance.now();
    late_ms = 0;

    #page;
    #mark = document.querySelector("#live .pulse");
    #clock = document.getElementById("clock");
    // Of a replay.
    #date = document.getElementById("date");
    #lag = new Lag();
    #listeners = [];
    #triedAt = performance.now();
    #isOpening = true;
    #isOpen = false;
    // A request waits for the server's answer.
    #isAsking = false;

    constructor(page) {
      this.#page = page;
      setInterval(() => this.judge(), CHECK_MS);
    }

    // A recording is shown: it is never live, and never late.
    #isReplay = document.body.dataset.replay !== undefined;

    get isLive() {
      return document.body.dataset.live === "live";
    }

    // Calls this with each message of each connection.
    listen(listener) {
      this.#listeners.push(listener);
    }

    // Opens a connection in place of the one that is there.
    connect() {
      this.#triedAt = performance.now();
      this.#isOpening = true;
      this.#isOpen = false;
      this.#page.connect();
    }

    // The connection is being opened.
    trying() {
      this.#triedAt = performance.now();
    }

    opened(socket) {
      this.#lag.begin(performance.now() - this.#triedAt);
      this.socket = socket;
      this.#isOpen = true;
      this.#isOpening = false;
      this.#triedAt = performance.now();
      socket.addEventListener("message", ({ data }) => {
        if (typeof data !== "string") return;
        const message = read(data);
        if (typeof message.beat === "number") this.#beat(message);
        for (const listener of this.#listeners) listener(message, socket);
      });
    }

    // It was closed, or could not be opened.
    async closed(code) {
      if (code === 1008) return toLogin();
      const wasOpen = this.#isOpen;
      this.#isOpen = false;
      this.#isOpening = false;
      if (!wasOpen) {
        // The server answers a request without a session with the way to the login.
        const answer = await ask(this.#page.address, { method: "HEAD" });
        if (answer?.type === "opaqueredirect") toLogin();
      }
      return this.#reconnect(wasOpen ? 0 : RETRY_MS);
    }

    // Decides by the age of what is shown whether the page is live, stale or dead.
    judge() {
      const now = performance.now();
      const heard = this.#heardAge(now);
      const age = Math.max(heard, this.#page.behind?.(now) ?? 0);
      const live = this.#isReplay ? "replay" : age >= DEAD_MS ? "dead" : age >= STALE_MS || !this.everBeat ? "stale" : "live";
      if (document.body.dataset.live !== live) document.body.dataset.live = live;
      this.#page.judged(live, now);
      const isBad = heard >= DEAD_MS || this.late_ms >= STALE_MS;
      if (isBad && now - this.#triedAt > (this.#isOpening ? OPENING_MS : HANG_MS)) this.#reconnect(0);
    }

    #heardAge(now) {
      return Math.max(now - this.lastBeat + this.late_ms, this.#page.unshown?.(now) ?? 0);
    }

    #beat(message) {
      this.lastBeat = performance.now();
      this.late_ms = this.#lag.of(message);
      this.everBeat = true;
      this.beatAt = message.at;
      delete document.body.dataset.waiting;
      this.#mark.dataset.phase = message.beat % 8;
      const at = new Date(message.at);
      setText(this.#clock, at.toTimeString().slice(0, 8));
      if (this.#date) setText(this.#date, at.toLocaleDateString(document.documentElement.lang, { dateStyle: "medium" }));
      this.#page.beat(message);
      this.judge();
    }

    // Opens another connection once the server answers, unless there is a good one by then.
    async #reconnect(waitMs) {
      if (this.#isAsking) return;
      this.#isAsking = true;
      await pause(waitMs);
      await serverAnswers();
      this.#isAsking = false;
      const now = performance.now();
      const isTried = this.#isOpening && now - this.#triedAt < OPENING_MS;
      const isGood = this.#isOpen && this.#heardAge(now) < DEAD_MS && this.late_ms < STALE_MS;
      if (!isTried && !isGood) this.connect();
    }
  };
})();
