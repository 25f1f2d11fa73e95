// The operator's page: takes in what stands behind the tiles and on sheets, element by element. An open
// panel is brought up to date at once, one that is opened before it is seen; hidden ones follow bit by bit.
(() => {
  "use strict";
  const APART_MS = 150;
  // While states come without a pause, hidden panels are updated more slowly.
  const BUSY_MS = 400;
  const APART_BUSY_MS = 2000;

  const panelOf = (id) => document.getElementById(id)?.closest("[popover]");

  globalThis.Behind = class {
    // The newest version of each element that is not in the page yet.
    #waiting = new Map();
    #takenAt = 0;
    #busyUntil = 0;
    #isNew = true;

    // A new connection brings everything at once, perhaps in another language.
    begin() {
      this.#isNew = true;
    }

    // A message of the server: what is in sight is content.
    hear({ content, behind }) {
      if (typeof content === "string") this.#busyUntil = performance.now() + BUSY_MS;
      // A newer version keeps the place of the older one in the queue.
      for (const [id, element] of Object.entries(behind ?? {})) this.#waiting.set(id, element);
      const all = this.#isNew;
      if (behind) this.#isNew = false;
      this.#take((id) => all || panelOf(id)?.matches(":popover-open"));
    }

    open(panel) {
      this.#take((id) => panelOf(id) === panel);
    }

    // Updates the element that has waited longest, if it is time.
    follow() {
      const now = performance.now();
      const apart = now < this.#busyUntil ? APART_BUSY_MS : APART_MS;
      if (now - this.#takenAt < apart || this.#waiting.size === 0) return;
      this.#takenAt = now;
      const [next] = this.#waiting.keys();
      this.#take((id) => id === next);
    }

    #take(isMeant) {
      const ids = [...this.#waiting.keys()].filter(isMeant);
      if (ids.length === 0) return;
      const text = ids.map((id) => this.#waiting.get(id)).join("");
      for (const id of ids) this.#waiting.delete(id);
      htmx.swap({ sourceElement: document.body, target: document.body, swap: "none", text });
    }
  };
})();
