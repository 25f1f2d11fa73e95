// The what-if of an incident: dependencies and limits are changed in the text by a click, a mistake is marked beside its
// line and leads to it, and the text stays as it is while the answer comes.
(() => {
  "use strict";

  const fields = () => [...document.querySelectorAll(".what-if textarea")];
  const places = (index) => [...document.querySelectorAll(`#by-click [data-place][data-file="${index}"]`)];
  const lineOf = (field, at) => field.value.slice(0, at).split("\n").length;

  // --- the numbers of the lines, with what is wrong and what a click has changed

  const number = (field, index) => {
    const wrong = new Map();
    for (const { dataset, parentElement } of document.querySelectorAll(`#problems button[data-file="${index}"]`)) {
      const said = parentElement.textContent.trim();
      wrong.set(Number(dataset.line), [wrong.get(Number(dataset.line)), said].filter(Boolean).join("\n"));
    }
    const changed = new Set();
    for (const { dataset } of places(index)) {
      if (dataset.now !== undefined && dataset.now !== dataset.text) changed.add(lineOf(field, Number(dataset.start)));
    }
    const count = field.value.split("\n").length;
    const numbers = field.previousElementSibling;
    const shown = `${count} ${JSON.stringify([...wrong])} ${[...changed]}`;
    if (numbers.dataset.shown !== shown) {
      const line = (_, at) => {
        const text = document.createElement("span");
        text.textContent = `${at + 1}\n`;
        if (wrong.has(at + 1)) Object.assign(text, { className: "wrong", title: wrong.get(at + 1) });
        else if (changed.has(at + 1)) text.className = "changed";
        return text;
      };
      numbers.replaceChildren(...Array.from({ length: count }, line));
      numbers.dataset.shown = shown;
    }
    numbers.scrollTop = field.scrollTop;
  };

  // So that a line stands in the middle.
  const centre = (field, line) => {
    const height = parseFloat(getComputedStyle(field).lineHeight);
    field.scrollTop = Math.max(0, (line - 1) * height - field.clientHeight / 2);
    // The browser's own event of the scroll comes a frame later.
    number(field, fields().indexOf(field));
  };

  // --- places in the text, which move with it

  const texts = new WeakMap();

  const lose = (place) => {
    place.dataset.lost = "";
    for (const control of [place, ...place.querySelectorAll("button")]) control.disabled = true;
  };
  const move = (field, index) => {
    const before = texts.get(field) ?? field.value;
    const now = field.value;
    texts.set(field, now);
    if (before === now) return;
    const least = Math.min(before.length, now.length);
    let head = 0;
    while (head < least && before[head] === now[head]) head += 1;
    let tail = 0;
    while (tail < least - head && before.at(-1 - tail) === now.at(-1 - tail)) tail += 1;
    const [from, to, longer] = [head, before.length - tail, now.length - before.length];
    for (const place of places(index)) {
      const { dataset } = place;
      const start = Number(dataset.start);
      const end = start + (dataset.now ?? dataset.text).length;
      if (end <= from || dataset.lost !== undefined) continue;
      if (start >= to) dataset.start = start + longer;
      else lose(place);
    }
  };

  const write = (place, text) => {
    const field = fields()[place.dataset.file];
    const start = Number(place.dataset.start);
    const old = place.dataset.now ?? place.dataset.text;
    if (!field || field.value.slice(start, start + old.length) !== old) return lose(place);
    field.setRangeText(text, start, start + old.length, "preserve");
    texts.set(field, field.value);
    for (const other of places(place.dataset.file)) {
      const begin = Number(other.dataset.start);
      if (other !== place && begin > start) other.dataset.start = begin + text.length - old.length;
    }
    place.dataset.now = text;
    centre(field, lineOf(field, start));
    return undefined;
  };

  const listed = (place) => {
    const entries = [...place.querySelectorAll("[data-entry]")];
    const kept = entries.filter((entry) => entry.getAttribute("aria-pressed") === "true");
    if (kept.length === entries.length) return place.dataset.text;
    return `${place.dataset.before}[${kept.map((entry) => entry.dataset.entry).join(", ")}]`;
  };

  document.addEventListener("click", ({ target }) => {
    const entry = target.closest?.("#by-click [data-entry]");
    if (!entry) return;
    entry.setAttribute("aria-pressed", entry.getAttribute("aria-pressed") !== "true");
    const place = entry.closest("[data-place]");
    write(place, listed(place));
  });
  document.addEventListener("input", ({ target }) => {
    // Without a value there is no limit to write: the last one stays until there is another.
    if (target.matches("#by-click input") && target.value.trim()) write(target, target.value.trim());
  });

  // --- what is typed and what is answered

  for (const event of ["input", "scroll"]) {
    document.addEventListener(event, ({ target }) => {
      const index = fields().indexOf(target);
      if (index < 0) return;
      if (event === "input") move(target, index);
      number(target, index);
    }, true);
  }
  const begin = () => {
    document.getElementById("by-click")?.removeAttribute("hidden");
    for (const [index, field] of fields().entries()) {
      if (!texts.has(field)) texts.set(field, field.value);
      number(field, index);
    }
  };
  for (const event of ["telltale:page", "telltale:shown"]) addEventListener(event, begin);
  begin();

  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("#problems button");
    const field = button && fields()[button.dataset.file];
    if (!field) return;
    const lines = field.value.split("\n");
    const line = Math.min(button.dataset.line, lines.length) - 1;
    const start = lines.slice(0, line).reduce((sum, text) => sum + text.length + 1, 0);
    field.focus();
    field.setSelectionRange(start, start + lines[line].length);
    centre(field, line + 1);
  });

  // Only what was found is asked for anew. If that fails, the browser shows the answer.
  document.addEventListener("submit", async (event) => {
    const form = event.target.closest?.(".what-if form");
    if (!form) return;
    event.preventDefault();
    const body = new URLSearchParams(new FormData(form, event.submitter));
    try {
      const answer = await fetch(form.action, { method: "POST", body, headers: { Accept: "application/json" } });
      if (answer.redirected || !answer.ok) throw new Error(`status ${answer.status}`);
      await telltale.go(location.pathname, true);
    } catch {
      form.submit();
    }
  });
})();
