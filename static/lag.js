// How late heartbeats come. Each says the server's own time, and what that and the monotonic clock
// of this page are apart grows by delay on the way alone. The page's wall clock takes no part.
(() => {
  "use strict";
  // Two clocks that both run right drift apart by less than this.
  const DRIFT = 0.0002;
  // A connection that took longer to open may have been as late as that from its beginning.
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

    // It is there. What an earlier one has told is no measure for this one.
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
