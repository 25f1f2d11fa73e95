// Waits until the server answers a request. Pages do so before they open a socket again, because browsers
// delay sockets more and more after failures, and never delay requests.
(() => {
  "use strict";
  const ANSWER_MS = 2000;
  const RETRY_MS = 500;
  // Nobody did anything: this keeps no session alive.
  const RENEWAL = { "Telltale-Renewal": "1" };

  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

  globalThis.Server = class {
    // One request at a time: a browser has few connections to one server, and a stop needs one.
    async ask(address, options) {
      const signal = AbortSignal.timeout(ANSWER_MS);
      try {
        return await fetch(address, { headers: RENEWAL, redirect: "manual", cache: "no-store", signal, ...options });
      } catch {
        return null;
      }
    }

    // Any answer shows that the server is there.
    async answers() {
      while (!(await this.ask("/readyz"))) await pause(RETRY_MS);
    }

    // It answers a request without a session with the way to the login.
    async leaveIfLoggedOut(page) {
      const answer = await this.ask(page, { method: "HEAD" });
      if (answer?.type === "opaqueredirect") location.assign("/login");
    }
  };
})();
