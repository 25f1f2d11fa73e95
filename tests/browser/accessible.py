"""What axe-core finds on a page as it stands now."""

from pathlib import Path

AXE = (Path(__file__).parent / "axe/axe.min.js").read_text()


def violations(page):
    """One line each: the rule, and the first elements that break it. Empty if there is none."""
    page.evaluate(AXE)
    found = page.evaluate(
        "async () => (await axe.run(document, { resultTypes: ['violations'] })).violations"
        ".map(it => `${it.id}: ${it.help}: ${it.nodes.slice(0, 3).map(node => node.html.slice(0, 160)).join(' | ')}`)"
    )
    return "\n".join(found)
