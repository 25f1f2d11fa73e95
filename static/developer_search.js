// The search over everything, on each developer page: Ctrl-K or `/` opens it. Its results are those of the page
// /developer/search, which is there without scripts too.
(() => {
  "use strict";
  const dialog = document.getElementById("search");
  const form = dialog.querySelector("form");
  const field = form.elements.namedItem("q");
  const results = dialog.querySelector(".results");

  // The newest question; answers to older ones are dropped.
  let turn = 0;
  const look = async () => {
    const mine = ++turn;
    const words = field.value.trim();
    if (!words) return results.replaceChildren();
    const address = `${form.getAttribute("action")}?q=${encodeURIComponent(words)}`;
    const answer = await fetch(address, { headers: { "Telltale-Part": "content" }, cache: "no-store" });
    if (answer.redirected) return void location.assign(answer.url);
    const template = document.createElement("template");
    template.innerHTML = await answer.text();
    const found = template.content.querySelector("#dev");
    if (mine !== turn || !found) return undefined;
    telltale.localTimes(found);
    // The page below may have the same.
    for (const part of found.querySelectorAll("[id]")) part.removeAttribute("id");
    return results.replaceChildren(...found.children);
  };
  // The next letter asks again.
  let looked = Promise.resolve();
  const ask = () => (looked = look().catch(() => undefined));

  const open = () => {
    if (!dialog.open) dialog.showModal();
    field.select();
    ask();
  };

  const move = (step) => {
    const all = [field, ...results.querySelectorAll("[data-open]")];
    const at = all.indexOf(document.activeElement) + step;
    all[Math.min(all.length - 1, Math.max(0, at))].focus();
  };

  field.addEventListener("input", ask);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    await looked;
    results.querySelector("[data-open]")?.click();
  });
  dialog.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    move(step);
  });
  // What was found is brought by the page's own script.
  dialog.addEventListener("click", ({ target }) => {
    if (target === dialog || target.closest("a")) dialog.close();
  });
  document.addEventListener(
    "click",
    (event) => {
      const link = event.target.closest?.("[data-search]");
      if (!link || event.ctrlKey || event.metaKey || event.shiftKey) return;
      event.preventDefault();
      open();
    },
    true,
  );
  document.addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() !== "k" || !(event.ctrlKey || event.metaKey) || event.altKey || event.shiftKey) return;
    event.preventDefault();
    open();
  });
})();
