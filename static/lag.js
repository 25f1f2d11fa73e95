// Measures how late heartbeats arrive. Each carries the server's own time; the difference to the monotonic
// clock of this page grows only with delay on the way. The page's wall clock is not used.
(() => {
  "use strict";
  // Two correct clocks drift apart by less than this.
  const DRIFT = 0.0002;
  // A connection that took longer to open may have been late by that time from the beginning.
  const OPENING_MS = 500;

  globalThis.Lag = class {
    #tried = performance.now();
    #opening = 0;
    #least = Infinity;
    #leastAt = 0;

    // Somebody asks the server for a connection.
    try() {
      this.#tried = performance.now();
    }

    // It is open. The figures of an earlier connection do not apply to it.
    open() {
      const opening = performance.now() - this.#tried;
      this.#opening = opening > OPENING_MS ? opening : 0;
      this.#least = Infinity;
    }

    // How long ago the server said this, in milliseconds: `ms` is its monotonic clock, `at` what
    // its wall clock showed.
    of({ ms, at }) {
      const now = performance.now();
      const apart = now - (typeof ms === "number" ? ms : Date.parse(at));
      this.#least = Math.min(this.#least + (now - this.#leastAt) * DRIFT, apart);
      this.#leastAt = now;
      return apart - this.#least + this.#opening;
    }
  };
})();
