// What "live" means, for every page that shows the vehicle: heartbeats come, and come in time. Opens
// the page's connection again after the server answered, and shows the pulse. Looks are the stylesheet's.
(() => {
  "use strict";
  const STALE_MS = 1000;
  const DEAD_MS = 2000;
  const CHECK_MS = 100;
  // A connection that hangs without an end, or brings everything late, is replaced after this.
  const HANG_MS = 4000;
  // One that is being opened gets longer: the server has just answered, and a browser may hold it back.
  const OPENING_MS = 15000;
  // Between two that were not opened.
  const RETRY_MS = 1000;
  const ANSWER_MS = 2000;
  const ASK_AGAIN_MS = 500;
  // Nobody did anything: this request keeps no session alive.
  const RENEWAL = { "Telltale-Renewal": "1" };

  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

  const setText = (element, text) => {
    if (element.textContent !== text) element.textContent = text;
  };

  // How late heartbeats come. Each says the server's own time, and what that and the monotonic clock
  // of this page are apart grows by delay on the way alone. The page's wall clock takes no part.
  class Lag {
    // Two clocks that both run right drift apart by less than this.
    static DRIFT = 0.0002;
    // A connection that took longer to open may have been as late as that from its beginning.
    static OPENING_MS = 500;
    #opening = 0;
    #least = Infinity;
    #leastAt = 0;

    // A connection is there. What an earlier one has told is no measure for this one.
    begin(opening) {
      this.#opening = opening > Lag.OPENING_MS ? opening : 0;
      this.#least = Infinity;
    }

    // How long ago the server said this, in milliseconds: `ms` is its monotonic clock, `at` its wall clock.
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

  // Browsers make sockets wait longer and longer after some that failed, and requests never: so one
  // asks first. Whatever the server answers, it is there.
  const serverAnswers = async () => {
    while (!(await ask("/readyz"))) await pause(ASK_AGAIN_MS);
  };

  // Large messages are read once, for all who want to know.
  let last = { data: null, message: null };
  const read = (data) => {
    if (last.data !== data) last = { data, message: JSON.parse(data) };
    return last.message;
  };

  // A page has one of these, and tells it what is its own:
  //   address   where it is found
  //   connect   opens a connection in place of the one that is there
  //   beat      takes a heartbeat
  //   judged    is called after each look at the age, with what it came to
  //   unshown   how long what the connection brought has waited to be shown, in milliseconds
  //   behind    how old its content is that comes another way
  globalThis.Live = class {
    static STALE_MS = STALE_MS;
    static DEAD_MS = DEAD_MS;
    static RENEWAL = RENEWAL;
    static read = read;
    static setText = setText;

    // The connection that brings the heartbeats, once it is open.
    socket = null;
    // The server's wall clock at the last heartbeat, as it said it: taps say by it when they were made.
    beatAt = "";
    everBeat = false;
    // When the last heartbeat came, and how late it was.
    lastBeat = performance.now();
    late_ms = 0;

    #page;
    #mark = document.querySelector("#live .pulse");
    #clock = document.getElementById("clock");
    #lag = new Lag();
    #listeners = [];
    #triedAt = performance.now();
    #isOpening = true;
    #isOpen = false;
    // The server is asked whether it answers.
    #isAsking = false;

    constructor(page) {
      this.#page = page;
      setInterval(() => this.judge(), CHECK_MS);
    }

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

    // It is being opened.
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
      if (code === 1008) return location.assign("/login");
      const wasOpen = this.#isOpen;
      this.#isOpen = false;
      this.#isOpening = false;
      if (!wasOpen) {
        // The server answers a request without a session with the way to the login.
        const answer = await ask(this.#page.address, { method: "HEAD" });
        if (answer?.type === "opaqueredirect") location.assign("/login");
      }
      return this.#reconnect(wasOpen ? 0 : RETRY_MS);
    }

    // Says by how old what is shown is whether it is live, stale or dead.
    judge() {
      const now = performance.now();
      const heard = this.#heardAge(now);
      const age = Math.max(heard, this.#page.behind?.(now) ?? 0);
      const live = age >= DEAD_MS ? "dead" : age >= STALE_MS || !this.everBeat ? "stale" : "live";
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
      setText(this.#clock, new Date(message.at).toTimeString().slice(0, 8));
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
