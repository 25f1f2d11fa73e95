// Copies a table of the developer's pages, or saves it as CSV or JSON: with all rows, also where the page shows only
// some. The server bounds their number. Also copies a text that stands beside a button.
(() => {
  "use strict";
  const ALL_ROWS = { "Telltale-Part": "content", "Telltale-All-Rows": "1" };
  const SAID_MS = 1500;

  // --- the text of a table

  const plain = (element) => {
    const copy = element.cloneNode(true);
    for (const part of copy.querySelectorAll("svg, [aria-hidden=true]")) part.remove();
    for (const time of copy.querySelectorAll("time[datetime]")) time.textContent = time.dateTime;
    return copy.textContent.replace(/\s+/g, " ").trim();
  };
  const text = (cell) => {
    const values = [...cell.querySelectorAll(".value")];
    if (values.length < 2) return plain(cell);
    return values.map(plain).join("; ");
  };

  // The heads of columns, also where they stand in several rows.
  const heads = (table) => {
    const grid = [];
    for (const [y, row] of [...(table.tHead?.rows ?? [])].entries()) {
      grid[y] ??= [];
      let x = 0;
      for (const cell of row.cells) {
        while (grid[y][x] !== undefined) x += 1;
        for (let down = 0; down < cell.rowSpan; down++) {
          grid[y + down] ??= [];
          for (let right = 0; right < cell.colSpan; right++) grid[y + down][x + right] = text(cell);
        }
      }
    }
    const width = Math.max(0, ...grid.map((row) => row.length));
    return Array.from({ length: width }, (_, x) => [...new Set(grid.map((row) => row[x] ?? ""))].filter(Boolean).join(" / "));
  };

  const read = (table) => {
    const rows = [...table.rows].filter((row) => row.parentElement !== table.tHead && row.dataset.aside === undefined);
    const cells = rows.map((row) => [...row.cells].filter((cell) => !cell.matches(".pin")));
    const shown = heads(table);
    if (table.querySelector("td.pin")) shown.shift();
    const width = Math.max(shown.length, ...cells.map((row) => row.length));
    const columns = Array.from({ length: width }, (_, x) => shown[x] || `column ${x + 1}`);
    return { columns, rows: cells.map((row) => columns.map((_, x) => (row[x] ? text(row[x]) : ""))) };
  };

  // --- forms of it

  // What a spreadsheet would take for a formula becomes a text. Names and messages come from the vehicle's network.
  const harmless = (cell) => (/^[=+\-@\t\r]/.test(cell) && !/^[+-]?[\d.,]+(e[+-]?\d+)?$/i.test(cell) ? `'${cell}` : cell);
  const quoted = (cell) => `"${harmless(cell).replaceAll('"', '""')}"`;
  const forms = {
    copy: ({ columns, rows }) => [columns, ...rows].map((row) => row.map(harmless).join("\t")).join("\n"),
    // Spreadsheets know UTF-8 by its mark.
    csv: ({ columns, rows }) => `\ufeff${[columns, ...rows].map((row) => row.map(quoted).join(",")).join("\r\n")}\r\n`,
    json: ({ columns, rows }, at) => {
      const named = rows.map((row) => Object.fromEntries(columns.map((column, x) => [column, row[x]])));
      return JSON.stringify({ page: location.pathname + location.search, at, rows: named }, null, 1);
    },
  };
  const types = { csv: "text/csv", json: "application/json" };

  const save = (name, type, content) => {
    const address = URL.createObjectURL(new Blob([content], { type }));
    const link = Object.assign(document.createElement("a"), { href: address, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 0);
  };

  // Without TLS there is no clipboard but the one of a selection.
  const copy = async (content) => {
    if (navigator.clipboard) return navigator.clipboard.writeText(content);
    const field = Object.assign(document.createElement("textarea"), { value: content });
    document.body.append(field);
    field.select();
    const is = document.execCommand("copy");
    field.remove();
    if (!is) throw new Error("not copied");
    return undefined;
  };

  // --- the buttons

  // The tables of a description hold no data.
  const sheets = () => [...document.querySelectorAll("#dev table:not(.described)")];

  // The same table of the same page, with all rows.
  const whole = async (table) => {
    const here = document.getElementById("dev");
    if (!table.closest("section")?.querySelector("[data-go]")) return { table, at: here.dataset.at };
    const answer = await fetch(location.href, { headers: ALL_ROWS, cache: "no-store" });
    if (!answer.ok || answer.redirected) throw new Error(`status ${answer.status}`);
    const template = document.createElement("template");
    template.innerHTML = await answer.text();
    const page = template.content.querySelector("#dev");
    return { table: page.querySelectorAll("table:not(.described)")[sheets().indexOf(table)], at: page.dataset.at };
  };

  const say = (button, word) => {
    const before = button.textContent;
    button.textContent = word;
    setTimeout(() => (button.textContent = before), SAID_MS);
  };

  document.addEventListener("click", async ({ target }) => {
    const button = target.closest?.(".export [data-as]");
    if (!button || button.textContent === button.dataset.done) return;
    const form = button.dataset.as;
    const shown = button.parentElement.nextElementSibling;
    try {
      const { table, at } = await whole(shown);
      const content = forms[form](read(table), at);
      if (form === "copy") {
        await copy(content);
        say(button, button.dataset.done);
      } else {
        const page = location.pathname.split("/").filter(Boolean).join("-");
        save(`telltale-${page}-${shown.id || "table"}-${at.replaceAll(":", "")}.${form}`, types[form], content);
      }
    } catch {
      say(button, button.dataset.failed ?? "!");
    }
  });

  // A text beside a button.
  document.addEventListener("click", async ({ target }) => {
    const button = target.closest?.("[data-copy]");
    if (!button || button.textContent === button.dataset.done) return;
    try {
      await copy(button.closest("[data-aside]").querySelector(button.dataset.copy).textContent);
      say(button, button.dataset.done);
    } catch {
      say(button, button.dataset.failed);
    }
  });

  const place = () => {
    const buttons = document.getElementById("export");
    for (const table of sheets()) {
      if (!table.previousElementSibling?.matches(".export")) table.before(buttons.content.cloneNode(true));
    }
    for (const row of document.querySelectorAll("#dev .export")) {
      if (!row.nextElementSibling?.matches("table")) row.remove();
    }
  };
  addEventListener("telltale:shown", place);
  place();
})();
