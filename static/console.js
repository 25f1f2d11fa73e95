// The console's overview: asks for the fragment once a second and puts it in place. No row moves while a pointer or a
// finger is on the list, and the page says when the console does not answer.
(() => {
  "use strict";
  const EVERY_MS = 1000;
  const ANSWER_MS = 3000;
  // A finger that was lifted may come down again at the same place.
  const FINGER_MS = 1500;

  const body = document.body;
  const part = () => document.getElementById("fleet");
  const list = () => document.getElementById("vehicles");
  let fingerAt = -Infinity;
  let fingers = false;

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
    const rows = new Map([...fresh.querySelectorAll("#vehicles > li")].map((row) => [row.id, row]));
    const target = fresh.querySelector("#vehicles");
    const known = [...list().children].map((row) => rows.get(row.id)).filter(Boolean);
    target.prepend(...known);
  };

  const renew = async () => {
    const answer = await fetch("/overview", { cache: "no-store", signal: AbortSignal.timeout(ANSWER_MS) });
    if (answer.status === 401) return void location.assign("/login");
    if (!answer.ok) throw new Error(`status ${answer.status}`);
    const template = document.createElement("template");
    template.innerHTML = await answer.text();
    const fresh = template.content.getElementById("fleet");
    if (!fresh) throw new Error("no part of this page");
    if (fresh.dataset.frame !== part().dataset.frame) return void location.reload();
    if (isTouched()) keepOrder(fresh);
    Idiomorph.morph(part(), fresh, { morphStyle: "outerHTML" });
  };

  const go = async () => {
    try {
      await renew();
      delete body.dataset.dead;
    } catch {
      body.dataset.dead = "";
    }
    setTimeout(go, EVERY_MS);
  };
  setTimeout(go, EVERY_MS);
})();
