// The operator's display: keeps it awake, and remembers the names of those who logged in there.
(() => {
  "use strict";
  const NAMES = "telltale.names";
  const NAMES_KEPT = 3;
  const { user, role } = document.body.dataset;

  const stayAwake = async () => {
    if (document.visibilityState !== "visible") return;
    try {
      await navigator.wakeLock?.request("screen");
    } catch {
      // The kiosk's own settings keep the screen on.
    }
  };

  document.addEventListener("visibilitychange", stayAwake);
  stayAwake();

  // Names that were typed here and logged in successfully stand on the login page as buttons.
  try {
    if (role === "operator" && sessionStorage.getItem("telltale.trying") === user) {
      const kept = JSON.parse(localStorage.getItem(NAMES) ?? "[]");
      const names = [user, ...kept.filter((name) => name !== user)].slice(0, NAMES_KEPT);
      localStorage.setItem(NAMES, JSON.stringify(names));
      sessionStorage.removeItem("telltale.trying");
    }
  } catch {
    // Without storage nothing is remembered.
  }
})();
