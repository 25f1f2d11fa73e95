// Every page: the buttons for day or night and for the language.
(() => {
  "use strict";
  const root = document.documentElement;

  // Sizes in millimetres on a display of another density than the reference display's 149 dpi.
  if (root.dataset.dpi) root.style.setProperty("--density", root.dataset.dpi / 149);

  // Without WebSocket there is no live display: the page says so.
  if (!("WebSocket" in globalThis)) document.body.dataset.unfit = "";

  const remember = (name, value) => {
    document.cookie = `${name}=${value}; path=/; max-age=31536000; samesite=strict`;
  };

  const switchPalette = () => {
    // Switches all colours at once, without their transitions.
    root.dataset.turning = "";
    root.dataset.palette = root.dataset.palette === "day" ? "night" : "day";
    requestAnimationFrame(() => requestAnimationFrame(() => delete root.dataset.turning));
    remember("palette", root.dataset.palette);
  };

  // The button has its words in each language; the next one follows.
  const switchLanguage = (button) => {
    const all = [...button.querySelectorAll(":scope > [lang]")].map((words) => words.lang);
    const lang = all[(all.indexOf(root.lang) + 1) % all.length];
    remember("lang", lang);
    const live = new CustomEvent("telltale:language", { detail: { lang }, cancelable: true });
    // A page with a live connection gets its new texts from there; any other page reloads.
    if (document.dispatchEvent(live)) location.reload();
  };

  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("[data-tool]");
    const tool = button?.dataset.tool;
    if (tool === "palette") switchPalette();
    if (tool === "language") switchLanguage(button);
  });
})();
