// Keeps the look of an alarm for a third of a second, so that nothing flashes more than three times a second: an
// element that turns less severe earlier is swapped in later, as a whole. An alarm that begins or grows never waits.
(() => {
  "use strict";
  const KEPT_MS = 350;
  // The elements with large coloured areas, as they stand in a message.
  const COLOURED = /<(button|section) id="(tile-[^"]*|instruction)"[^>]*>[\s\S]*?<\/\1>/g;
  const SEVERE = /data-(?:state="error"|urgency="take_over")/;
  const MILD = /data-(?:state="warning"|urgency="be_ready"|blocked)/;

  const severity = (html) => {
    const [tag] = html.match(/^<[^>]*>/);
    return SEVERE.test(tag) ? 2 : MILD.test(tag) ? 1 : 0;
  };
  const shownSeverity = (id) => {
    const shown = document.getElementById(id);
    return shown ? severity(shown.cloneNode(false).outerHTML) : 0;
  };

  globalThis.SteadyAlarms = class {
    // When the present look of an element came on the screen, for those that show an alarm.
    #since = new Map();
    // The newest version of each element that waits.
    #waiting = new Map();

    // The content without the elements that wait.
    filter(content) {
      const now = performance.now();
      return content.replace(COLOURED, (html, _, id) => {
        this.#waiting.delete(id);
        const [was, is] = [shownSeverity(id), severity(html)];
        const leftMs = (this.#since.get(id) ?? -KEPT_MS) + KEPT_MS - now;
        if (is >= was || leftMs <= 0) {
          this.#note(id, was, is);
          return html;
        }
        this.#waiting.set(id, html);
        setTimeout(() => this.#swap(id, html), leftMs);
        return "";
      });
    }

    #swap(id, html) {
      if (this.#waiting.get(id) !== html) return;
      this.#waiting.delete(id);
      this.#note(id, shownSeverity(id), severity(html));
      htmx.swap({ sourceElement: document.body, target: document.body, swap: "none", text: html });
    }

    #note(id, was, is) {
      if (is === 0) this.#since.delete(id);
      else if (is !== was) this.#since.set(id, performance.now());
    }
  };
})();
