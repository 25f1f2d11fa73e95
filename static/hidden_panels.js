// Updates the panels and sheets of the operator's page, element by element: open ones at once, others
// before they are opened, or slowly while they are hidden.
(() => {
  "use strict";
  const APART_MS = 150;
  // While states come without a pause, hidden panels are updated more slowly.
  const BUSY_MS = 400;
  const APART_BUSY_MS = 2000;

  const panelOf = (id) => document.getElementById(id)?.closest("[popover]");

  globalThis.HiddenPanels = class {
    // The newest version of each element that is not in the page yet.
    #waiting = new Map();
    #updatedAt = 0;
    #busyUntil = 0;
    #isNew = true;

    // A new connection brings everything at once, perhaps in another language.
    reset() {
      this.#isNew = true;
    }

    // A message of the server: `content` has visible elements, `behind` those of panels.
    receive({ content, behind }) {
      if (typeof content === "string") this.#busyUntil = performance.now() + BUSY_MS;
      // A newer version keeps the place of the older one in the queue.
      for (const [id, element] of Object.entries(behind ?? {})) this.#waiting.set(id, element);
      const all = this.#isNew;
      if (behind) this.#isNew = false;
      this.#update((id) => all || panelOf(id)?.matches(":popover-open"));
    }

    open(panel) {
      this.#update((id) => panelOf(id) === panel);
    }

    // Updates the element that has waited longest, if it is time.
    updateNext() {
      const now = performance.now();
      const apart = now < this.#busyUntil ? APART_BUSY_MS : APART_MS;
      if (now - this.#updatedAt < apart || this.#waiting.size === 0) return;
      this.#updatedAt = now;
      const [next] = this.#waiting.keys();
      this.#update((id) => id === next);
    }

    #update(isMeant) {
      const ids = [...this.#waiting.keys()].filter(isMeant);
      if (ids.length === 0) return;
      const text = ids.map((id) => this.#waiting.get(id)).join("");
      for (const id of ids) this.#waiting.delete(id);
      htmx.swap({ sourceElement: document.body, target: document.body, swap: "none", text });
    }
  };
})();
