"""Links for what the pages cite: `docs/alarms.md`, ADR 37 and *A heading*.

The pages are written to be read as files, so they name each other as code and by heading. On the
site each of these leads to what it names:

- the path of a page, from the root or as a bare name that is unique, with a section's number or a
  heading in italics after it where there is one; the page's title takes the place of its path;
- an ADR by its number;
- words in italics that are a heading of the same page or of the same chapters.
"""

import re
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.nodes import make_refnode

PAGE = re.compile(r"(?:docs/)?([\w./-]+)\.md(?: ([A-Z]{0,2}\d+(?:\.\d+)*))?")
AT_ROOT = {name: name.lower() for name in ("ARCHITECTURE", "CHANGELOG", "CONTRIBUTING")}
ADRS = re.compile(r"\bADRs?\s+\d+(?:(?:,|\s+(?:and|to|or))\s+\d+)*")
NUMBER = re.compile(r"\d+")
BETWEEN = re.compile(r",\s+")  # between a page and the heading that is meant
_ANCHORS: dict[str, dict[str, str]] = {}  # by page; reading a page anew takes a second
GUIDES = {
    "operating",
    "measurements",
}  # pages whose chapters, in the folder of the same name, are one text


class CitationLinks(SphinxPostTransform):
    """Makes links of what a page cites.

    Attributes
    ----------
    site : whose pages they are
    """

    site: Sphinx

    default_priority = 20  # before references are checked

    def run(self, **_: object) -> None:
        """Replace what is cited by references to it."""
        for literal in list(self.document.findall(nodes.literal)):
            self._page(literal)
        for emphasis in list(self.document.findall(nodes.emphasis)):
            self._heading(emphasis)
        for text in list(self.document.findall(nodes.Text)):
            self._adrs(text)

    def _page(self, literal: nodes.literal) -> None:
        found = PAGE.fullmatch(literal.astext())
        name = found and page_named(self.env, found[1], self.env.docname)
        if not found or name is None or _is_linked(literal):
            return
        heading = _heading_after(literal)
        targets = anchors(self.env, name)
        anchor = targets.get(found[2] or (heading.astext() if heading else ""), "")
        title = self.env.titles[name].astext()
        words = f"{title}, {found[2]}" if found[2] else title
        literal.replace_self(self._link(name, anchor, nodes.inline("", words)))
        if heading is not None and anchor and not found[2]:
            heading.replace_self(self._link(name, anchor, heading.deepcopy()))

    def _heading(self, emphasis: nodes.emphasis) -> None:
        if _is_linked(emphasis):
            return
        here = self.env.docname
        for name in [here, *chapters_of(self.env, here)]:
            if anchor := anchors(self.env, name).get(emphasis.astext()):
                emphasis.replace_self(self._link(name, anchor, emphasis.deepcopy()))
                return

    def _adrs(self, text: nodes.Text) -> None:
        if _is_linked(text) or isinstance(text.parent, nodes.literal | nodes.literal_block):
            return
        pieces: list[nodes.Node] = []
        end = 0
        for cited in ADRS.finditer(text):
            for number in NUMBER.finditer(text, cited.start(), cited.end()):
                name = adr_named(self.env, int(number[0]))
                if name is None or name == self.env.docname:
                    continue
                start = cited.start() if number.start() - cited.start() <= 5 else number.start()
                pieces.append(nodes.Text(text[end:start]))
                pieces.append(self._link(name, "", nodes.Text(text[start : number.end()])))
                end = number.end()
        if pieces:
            text.parent.replace(text, [*pieces, nodes.Text(text[end:])])

    def _link(self, name: str, anchor: str, child: nodes.Node) -> nodes.reference:
        return make_refnode(self.site.builder, self.env.docname, name, anchor, child)


def page_named(env: BuildEnvironment, name: str, by: str) -> str | None:
    """Name of the site's page that a path without its ending means; None if it is not one.

    Parameters
    ----------
    env : the site
    name : from the root of the repository, from `docs`, or a bare name that is unique
    by : the page that cites
    """
    if name in AT_ROOT:
        return AT_ROOT[name]
    beside = f"{by.rpartition('/')[0]}/{name}".lstrip("/")
    for one in (beside, name):
        if one in env.found_docs:
            return one
    named = [one for one in env.found_docs if one.endswith(f"/{name}")]
    return named[0] if len(named) == 1 else None


def adr_named(env: BuildEnvironment, number: int) -> str | None:
    """Page of a decision; None if there is none of this number."""
    return next((one for one in env.found_docs if one.startswith(f"adr/{number:04d}-")), None)


def chapters_of(env: BuildEnvironment, name: str) -> list[str]:
    """Pages of the guide that a page belongs to; none where it is no part of one."""
    guide = name.split("/")[0]
    if guide not in GUIDES:
        return []
    return sorted(one for one in env.found_docs if one == guide or one.startswith(f"{guide}/"))


def anchors(env: BuildEnvironment, name: str) -> dict[str, str]:
    """Anchors of a page by the text of each heading, and by its number if it has one."""
    if name not in _ANCHORS:
        _ANCHORS[name] = dict(_anchors(env.get_doctree(name)))
    return _ANCHORS[name]


def _anchors(page: nodes.document) -> Iterator[tuple[str, str]]:
    for section in page.findall(nodes.section):
        title = section.next_node(nodes.title)
        if title is None or not section["ids"]:
            continue
        text, anchor = title.astext(), section["ids"][0]
        yield text, anchor
        if numbered := re.match(r"([A-Z]{0,2}\d+(?:\.\d+)*)\.? ", text):
            yield numbered[1], anchor


def _heading_after(literal: nodes.literal) -> nodes.emphasis | None:
    siblings = literal.parent.children
    after = siblings[siblings.index(literal) + 1 :][:2]
    if len(after) == 2 and BETWEEN.fullmatch(after[0].astext()):
        return after[1] if isinstance(after[1], nodes.emphasis) else None
    return None


def _is_linked(node: nodes.Node) -> bool:
    parent = node.parent
    while parent is not None:
        if isinstance(parent, nodes.reference | nodes.title):
            return True
        parent = parent.parent
    return False


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the links, and diagrams as text."""
    CitationLinks.site = app
    app.add_post_transform(CitationLinks)
    app.add_lexer("mermaid", TextLexer)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
