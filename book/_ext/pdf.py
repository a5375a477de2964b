"""Print the built pages, in the order of the table of contents, into one PDF.

``python book/_ext/pdf.py _build/html book.pdf`` needs an installed Chromium. What is folded away on
the pages, the code of figures above all, is left out by the print style in ``_static/book.css``.
"""

from __future__ import annotations

import io
import re
import shutil
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright
from pypdf import PdfWriter

ROOT = Path(__file__).resolve().parents[2]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
MARGIN = {"top": "18mm", "bottom": "18mm", "left": "16mm", "right": "16mm"}
NUMBER = """<div style="font-size: 8px; text-align: center; width: 100%">
<span class="title"></span>, <span class="pageNumber"></span></div>"""

# Headings without the signs of their links.
PREPARED = "document.querySelectorAll('a.headerlink').forEach(link => link.remove())"


def print_pages(html: Path, target: Path) -> None:
    """Write the PDF, with an outline of the pages' titles."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit(f"no browser found (looked for {', '.join(BROWSERS)})")
    contents = (ROOT / "_toc.yml").read_text(encoding="utf-8")
    writer, parents = PdfWriter(), {}
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        page = chromium.new_page(color_scheme="light")
        for indent, name in re.findall(r"^( *).*(?:root|file): (\S+)$", contents, re.MULTILINE):
            page.goto((html / f"{name}.html").as_uri(), wait_until="load")
            page.wait_for_timeout(2000)  # formulas are typeset and sliders draw their pictures
            page.evaluate(PREPARED)
            data = page.pdf(
                format="A4",
                scale=0.8,  # lines as long as on the screen
                margin=MARGIN,
                display_header_footer=True,
                header_template="<span></span>",
                footer_template=NUMBER,
            )
            first, title = len(writer.pages), page.locator("h1").first.inner_text()
            writer.append(io.BytesIO(data), import_outline=False)
            # A section stands four columns to the right of its chapter.
            parent = parents.get(len(indent) - 4)
            parents[len(indent)] = writer.add_outline_item(title, first, parent)
        chromium.close()
    target.parent.mkdir(parents=True, exist_ok=True)
    writer.write(target)


if __name__ == "__main__":
    print_pages(Path(sys.argv[1]).resolve(), Path(sys.argv[2]))
