// The times of a page that stands still, by the clock of the browser.
(() => {
  "use strict";
  const { lang } = document.documentElement;
  const DAY = { weekday: "short", day: "numeric", month: "short", year: "numeric" };
  const date = (at) => new Date(at).toLocaleDateString(lang, DAY);
  const clock = (at) => new Date(at).toTimeString().slice(0, 8);
  const exact = (at) => `${clock(at)}.${String(new Date(at).getMilliseconds()).padStart(3, "0")}`;
  globalThis.LocalTimes = { date, clock };

  for (const text of document.querySelectorAll("[data-clock]")) text.textContent = clock(text.dataset.clock);
  for (const text of document.querySelectorAll("[data-date]")) text.textContent = date(Number(text.dataset.date));
  for (const time of document.querySelectorAll("time[data-exact]")) {
    const { dateTime, dataset } = time;
    time.textContent = dataset.exact === "date" ? `${date(dateTime)} ${exact(dateTime)}` : exact(dateTime);
  }
  // The day of what the page shows, in its title.
  const { from } = document.body.dataset;
  document.title = document.title.replace(/ - Telltale$/, `, ${date(Number(from))} - Telltale`);
})();
