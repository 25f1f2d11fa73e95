// Sounds for a take-over, a fault, a dead display, and before the vehicle moves. Each new alarm calls once; one
// sound repeats for all that nobody has acknowledged. Masked modules, alarms that move to their cause and further
// alarms of a component at the same time do not call. The tones are computed, so no file is needed.
(() => {
  "use strict";
  const HEARD = "telltale.heard";
  const LOOK_MS = 100;
  const REPEAT_MS = 5000;
  const APART_S = 1.4;
  const RATE_HZ = 16000;
  // Without a look for this long the scripts hang, and the display is dead. It is put off more often than that.
  const HANGS_S = 2.5;
  const PUT_OFF_MS = 500;
  // A click comes so long after the finger is lifted, at the latest.
  const TAPPED_MS = 400;

  // The tones of each pattern: when they begin in seconds, their pitch in Hz, and how long they last.
  const PATTERNS = {
    // Quick and high, three and two.
    take_over: [0, 0.17, 0.34, 0.65, 0.82].map((start) => [start, 1175, 0.13]),
    // Two falling tones.
    fault: [[0, 880, 0.28], [0.32, 660, 0.28]],
    // Low and long, to and fro.
    dead: [[0, 330, 0.6], [0.6, 247, 0.6], [1.2, 330, 0.6]],
    // Rising, unlike any fault: the vehicle is about to move.
    departure: [[0, 523, 0.28], [0.28, 659, 0.28], [0.56, 784, 0.28]],
  };
  const RANKS = ["", "fault", "take_over", "dead"];

  const body = document.body;
  const tool = document.querySelector("[data-tool=sound]");
  const silence = new URL("silence.wav", document.currentScript.src);
  // Created when sound is permitted: before, the browser would log a warning.
  let context = null;
  const buffers = {};
  // A user who only looks on hears nothing unless they want to.
  let wanted = body.dataset.role === "operator";
  let playsUntil = 0;
  let playedAt = -Infinity;
  // The pattern that has to sound since the last look.
  let sounding = "";
  // The tone of a dead display, started ahead of time and put off again and again.
  let deadTone = null;
  let putOffAt = -Infinity;

  const isOn = () => wanted && context?.state === "running";

  // The button changes its width, and must not move what a finger is on.
  let isPressed = false;
  const mark = () => {
    if (isPressed) return;
    tool.dataset.sound = isOn() ? "on" : "off";
  };
  addEventListener("pointerdown", () => (isPressed = true), true);
  for (const end of ["pointerup", "pointercancel"]) {
    addEventListener(end, () => {
      isPressed = false;
      // What is tapped hears of it first.
      setTimeout(mark, TAPPED_MS);
    }, true);
  }

  const count = (what) => {
    body.dataset[what] = Number(body.dataset[what] ?? 0) + 1;
  };

  // Fills as many seconds as pass from one repetition to the next.
  const computed = (tones) => {
    const buffer = context.createBuffer(1, (REPEAT_MS / 1000) * RATE_HZ, RATE_HZ);
    const samples = buffer.getChannelData(0);
    for (const [start, hertz, lasts] of tones) {
      for (let index = 0; index < lasts * RATE_HZ; index += 1) {
        const at = index / RATE_HZ;
        const level = 0.5 * Math.min(1, at / 0.02, (lasts - at) / 0.03);
        const phase = 2 * Math.PI * hertz * at;
        samples[Math.round(start * RATE_HZ) + index] = level * (Math.sin(phase) + Math.sin(3 * phase) / 4);
      }
    }
    return buffer;
  };

  const begin = (pattern, at, loop) => {
    const source = context.createBufferSource();
    source.buffer = buffers[pattern] ??= computed(PATTERNS[pattern]);
    source.loop = loop;
    source.connect(context.destination);
    source.start(at);
    return source;
  };

  const play = (pattern) => {
    const start = Math.max(context.currentTime, playsUntil);
    begin(pattern, start, false);
    playsUntil = start + APART_S;
    playedAt = performance.now() + (start - context.currentTime) * 1000;
    body.dataset.tones = pattern;
  };

  // One call plays and one waits; further ones share these.
  const call = () => {
    if (playsUntil - context.currentTime <= APART_S) play(sounding);
    count("sounded");
  };

  const departure = () => {
    if (!isOn()) return;
    play("departure");
    count("departures");
  };

  // --- what has to sound

  const heard = () => Number(sessionStorage.getItem(HEARD) ?? 0);

  const causes = () => document.getElementById("causes")?.dataset;

  // The numbers of the alarms that nobody has acknowledged.
  const openAlarms = () => (causes()?.alarms ?? "").split(" ").filter(Boolean).map(Number);

  // How many of them did not call yet. Numbers only grow; smaller ones come from a server that started anew.
  const takeFresh = (open) => {
    const raised = Number(causes()?.lastAlarm ?? 0);
    const last = raised < heard() ? 0 : heard();
    if (raised !== heard()) sessionStorage.setItem(HEARD, String(raised));
    return open.filter((number) => number > last).length;
  };

  const due = (open) => {
    const { live } = body.dataset;
    if (live === "dead") return "dead";
    if (live === "replay") return "";
    // What is asked calls when it rises, even if all alarms are acknowledged.
    const { urgency } = document.getElementById("instruction")?.dataset ?? {};
    if (urgency === "take_over") return "take_over";
    return open.length > 0 || urgency === "be_ready" ? "fault" : "";
  };

  const silenceDeadTone = () => {
    deadTone?.stop();
    deadTone = null;
  };

  const beginDeadTone = (after_s) => {
    silenceDeadTone();
    deadTone = begin("dead", context.currentTime + after_s, true);
  };

  // The audio goes on while scripts hang, so the tone of a dead display begins unless it is put off. A browser may
  // slow a page down that is out of sight.
  const putOffDeadTone = (now) => {
    putOffAt = now;
    if (document.hidden) silenceDeadTone();
    else beginDeadTone(HANGS_S);
  };

  const lookWhileDead = (now, isNew) => {
    if (isNew) beginDeadTone(0);
    else if (now - playedAt >= REPEAT_MS) count("repeats");
    else return;
    playedAt = now;
    body.dataset.tones = "dead";
  };

  const look = () => {
    if (!isOn()) {
      silenceDeadTone();
      // Once the sound is on, it begins anew.
      sounding = "";
      return undefined;
    }
    const now = performance.now();
    const open = openAlarms();
    const before = sounding;
    sounding = due(open);
    const isWorse = RANKS.indexOf(sounding) > RANKS.indexOf(before);
    if (sounding === "dead") return lookWhileDead(now, isWorse);
    if (before === "dead" || now - putOffAt >= PUT_OFF_MS) putOffDeadTone(now);
    if (sounding === "") return undefined;
    const fresh = takeFresh(open);
    for (let made = 0; made < fresh; made += 1) call();
    if (fresh > 0) return undefined;
    if (isWorse) return play(sounding);
    if (open.length > 0 && now - playedAt >= REPEAT_MS) {
      play(sounding);
      count("repeats");
    }
    return undefined;
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
  document.addEventListener("telltale:departure", departure);
  mark();
  // A login by touch permits sound on the page it leads to, and a kiosk may permit it always:
  // silence that is permitted tells.
  const ready = navigator.userActivation?.hasBeenActive ? Promise.resolve() : new Audio(silence).play();
  ready.then(unlock, mark).finally(() => setInterval(look, LOOK_MS));
})();
