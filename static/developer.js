// Renews the developer's page every second, and says when it is old.
(() => {
  "use strict";
  const EVERY_MS = 1000;
  const LATE_MS = 3000;
  let last = performance.now();

  const localTimes = () => {
    for (const time of document.querySelectorAll("time.clock")) {
      const text = new Date(time.dateTime).toTimeString().slice(0, 8);
      if (time.textContent !== text) time.textContent = text;
    }
  };

  const renew = async () => {
    // The server tells by the header that nobody did anything: an open page keeps no session alive.
    const headers = { "Telltale-Renewal": "1" };
    const answer = await fetch(location.href, { headers, cache: "no-store", signal: AbortSignal.timeout(LATE_MS) });
    if (answer.redirected) return location.assign(answer.url);
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    await htmx.swap({
      sourceElement: document.body,
      target: "#dev",
      select: "#dev",
      swap: "outerMorph",
      text: await answer.text(),
    });
    localTimes();
    last = performance.now();
  };

  const loop = async () => {
    // A failure shows as the page's age.
    await renew().catch(() => {});
    document.body.dataset.live = performance.now() - last > LATE_MS ? "dead" : "live";
    setTimeout(loop, EVERY_MS);
  };

  localTimes();
  setTimeout(loop, EVERY_MS);
})();
