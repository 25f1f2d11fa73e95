// Sounds before the vehicle moves, and once for each new alarm. Masked modules, alarms that move to their cause
// and further alarms of a component at the same time do not sound. The tones are generated, so no file is needed.
(() => {
  "use strict";
  const HEARD = "telltale.heard";
  const APART_S = 1.2;
  const AT_ONCE_MAX = 3;

  const body = document.body;
  const tool = document.querySelector("[data-tool=sound]");
  const silence = new URL("silence.wav", document.currentScript.src);
  // Created when sound is permitted: before, the browser would log a warning.
  let context = null;
  // A user who only looks on hears nothing unless they want to.
  let wanted = body.dataset.role === "operator";
  let playsUntil = 0;

  const isOn = () => wanted && context?.state === "running";

  const mark = () => {
    tool.dataset.sound = isOn() ? "on" : "off";
  };

  const beep = (start, hertz) => {
    const tone = context.createOscillator();
    const level = context.createGain();
    tone.type = "triangle";
    tone.frequency.value = hertz;
    level.gain.setValueAtTime(0, start);
    level.gain.linearRampToValueAtTime(0.5, start + 0.02);
    level.gain.setValueAtTime(0.5, start + 0.2);
    level.gain.linearRampToValueAtTime(0, start + 0.28);
    tone.connect(level).connect(context.destination);
    tone.start(start);
    tone.stop(start + 0.3);
  };

  const sound = () => {
    const start = Math.max(context.currentTime, playsUntil);
    if (start - context.currentTime > APART_S * (AT_ONCE_MAX - 1)) return;
    beep(start, 880);
    beep(start + 0.32, 660);
    playsUntil = start + APART_S;
    body.dataset.sounded = Number(body.dataset.sounded ?? 0) + 1;
  };

  // The vehicle is about to move: rising tones, unlike a fault.
  const departure = () => {
    if (!isOn()) return;
    const start = Math.max(context.currentTime, playsUntil);
    [523, 659, 784].forEach((hertz, index) => beep(start + 0.28 * index, hertz));
    playsUntil = start + APART_S;
    body.dataset.departures = Number(body.dataset.departures ?? 0) + 1;
  };

  const heard = () => Number(sessionStorage.getItem(HEARD) ?? 0);

  const listen = () => {
    const causes = document.getElementById("causes");
    if (!causes) return;
    const numbers = causes.dataset.alarms.split(" ").filter(Boolean).map(Number);
    // Numbers only grow; smaller ones come from a server that started anew.
    const raised = Number(causes.dataset.lastAlarm);
    const last = raised < heard() ? 0 : heard();
    const fresh = numbers.filter((number) => number > last);
    sessionStorage.setItem(HEARD, String(raised));
    if (isOn()) for (const _ of fresh) sound();
  };

  const unlock = () => {
    if (!wanted) return;
    if (context === null) {
      context = new AudioContext();
      context.addEventListener("statechange", mark);
    }
    if (context.state === "suspended") context.resume().then(mark, mark);
    mark();
  };

  for (const touch of ["pointerdown", "keydown"]) document.addEventListener(touch, unlock, { capture: true });
  tool.addEventListener("click", () => {
    wanted = !isOn();
    unlock();
    mark();
  });
  document.addEventListener("htmx:after:swap", listen);
  document.addEventListener("telltale:departure", departure);
  mark();
  // A login by touch permits sound on the page it leads to, and a kiosk may permit it always:
  // silence that is permitted tells.
  const ready = navigator.userActivation?.hasBeenActive ? Promise.resolve() : new Audio(silence).play();
  ready.then(unlock, mark).finally(listen);
})();
