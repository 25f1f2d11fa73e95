// Changes an element into another one with few changes: unchanged parts keep their focus, position and
// layout. Elements with an id are matched by it, all others by their order.
(() => {
  "use strict";

  const isLike = (old, fresh) => old.nodeName === fresh.nodeName && old.id === fresh.id;

  const attributes = (old, fresh) => {
    for (const { name, value } of fresh.attributes) {
      if (old.getAttribute(name) === value) continue;
      // Sizes that a script has set: the page's policy would refuse them as an attribute.
      if (name === "style") old.style.cssText = value;
      else old.setAttribute(name, value);
    }
    // It has all new nodes now; the remaining old ones are removed.
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
