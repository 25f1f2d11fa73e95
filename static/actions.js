// Sends the operator's taps: each is one POST with the version of the state it was shown with, sent at once
// or not at all, and none while the display is not live. A stop is different: it is sent in every state of the
// display, over HTTP and over the socket, until it is answered. A mark in the recording is sent in every state, once.
(() => {
  "use strict";
  const ANSWER_MS = 2000;
  // A second tap on the same place, and a tap on a button that has just appeared there.
  const AFTER_ACTION_MS = 800;
  const AFTER_CHANGE_MS = 400;
  const NOTICE_MS = 12000;
  const MISSED_MS = 3000;
  const REFUSED_MS = 6000;
  const STOP_AGAIN_MS = 500;
  // A stop without an answer for so long has not arrived.
  const STOP_MISSED_MS = 1000;
  // A browser has few connections to one server, and a stop needs one.
  const SENT_MAX = 3;
  const MARKED_MS = 3000;

  const body = document.body;
  const bar = document.getElementById("actions");
  const confirmation = document.getElementById("confirm");
  const notice = document.getElementById("notice");

  // The addresses with an unanswered request.
  const sent = new Set();
  let quietTimer = 0;
  let quietUntil = 0;
  let quietWhy = "";
  // The address that the notice is about.
  let noticeOf = "";
  let noticeTimer = 0;
  let refusedTimer = 0;
  // When the last stop was answered.
  let arrivedAt = 0;

  // The stylesheet lets no tap through meanwhile, except for a stop.
  const quiet = (ms, why) => {
    if (why === "second" || performance.now() >= quietUntil) quietWhy = why;
    quietUntil = Math.max(quietUntil, performance.now() + ms);
    bar.dataset.quiet = "";
    clearTimeout(quietTimer);
    quietTimer = setTimeout(() => delete bar.dataset.quiet, quietUntil - performance.now());
  };

  // --- why a tap was not done

  const hideNotice = () => {
    notice.hidden = true;
    clearTimeout(noticeTimer);
  };

  const show = (kind, of, reasons = []) => {
    notice.dataset.kind = kind;
    noticeOf = of;
    notice.querySelector("ul").replaceChildren(
      ...reasons.map((reason) => {
        const item = document.createElement("li");
        item.textContent = reason;
        return item;
      }),
    );
    notice.hidden = false;
    clearTimeout(noticeTimer);
    noticeTimer = setTimeout(hideNotice, kind === "second" || kind === "changed" ? MISSED_MS : NOTICE_MS);
  };

  // A tap that the stylesheet blocks says so: nobody waits for something that was never sent.
  const isOver = (button, { clientX: x, clientY: y }) => {
    const box = button.getBoundingClientRect();
    return x >= box.left && x <= box.right && y >= box.top && y <= box.bottom;
  };
  const showMissed = (area, buttons, why) => {
    area.addEventListener("click", (event) => {
      if (!("quiet" in area.dataset) || event.target.closest("button, .confirm")) return;
      if ([...area.querySelectorAll(buttons)].some((button) => isOver(button, event))) show(why(), "");
    });
  };

  // The bar lists the reasons against the step: it flashes, and opens the list if it does not fit.
  const showChecks = () => {
    hideNotice();
    bar.dataset.refused = "";
    clearTimeout(refusedTimer);
    refusedTimer = setTimeout(() => delete bar.dataset.refused, REFUSED_MS);
    if (bar.querySelector("[name=checks]:not([hidden])")) document.getElementById("sheet-checks").showPopover();
  };

  // --- the second step of a clearance or a release

  let first = "";
  let confirmedVersion = null;
  let until = 0;
  let countdown = 0;

  // The version of the button of the first step; none if it is not offered any more.
  const version = () => document.querySelector(`#step form[data-act="${first}"] [name=version]`)?.value;

  // The focus goes back to where it came from, if that is still offered.
  const closeConfirmation = () => {
    const hadFocus = confirmation.contains(document.activeElement);
    confirmation.hidden = true;
    confirmation.elements.token.value = "";
    delete bar.dataset.confirming;
    clearInterval(countdown);
    if (hadFocus) document.querySelector(`#step form[data-act="${first}"] button`)?.focus({ preventScroll: true });
  };

  const count = () => {
    const left_s = Math.ceil((until - performance.now()) / 1000);
    confirmation.querySelector(".left").textContent = Math.max(0, left_s);
    if (left_s <= 0) closeConfirmation();
  };

  const askForConfirmation = (act, { token, expires_s }, asked) => {
    first = act;
    confirmedVersion = asked;
    confirmation.action = `/vehicle/${act}/confirm`;
    until = performance.now() + expires_s * 1000;
    confirmation.elements.token.value = token;
    confirmation.hidden = false;
    bar.dataset.confirming = "";
    clearInterval(countdown);
    countdown = setInterval(count, 100);
    count();
    // On the question, not on its button: the key that asked must not answer as well.
    confirmation.querySelector(".next").focus({ preventScroll: true });
  };

  // An open panel takes the key first.
  document.addEventListener("keydown", (event) => {
    if (event.key !== "Escape" || document.querySelector(":popover-open")) return;
    if (confirmation.hidden) hideNotice();
    else closeConfirmation();
  });

  // A key that is held is one press.
  document.addEventListener("keydown", (event) => {
    if (event.repeat && event.key === "Enter" && event.target.closest?.("form[data-act]")) event.preventDefault();
  });

  // --- sending

  // Taps that wait for an answer over the socket, by their names.
  const pendingTaps = new Map();

  // Without it nothing is sent, and the page covers itself.
  const { live } = globalThis.telltale ?? {};
  live?.listen(({ hand_over: words, elsewhere, tap, status, said }) => {
    if (words !== undefined) showHandOver(words);
    else if (elsewhere !== undefined) show("elsewhere", "elsewhere", [elsewhere]);
    else if (tap !== undefined) pendingTaps.get(tap)?.({ status, said });
  });

  // Another operator takes over a driving vehicle.
  const showHandOver = (words) => {
    if (words) show("handover", "hand-over", [words]);
    else if (noticeOf === "hand-over") hideNotice();
  };

  const bySocket = (fields) =>
    new Promise((resolve, reject) => {
      const socket = live?.socket;
      if (socket?.readyState !== WebSocket.OPEN) return reject(new Error("no socket is open"));
      const tap = fields.get("tap");
      pendingTaps.set(tap, resolve);
      // The next attempt of the same tap waits for its own time.
      const giveUp = () => {
        if (pendingTaps.get(tap) === resolve) pendingTaps.delete(tap);
        reject(new Error("no answer in time"));
      };
      setTimeout(giveUp, ANSWER_MS);
      return socket.send(JSON.stringify({ stop: { tap } }));
    });

  const byPost = async (address, fields, priority) => {
    const answer = await fetch(address, {
      method: "POST",
      body: fields,
      headers: { Accept: "application/json" },
      redirect: "manual",
      cache: "no-store",
      priority,
      signal: AbortSignal.timeout(ANSWER_MS),
    });
    if (answer.type === "opaqueredirect") return { status: 401 };
    return { status: answer.status, said: await answer.json() };
  };

  // What became of the last tap on STOP: its button shows it at once, in every state of the display.
  const showStop = (became) => {
    if (became) body.dataset.stop = became;
    else delete body.dataset.stop;
  };

  const stopMissed = (address) => {
    showStop("missed");
    show("stop", address);
  };

  // The page shows that the stop is requested as soon as the next state comes. It may be over by then.
  const stopArrived = () => {
    showStop(bar.querySelector("[name=stop]")?.ariaPressed === "false" ? "sent" : "");
    arrivedAt = performance.now();
  };

  // If no other connection is possible, the open socket takes the stop. The server does it once, and gives
  // every attempt the same answer.
  const stopUntilAnswered = async (address, fields) => {
    fields.set("tap", `${Date.now()}-${Math.random()}`);
    showStop("sending");
    const late = setTimeout(() => stopMissed(address), STOP_MISSED_MS);
    try {
      return await stopAgainAndAgain(address, fields);
    } finally {
      clearTimeout(late);
      showStop("");
    }
  };

  const stopAgainAndAgain = async (address, fields) => {
    for (;;) {
      try {
        const answer = await Promise.any([byPost(address, fields, "high"), bySocket(fields)]);
        if (answer.status !== 408 && answer.status !== 429) return answer;
      } catch {
        // Nothing arrived, or no answer came back.
      }
      stopMissed(address);
      await new Promise((resolve) => setTimeout(resolve, STOP_AGAIN_MS));
    }
  };

  let markedTimer = 0;

  // The button shows a tick, and a screen reader hears it.
  const showMarked = (form) => {
    form.dataset.marked = "";
    clearTimeout(markedTimer);
    markedTimer = setTimeout(() => delete form.dataset.marked, MARKED_MS);
  };

  const send = async (form, button) => {
    const { act } = form.dataset;
    const address = form.action;
    const fields = new URLSearchParams(new FormData(form, button));
    if (act !== "stop") fields.set("beat", live.beatAt);
    const sending = act === "stop" ? stopUntilAnswered(address, fields) : byPost(address, fields, "auto");
    const { status, said } = await sending;
    if (status === 401) return Live.toLogin();
    if (status === 200) {
      if (noticeOf === address) hideNotice();
      if (act === "stop") stopArrived();
      if (act === "mark") return showMarked(form);
      if (bar.contains(form)) quiet(AFTER_ACTION_MS, "second");
      if (act === "clearance" || act === "release") askForConfirmation(act, said, fields.get("version"));
      else closeConfirmation();
      if (act === "localize") document.getElementById("sheet-stops").hidePopover();
      if (act === "logout" || act === "shutdown") Live.toLogin();
      return undefined;
    }
    if (act === "confirm") closeConfirmation();
    if (act === "clearance" && bar.querySelector(".step .checks li:not(.holds)")) showChecks();
    // The stop is requested all the same.
    else if (act === "stop" && said.error) show("error", address, [said.error]);
    else show("refused", address, said.refused ?? [said.error]);
    // The page showed an old state: everything is requested again.
    if ("seq" in said) document.dispatchEvent(new CustomEvent("telltale:refresh"));
    return undefined;
  };

  document.addEventListener("submit", async (event) => {
    const form = event.target.closest("form[data-act]");
    if (!form) return;
    event.preventDefault();
    const address = form.action;
    // The stylesheet lets no finger through; this lets no key through.
    if (form.dataset.act !== "stop" && event.submitter?.closest("#step, #confirm, aside")?.closest("[data-quiet]")) {
      return show(bar.contains(form) ? quietWhy : "changed", "");
    }
    // A stop waits for nothing. Further taps on it are the same stop, as long as it is not answered.
    if (form.dataset.act === "stop") {
      if (sent.has(address)) return undefined;
    } else if (!live?.isLive && form.dataset.act !== "mark") {
      return show("unsent", address);
    } else if (sent.has(address) || sent.size >= SENT_MAX) {
      return show("waiting", address);
    }
    if (form === confirmation) document.dispatchEvent(new CustomEvent("telltale:departure"));
    sent.add(address);
    form.dataset.sending = "";
    body.dataset.unanswered = "";
    try {
      await send(form, event.submitter);
    } catch {
      show(form.dataset.act === "mark" ? "unmarked" : "unanswered", address);
    } finally {
      sent.delete(address);
      delete form.dataset.sending;
      if (sent.size === 0) delete body.dataset.unanswered;
    }
  });

  // A tap on this button must not count as a tap beside an open panel, which would close it.
  const dismiss = notice.querySelector("[name=dismiss]");
  const keepOpen = () => {
    dismiss.popoverTargetElement = document.querySelector(".panel:popover-open");
    dismiss.popoverTargetAction = "show";
  };
  document.addEventListener("toggle", keepOpen, { capture: true });

  confirmation.elements.cancel.addEventListener("click", closeConfirmation);
  dismiss.addEventListener("click", (event) => {
    event.preventDefault();
    hideNotice();
  });

  // --- the bar changes under the finger

  const list = document.querySelector("aside");
  const offeredIn = (forms) => [...document.querySelectorAll(`${forms} form button`)].map((it) => `${it.name} ${it.value}`).join();
  const offered = () => offeredIn("#step");
  let before = offered();
  let listed = offeredIn("#causes");
  let listTimer = 0;

  // A button that just got another alarm takes no tap that was aimed at the previous one.
  const settle = () => {
    const now = offeredIn("#causes");
    if (now === listed) return;
    listed = now;
    list.dataset.quiet = "";
    clearTimeout(listTimer);
    listTimer = setTimeout(() => delete list.dataset.quiet, AFTER_CHANGE_MS);
  };

  // The effect of the first of two taps may be visible before it is answered.
  showMissed(bar, "#step button", () => (sent.size > 0 ? "second" : quietWhy));
  showMissed(list, "form button", () => "changed");

  document.addEventListener("htmx:after:swap", () => {
    const now = offered();
    if (now !== before) quiet(AFTER_CHANGE_MS, "changed");
    before = now;
    settle();
    const isShown = bar.querySelector("[name=stop]")?.ariaPressed !== "false";
    if (body.dataset.stop === "sent" && (isShown || performance.now() - arrivedAt > STOP_MISSED_MS)) showStop("");
    // It is no longer offered, for example when the vehicle drives off.
    if (!document.getElementById("shutdown")) document.getElementById("sheet-shutdown").hidePopover();
    // The reasons against it are gone.
    if (!bar.querySelector(".step .checks li:not(.holds)")) delete bar.dataset.refused;
    // The server would refuse it: it was offered for another state.
    if (!confirmation.hidden && version() !== confirmedVersion) closeConfirmation();
  });

  addEventListener("telltale:dead", closeConfirmation);
})();
