// The login by touch: keys that fill the form, and names to choose from. The form also works without it.
(() => {
  "use strict";
  const NAMES_KEPT = 3;
  const KEPT = "telltale.names";

  const form = document.querySelector(".page-login form");
  const pad = document.querySelector(".pad");
  const known = document.querySelector(".known");
  const { name, secret } = form.elements;
  // The question whether to take over has nothing to type.
  if (!secret) return;

  // The names that were used here, the last one first.
  const used = () => {
    try {
      const kept = JSON.parse(localStorage.getItem(KEPT));
      return Array.isArray(kept) ? kept.filter((it) => typeof it === "string").slice(0, NAMES_KEPT) : [];
    } catch {
      return [];
    }
  };

  // --- the keys that the focused field needs

  let field = name.value ? secret : name;

  const turnTo = (input) => {
    field = input;
    pad.querySelector(".digits").hidden = input !== secret;
    pad.querySelector(".letters").hidden = input !== name;
    for (const input of [name, secret]) input.parentElement.classList.toggle("typing", input === field);
    // A keyboard types where the pad does, and one field alone looks chosen.
    if ([name, secret].includes(document.activeElement) && document.activeElement !== field) field.focus();
  };

  const press = (key) => {
    if (key === "enter") form.requestSubmit();
    else if (key === "next") turnTo(secret);
    else if (key === "back") field.value = [...field.value].slice(0, -1).join("");
    else if (field.value.length < field.maxLength) field.value += key;
  };

  for (const input of [name, secret]) input.addEventListener("focus", () => turnTo(input));
  pad.addEventListener("click", (event) => {
    const key = event.target.closest("[data-key]")?.dataset.key;
    if (key) press(key);
  });
  // A touch on a key leaves the field its focus, so that a keyboard goes on where it was.
  pad.addEventListener("pointerdown", (event) => event.preventDefault());

  // --- names to choose from

  const choose = (who) => {
    name.value = who;
    secret.value = "";
    turnTo(secret);
    mark();
  };

  const mark = () => {
    for (const button of known.children) {
      button.setAttribute("aria-pressed", String(button.textContent === name.value));
    }
  };

  const offer = (who) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = who;
    button.addEventListener("click", () => choose(who));
    return button;
  };

  // The server names the operators at the vehicle's own displays; those who were here last stand first.
  const offered = [...known.children].map((button) => button.textContent);
  // Who hands over is not the next one.
  const usedHere = used().filter((who) => who !== known.dataset.from && (offered.length === 0 || offered.includes(who)));
  const all = [...new Set([...usedHere, ...offered])];
  known.replaceChildren(...all.map(offer));
  known.hidden = all.length === 0;
  // Nobody types a PIN for a name that was not chosen.
  const [likely] = all.length === 1 ? all : usedHere;
  if (!name.value && likely) {
    choose(likely);
    secret.focus();
  }
  name.addEventListener("input", mark);
  mark();

  // Missing input is reported in the page's words, in place of the last error.
  form.noValidate = true;
  const failure = form.querySelector(".failure:not(.missing, .unfit)");
  const missing = form.querySelector(".missing");
  const sayMissing = (input) => {
    failure.hidden = true;
    for (const text of missing.children) text.hidden = text.dataset.missing !== input.name;
    missing.hidden = false;
    turnTo(input);
    input.focus();
  };

  // The operator's page stores the name once the login has worked.
  form.addEventListener("submit", (event) => {
    const empty = [name, secret].find((input) => input.value === "");
    if (empty) {
      event.preventDefault();
      return sayMissing(empty);
    }
    try {
      sessionStorage.setItem("telltale.trying", name.value);
    } catch {
      // Without storage nothing is remembered.
    }
  });

  pad.hidden = false;
  turnTo(field);
})();
