// The page of a replay: moves through the recording, and shows where it is. The screens in the frame follow by
// themselves.
(() => {
  "use strict";
  const ASK_MS = 250;
  const ANSWER_MS = 3000;
  // Between two changes of the address: browsers allow only some.
  const KEEP_MS = 100;
  const KEEP_PLAYING_MS = 1000;
  // The reference display; the stylesheet has the same.
  const WHOLE = { width: 1280, height: 800 };

  const { body } = document;
  const address = `/replay/${body.dataset.replay}/state`;
  const [from, to] = [Number(body.dataset.from), Number(body.dataset.to)];
  const slider = document.querySelector("input[name=at]");
  const speed = document.querySelector("select[name=speed]");
  const clock = document.getElementById("replay-clock");
  const date = document.getElementById("replay-date");
  const after = document.getElementById("replay-after");
  const moment = document.getElementById("moment");
  const differs = document.getElementById("differs");
  // The replay of the same incident by the other configuration.
  const other = document.getElementById("other");
  const lost = document.getElementById("lost");
  const lanes = document.querySelector(".lanes");
  const two = (number) => String(number).padStart(2, "0");

  // The moment with which the shown one is compared.
  let remembered = null;
  let isMoved = false;

  for (const link of document.querySelectorAll(".lanes a")) link.target = "screen";

  // A line in each strip, at the instant that is shown.
  const cursors = [...document.querySelectorAll(".lane svg")].map((strip) => {
    const line = document.createElementNS("http://www.w3.org/2000/svg", "line");
    line.setAttribute("class", "cursor");
    line.setAttribute("y1", "0");
    line.setAttribute("y2", "24");
    return strip.appendChild(line);
  });

  const timeOf = (ms) => `${LocalTimes.clock(ms)}.${Math.floor(new Date(ms).getMilliseconds() / 100)}`;

  // The screen in the frame, behind the address of the replay; `/` is the operator's.
  const stage = document.querySelector(".stage");
  const screen = stage.querySelector("iframe");
  // `null` for what the browser shows instead, as where no page came.
  const placeShown = () => {
    try {
      const { pathname, search } = screen.contentWindow.location;
      return { pathname, search };
    } catch {
      return null;
    }
  };
  const screenShown = () => {
    const place = placeShown();
    const behind = place?.pathname.split("/screen")[1];
    return behind === undefined ? null : behind + place.search;
  };

  // The address of what is shown: a reload, a link and a copy lead to this moment and this screen.
  let shownAt = Number(body.dataset.at);
  let screenAt = new URL(screen.src).pathname.split("/screen")[1] + new URL(screen.src).search;
  const addressOf = (at, shown) => {
    const asked = new URLSearchParams({ at: Math.round(at), ...(shown !== "/" && { screen: shown }) });
    return `/replay/${body.dataset.replay}?${asked}`;
  };
  let keptAt = 0;
  let kept = addressOf(shownAt, screenAt);
  const keep = () => {
    screenAt = screenShown() ?? screenAt;
    const address = addressOf(shownAt, screenAt);
    moment.href = address;
    const apart = "playing" in body.dataset ? KEEP_PLAYING_MS : KEEP_MS;
    if (address === kept || performance.now() - keptAt < apart) return;
    history.replaceState(null, "", address);
    [kept, keptAt] = [address, performance.now()];
  };

  const show = (at) => {
    shownAt = at;
    clock.textContent = timeOf(at);
    clock.dateTime = new Date(at).toISOString();
    date.textContent = LocalTimes.date(at);
    const s = (at - from) / 1000;
    after.textContent = `+${two(Math.floor(s / 60))}:${two(Math.floor(s % 60))}.${Math.floor((s * 10) % 10)}`;
    moment.href = addressOf(at, screenAt);
    if (other) other.href = `/replay/${other.dataset.replay}?at=${Math.round(at)}`;
    slider.setAttribute("aria-valuetext", clock.textContent);
    if (remembered !== null) differs.href = `/replay/${body.dataset.replay}/differences?a=${remembered}&b=${Math.round(at)}`;
    if (!lanes) return;
    const { start, end } = lanes.dataset;
    const x = `${(100 * (at - start)) / (end - start)}%`;
    for (const line of cursors) {
      line.setAttribute("x1", x);
      line.setAttribute("x2", x);
    }
  };

  const take = (state) => {
    body.toggleAttribute("data-playing", state.playing);
    body.toggleAttribute("data-differing", state.may_differ);
    if (isMoved) return;
    slider.value = state.at_ms;
    show(state.at_ms);
    keep();
  };

  // One request at a time: an order that is given before the last one's answer waits for it.
  const WAITING = 8;
  const orders = [];
  let isAsking = false;
  const send = async (order) => {
    const options = order ? { method: "POST", body: new URLSearchParams(order) } : {};
    const headers = { Accept: "application/json", ...(order ? {} : { "Telltale-Renewal": "1" }) };
    try {
      const answer = await fetch(address, { ...options, headers, cache: "no-store", signal: AbortSignal.timeout(ANSWER_MS) });
      if (answer.status === 404 || answer.status === 401) return void location.reload();
      const state = await answer.json();
      lost.hidden = true;
      // What the next order does is shown already.
      if (orders.length === 0) take(state);
    } catch {
      lost.hidden = false;
    }
  };
  const ask = async (order) => {
    if (order) {
      // Another moment is shown now.
      document.getElementById("beyond")?.remove();
      // The last place, speed and pause count; steps add up, until a place is given.
      const overtaken = (kind) => kind in order ? kind !== "step" : kind === "step" && "at_ms" in order;
      orders.splice(0, orders.length, ...orders.filter((other) => !Object.keys(other).some(overtaken)));
      if (orders.length < WAITING) orders.push(order);
    }
    if (isAsking) return;
    isAsking = true;
    do await send(orders.shift());
    while (orders.length > 0);
    isAsking = false;
  };

  const goTo = (at) => {
    const within = Math.min(to, Math.max(from, Math.round(at)));
    slider.value = within;
    show(within);
    ask({ at_ms: within });
  };

  slider.addEventListener("input", () => {
    isMoved = true;
    goTo(Number(slider.value));
  });
  slider.addEventListener("change", () => {
    isMoved = false;
    goTo(Number(slider.value));
  });

  const play = () => ask({ play: "playing" in body.dataset ? 0 : speed.value });
  // It may have come to its end since the last answer: a speed starts nothing.
  const goAsFast = () => ask({ speed: speed.value });
  document.querySelector("button[name=play]").addEventListener("click", play);
  speed.addEventListener("change", goAsFast);
  for (const name of ["previous", "next"]) {
    document.querySelector(`button[name=${name}]`).addEventListener("click", () => ask({ step: name }));
  }

  const faster = (by) => {
    speed.selectedIndex = Math.min(speed.options.length - 1, Math.max(0, speed.selectedIndex + by));
    goAsFast();
  };
  const KEYS = {
    " ": play,
    ArrowLeft: () => ask({ step: "previous" }),
    ArrowRight: () => ask({ step: "next" }),
    Home: () => goTo(from),
    End: () => goTo(to),
    "+": () => faster(1),
    "-": () => faster(-1),
    "/": () => search(),
  };
  const press = (event) => {
    const isSearch = event.key.toLowerCase() === "k" && (event.ctrlKey || event.metaKey) && !event.altKey && !event.shiftKey;
    if (isSearch) {
      event.preventDefault();
      return void search();
    }
    const does = KEYS[event.key];
    const { target } = event;
    // A focused part has keys of its own: a button is pressed, a slider moves.
    const isTaken = target.closest?.("select, textarea, input:not([type=range])")
      || (event.key === " " && target.closest?.("button, a, summary"))
      || (/^(Arrow|Home|End)/.test(event.key) && target.closest?.("input"));
    if (!does || isTaken || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does();
  };
  document.addEventListener("keydown", press);

  // The operator's screen keeps the size of its display, and is scaled as a whole into the room that is there.
  const fit = () => {
    const { clientWidth, clientHeight } = stage;
    stage.style.setProperty("--fit", Math.min(clientWidth / WHOLE.width, clientHeight / WHOLE.height));
  };
  const look = () => {
    const shown = placeShown()?.pathname;
    if (!shown || shown === "blank") return;
    keep();
    const isWhole = shown.endsWith("/screen/");
    stage.toggleAttribute("data-whole", isWhole);
    if (isSearching) screen.contentDocument.getElementById("filter")?.focus();
    isSearching = false;
    // Other pages have keys of their own.
    if (isWhole) screen.contentDocument.addEventListener("keydown", press);
    for (const link of document.querySelectorAll("nav a")) {
      if (link.pathname === shown) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
  };
  // The search of the screen that is shown; the operator's has none.
  let isSearching = false;
  const search = () => {
    screen.contentWindow.focus();
    const opens = screen.contentDocument?.querySelector("[data-search]");
    if (opens) return void opens.click();
    isSearching = true;
    screen.contentWindow.location = `/replay/${body.dataset.replay}/screen/developer/search`;
  };
  new ResizeObserver(fit).observe(stage);
  screen.addEventListener("load", look);
  stage.toggleAttribute("data-whole", true);

  document.querySelector("button[name=remember]").addEventListener("click", () => {
    // Not the slider's, which has steps.
    remembered = Math.round(shownAt);
    differs.querySelector("time").textContent = timeOf(remembered);
    differs.hidden = false;
    show(shownAt);
  });

  // A click in a strip goes to its instant.
  lanes?.addEventListener("click", (event) => {
    const strip = event.target.closest("svg");
    if (!strip || event.target.closest("a")) return;
    const { left, width } = strip.getBoundingClientRect();
    const [start, end] = [Number(lanes.dataset.start), Number(lanes.dataset.end)];
    goTo(start + ((event.clientX - left) / width) * (end - start));
  });

  // The timeline in the frame has a moment too.
  addEventListener("telltale:moment", ({ detail }) => goTo(detail));

  show(Number(body.dataset.at));
  setInterval(() => ask(), ASK_MS);
})();
