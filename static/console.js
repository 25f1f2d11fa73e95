// The console's pages: ask for the part that changes once a second and put it in place, and for a vehicle's log when
// there is more of it. No row moves while a pointer or a finger is on the list, and the page says when the console does
// not answer.
(() => {
  "use strict";
  const EVERY_MS = 1000;
  const ANSWER_MS = 3000;
  // The log is read from the hub, which takes longer, and no more often than this.
  const LOG_EVERY_MS = 5000;
  const LOG_ANSWER_MS = 10000;
  // A finger that was lifted may come down again at the same place.
  const FINGER_MS = 1500;

  const body = document.body;
  const { lang } = document.documentElement;
  const locale = lang === "en" ? "en-GB" : lang;
  const part = () => document.querySelector("[data-part]");
  const log = () => document.querySelector("[data-log]");
  const list = () => document.getElementById("vehicles") ?? document.createElement("ol");
  let fingerAt = -Infinity;
  let fingers = false;
  let logAt = 0;

  const isTouched = () =>
    list().matches(":hover") || list().contains(document.activeElement) || fingers || performance.now() - fingerAt < FINGER_MS;

  document.addEventListener("touchstart", (event) => (fingers = list().contains(event.target)), { passive: true });
  for (const end of ["touchend", "touchcancel"]) {
    document.addEventListener(end, (event) => {
      if (fingers) fingerAt = performance.now();
      fingers = event.touches.length > 0 && fingers;
    });
  }

  // Gives the new rows the order of those that are shown; new ones come last.
  const keepOrder = (fresh) => {
    const rows = new Map([...fresh.querySelectorAll("#vehicles > li, #folded li")].map((row) => [row.id, row]));
    const target = fresh.querySelector("#vehicles");
    const known = [...list().children].map((row) => rows.get(row.id)).filter(Boolean);
    target.prepend(...known);
  };

  // By the clock of the browser.
  const showTimes = (root) => {
    for (const time of root.querySelectorAll("time[datetime]")) {
      time.textContent = new Date(time.dateTime).toLocaleString(locale, { dateStyle: "medium", timeStyle: "medium" });
    }
  };

  const ask = async (address, id, answerMs) => {
    const answer = await fetch(address, { cache: "no-store", signal: AbortSignal.timeout(answerMs) });
    if (answer.status === 401) {
      location.assign("/login");
      return null;
    }
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    const template = document.createElement("template");
    template.innerHTML = await answer.text();
    const fresh = template.content.getElementById(id);
    if (!fresh) throw new Error("no part of this page");
    showTimes(fresh);
    return fresh;
  };

  const renew = async () => {
    const fresh = await ask(part().dataset.part, part().id, ANSWER_MS);
    if (!fresh) return;
    if (fresh.dataset.frame !== part().dataset.frame) return void location.reload();
    if (isTouched()) keepOrder(fresh);
    for (const details of fresh.querySelectorAll("details")) details.open = !!document.getElementById(details.id)?.open;
    Idiomorph.morph(part(), fresh, { morphStyle: "outerHTML" });
  };

  const renewLog = async () => {
    const isDue = log() && log().dataset.noted !== part().dataset.noted && performance.now() - logAt >= LOG_EVERY_MS;
    if (!isDue) return;
    logAt = performance.now();
    // Without it the page still says how old the rest is.
    const fresh = await ask(log().dataset.log, log().id, LOG_ANSWER_MS).catch(() => null);
    if (fresh) Idiomorph.morph(log(), fresh, { morphStyle: "outerHTML" });
  };

  const go = async () => {
    // A part that is over does not change any more.
    if (!part()) return;
    try {
      await renew();
      delete body.dataset.dead;
      renewLog();
    } catch {
      body.dataset.dead = "";
    }
    setTimeout(go, EVERY_MS);
  };
  showTimes(document);
  // The past does not change.
  if (part()) setTimeout(go, EVERY_MS);
})();
