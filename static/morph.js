// Makes an element what another one is by as few changes as that takes: what stays keeps its focus,
// its place and its layout. Elements with an id are taken for each other by it, all others by their order.
(() => {
  "use strict";

  const isLike = (old, fresh) => old.nodeName === fresh.nodeName && old.id === fresh.id;

  const attributes = (old, fresh) => {
    for (const { name, value } of fresh.attributes) {
      if (old.getAttribute(name) === value) continue;
      // Sizes that a script has set: as an attribute the page's policy would refuse them.
      if (name === "style") old.style.cssText = value;
      else old.setAttribute(name, value);
    }
    // It has all of them now; what it has besides goes.
    if (old.attributes.length === fresh.attributes.length) return;
    for (const { name } of [...old.attributes]) if (!fresh.hasAttribute(name)) old.removeAttribute(name);
  };

  const children = (old, fresh) => {
    let at = old.firstChild;
    for (let child = fresh.firstChild, next; child; child = next) {
      next = child.nextSibling;
      let found = at;
      while (found && !isLike(found, child)) found = found.nextSibling;
      if (!found) {
        old.insertBefore(child, at);
        continue;
      }
      at = drop(at, found).nextSibling;
      morph(found, child);
    }
    drop(at, null);
  };

  // Takes away what stands from one node on to another.
  const drop = (from, to) => {
    for (let node = from, next; node !== to; node = next) {
      next = node.nextSibling;
      node.remove();
    }
    return to;
  };

  const morph = (old, fresh) => {
    if (fresh.nodeType !== Node.ELEMENT_NODE) {
      if (old.data !== fresh.data) old.data = fresh.data;
      return;
    }
    attributes(old, fresh);
    children(old, fresh);
  };

  globalThis.morph = morph;
})();
