// The developer pages: the address is a page's whole state, and the server renders it. This script requests
// it again when the server has news, and loads other developer pages into the present frame.
(() => {
  "use strict";
  // Between two answers: four a second look live.
  const RENEW_MIN_MS = 250;
  const ANSWER_MS = 5000;
  // If announced news is missing for so long, the page is stale, then dead.
  const BEHIND_STALE_MS = 2000;
  const BEHIND_DEAD_MS = 5000;
  const SCROLLED_MS = 150;

  const root = document.documentElement;
  const body = document.body;
  const stage = document.getElementById("dev-stage");
  const main = () => document.querySelector("main");
  const content = () => document.getElementById("dev");

  let newest = Number(content().dataset.revision);
  // A locked vehicle has another page, except for pages that say nothing about its parts.
  const locked = body.dataset.stage === "locked";
  const replay = body.dataset.replay !== undefined;
  let behindSince = null;
  let renewedAt = performance.now();
  let pending = null;

  const { setText } = Live;

  const localTimes = (part) => {
    for (const time of part.querySelectorAll("time.clock")) {
      const at = new Date(time.dateTime);
      if (Number.isNaN(at.getTime())) continue;
      const ms = time.classList.contains("exact") ? `.${String(at.getMilliseconds()).padStart(3, "0")}` : "";
      const clock = at.toTimeString().slice(0, 8) + ms;
      setText(time, time.classList.contains("whole") ? `${at.toLocaleDateString(root.lang, { dateStyle: "medium" })} ${clock}` : clock);
    }
    for (const text of part.querySelectorAll("[data-clock]")) {
      setText(text, new Date(text.dataset.clock).toTimeString().slice(0, 8));
    }
  };

  // --- the page that is shown

  // The page that an address belongs to, without its parameters. Each node has its own.
  const WHY = `${body.dataset.socket.split("/live?")[0]}/why`;
  const pageOf = ({ pathname, search }) => (pathname === WHY ? `${pathname}?${new URLSearchParams(search).get("node")}` : pathname);
  const FURTHER = /^\/(incidents\/\d+(\/what-if)?|developer\/(learn|statistics))$/;
  const known = new Set([WHY, ...[...document.querySelectorAll("nav a, [data-search]")].map((link) => link.pathname)]);
  const isKnown = (pathname) => known.has(pathname) || FURTHER.test(pathname);
  // The answer to a form stands under the address of its page, so a reload sends nothing twice.
  if (!isKnown(location.pathname)) history.replaceState(null, "", main().dataset.page);
  let shownPage = pageOf(location);
  const { frame } = main().dataset;

  // One request at a time; a newer one aborts the older one, which then has no answer. With a header,
  // requests that no person made keep no session alive.
  const ask = async (address, part, byItself) => {
    pending?.abort();
    const abort = new AbortController();
    pending = abort;
    const limit = setTimeout(() => abort.abort(), ANSWER_MS);
    const headers = { "Telltale-Part": part, ...(byItself && Live.RENEWAL) };
    try {
      const answer = await fetch(address, { headers, cache: "no-store", signal: abort.signal });
      if (answer.redirected) return void location.assign(answer.url);
      if (!answer.ok) throw new Error(`status ${answer.status}`);
      const text = await answer.text();
      if (pending !== abort) return undefined;
      const template = document.createElement("template");
      template.innerHTML = text;
      const element = template.content.querySelector(part === "main" ? "main" : "#dev");
      if (!element) throw new Error("no page of this server");
      // Another program, configuration, user or language: the frame of the page is old.
      if (element.dataset.frame !== undefined && element.dataset.frame !== frame) throw new Error("another frame");
      // Prepared before the comparison, so that unchanged elements stay untouched.
      localTimes(element);
      return element;
    } catch (error) {
      if (pending !== abort) return undefined;
      throw error;
    } finally {
      clearTimeout(limit);
      if (pending === abort) {
        pending = null;
        renewedAt = performance.now();
      }
    }
  };

  const shown = () => {
    const { revision, static: fixed } = content().dataset;
    if (fixed !== undefined || Number(revision) >= newest) behindSince = null;
    dispatchEvent(new Event("telltale:shown"));
  };

  // Replaces this page by another one, as if it had been loaded.
  const showPage = (fresh, url) => {
    main().replaceWith(fresh);
    shownPage = pageOf(url);
    const title = fresh.querySelector("h2");
    document.title = `${title.textContent} - Telltale`;
    for (const link of document.querySelectorAll(".dev-bar nav a")) {
      // While a moment is chosen, a link leads there.
      if ((link.dataset.now ?? link.pathname) === fresh.dataset.page) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    prepareForms();
    dispatchEvent(new Event("telltale:page"));
    shown();
    // A screen reader hears the name of the page and goes on from its beginning.
    title.focus({ preventScroll: true });
  };

  // Sizes that a script has set stay, and so does what somebody types.
  const beforeAttributeUpdated = (name, element) =>
    name !== "style" && !(name === "value" && element === document.activeElement);
  // What a script fills is left to it.
  const isServers = (node) => node.nodeType !== Node.ELEMENT_NODE || !node.hasAttribute("data-own");
  const callbacks = { beforeAttributeUpdated, beforeNodeMorphed: isServers, beforeNodeRemoved: isServers };

  const renew = async (byItself) => {
    // If the next request came before the answer, the page and its address differ.
    const isOther = pageOf(location) !== shownPage;
    try {
      const fresh = await ask(location.href, isOther ? "main" : "content", byItself);
      if (!fresh) return;
      if (isOther) return showPage(fresh, location);
      Idiomorph.morph(content(), fresh, { callbacks });
      shown();
    } catch {
      // A failed request shows as the age of the page; the content always belongs to the address.
      if (isOther) location.reload();
    }
  };

  const renewIfDue = () => {
    const every = Number(content().dataset.renew);
    const wait = performance.now() - renewedAt;
    if (pending || wait < RENEW_MIN_MS || document.hidden || !live.everBeat) return;
    if (content().dataset.static !== undefined) return;
    const news = Number(content().dataset.revision) < newest;
    if (news || (every > 0 && wait >= every)) renew(true);
  };

  // --- live, stale, dead

  // Missing news ages the page slower than missing heartbeats.
  const behind = (now) => {
    const waited = behindSince === null ? 0 : now - behindSince;
    return waited >= BEHIND_DEAD_MS ? Live.DEAD_MS : waited >= BEHIND_STALE_MS ? Live.STALE_MS : 0;
  };

  const beat = (message) => {
    body.dataset.stage = message.stage;
    stage.dataset.overall = message.overall;
    setText(stage.querySelector(".word"), message.word);
    stage.lastElementChild.dataset.state = message.overall;
    setText(stage.lastElementChild, message.state);
    // Another configuration or another server counts anew.
    newest = message.revision;
    const renews = content().dataset.static === undefined;
    if (renews && Number(content().dataset.revision) < newest && !document.hidden) behindSince ??= performance.now();
    if (renews && !replay && (message.stage === "locked") !== locked) location.reload();
  };

  let socket = null;
  const connect = () => {
    const it = new WebSocket(body.dataset.socket);
    socket?.close();
    socket = it;
    it.addEventListener("open", () => live.opened(it));
    // Unless it was replaced.
    it.addEventListener("close", ({ code }) => it === socket && live.closed(code));
  };

  const live = new Live({ address: "/developer", connect, beat, judged: renewIfDue, behind });
  // The session of this page is used from another address, too.
  live.listen(({ elsewhere }) => {
    if (elsewhere === undefined) return;
    const said = document.querySelector("p.elsewhere") ?? document.createElement("p");
    said.className = "elsewhere";
    said.setAttribute("role", "alert");
    setText(said, elsewhere);
    if (!said.isConnected) main().before(said);
  });

  // --- another address

  // The same page with other parameters.
  const go = (address, replace) => {
    const { state } = history;
    if (replace) history.replaceState(state, "", address);
    else history.pushState(state, "", address);
    keepForm();
    return renew();
  };

  // Another page. If it cannot be brought here, the browser loads it.
  const visit = async (url) => {
    let fresh;
    try {
      fresh = await ask(url, "main");
    } catch {
      return location.assign(url);
    }
    if (!fresh) return undefined;
    saveScroll();
    if (url.href === location.href) history.replaceState(null, "", url);
    else history.pushState(null, "", url);
    showPage(fresh, url);
    const part = url.hash && document.getElementById(url.hash.slice(1));
    if (part) part.scrollIntoView();
    else scrollTo(0, 0);
    return undefined;
  };

  // The scroll position of each entry of the history.
  const saveScroll = () => history.replaceState({ y: scrollY }, "");
  const restoreScroll = () => scrollTo(0, history.state?.y ?? 0);
  let scrolled = 0;
  history.scrollRestoration = "manual";
  addEventListener("scroll", () => {
    clearTimeout(scrolled);
    scrolled = setTimeout(saveScroll, SCROLLED_MS);
  }, { passive: true });

  // The form keeps what links have changed: pins, the order.
  const keepForm = () => {
    for (const form of document.querySelectorAll("form[data-soft]")) {
      for (const hidden of form.querySelectorAll("input[type=hidden]")) hidden.remove();
      const named = new Set([...form.elements].map((element) => element.name));
      for (const [name, value] of new URLSearchParams(location.search)) {
        // A new filter is shown from the beginning.
        if (named.has(name) || name.startsWith("page")) continue;
        form.prepend(Object.assign(document.createElement("input"), { type: "hidden", name, value }));
      }
    }
  };

  const fillForms = () => {
    const asked = new URLSearchParams(location.search);
    for (const form of document.querySelectorAll("form[data-soft]")) {
      for (const element of form.elements) {
        if (element.name && element.type !== "hidden") element.value = asked.get(element.name) ?? element.dataset.plain ?? "";
      }
    }
    keepForm();
  };

  const addressOf = (form) => {
    const asked = new URLSearchParams();
    for (const [name, value] of new FormData(form)) if (value !== "") asked.append(name, value);
    return `${location.pathname}?${asked}`;
  };

  document.addEventListener("click", (event) => {
    const link = event.target.closest?.("a[href]");
    if (!link || link.hasAttribute("target")) return;
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey || event.button !== 0) return;
    const url = new URL(link.getAttribute("href"), location.href);
    if (url.origin !== location.origin || !isKnown(url.pathname)) return;
    event.preventDefault();
    if (link.dataset.soft !== undefined) go(url);
    else visit(url);
  });
  for (const type of ["input", "submit"]) {
    document.addEventListener(type, (event) => {
      const form = event.target.closest?.("form[data-soft]");
      if (!form || (type === "input" && event.target.dataset.late !== undefined)) return;
      event.preventDefault();
      go(addressOf(form), true);
    });
  }
  addEventListener("popstate", async () => {
    clearTimeout(scrolled);
    if (pageOf(location) === shownPage) fillForms();
    await renew();
    restoreScroll();
  });

  const prepareForms = () => {
    for (const form of document.querySelectorAll("form[data-soft]")) form.dataset.scripted = "";
    keepForm();
  };

  globalThis.telltale = { go, localTimes };
  localTimes(document);
  prepareForms();
  addEventListener("DOMContentLoaded", restoreScroll);
  live.connect();
})();
