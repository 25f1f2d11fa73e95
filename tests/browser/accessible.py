"""The violations that axe-core finds on the present page."""

from pathlib import Path

AXE = (Path(__file__).parent / "axe/axe.min.js").read_text()
# The violations that axe-core finds, and how live the display was meanwhile.
RUN = """async () => {
  const states = new Set([document.body.dataset.live]);
  const watch = new MutationObserver(() => states.add(document.body.dataset.live));
  watch.observe(document.body, { attributes: true, attributeFilter: ["data-live"] });
  const { violations } = await axe.run(document, { resultTypes: ["violations"] });
  watch.disconnect();
  const shown = it => it.nodes.slice(0, 3).map(node => node.html.slice(0, 160)).join(" | ");
  return [violations.map(it => `${it.id}: ${it.help}: ${shown(it)}`), [...states]];
}"""
LOADED = "() => typeof axe === 'object'"
LIVE = "() => document.body.dataset.live === 'live'"


def violations(page, live=False):
    """One line each: the rule, and the first elements that break it. Empty if there is none.

    A display that is live, or that the caller saw live, is judged while it is: on a busy machine it may dim for
    a moment."""
    live = live or page.evaluate(LIVE)
    if not page.evaluate(LOADED):
        page.evaluate(AXE)
    found, states = page.evaluate(RUN)
    while found and live and states != ["live"]:
        page.wait_for_function(LIVE)
        found, states = page.evaluate(RUN)
    return "\n".join(found)
