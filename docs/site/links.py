"""Preprocessor of mdBook: links to files of the repository that the site does not hold lead to the repository.

Links to a README.md lead to the index.md that mdBook makes of it. The book comes as JSON on standard input,
[context, book], and goes to standard output. A link to a file that does not exist is an error.
"""

import json
import os
import re
import sys

# Target of a link between its brackets: "](", the target, ")".
LINK = re.compile(r"(\]\()([^)\s]+)(\))")


def chapters(items):
    """All chapters, also those below others."""
    for chapter in (item["Chapter"] for item in items if "Chapter" in item):
        yield chapter
        yield from chapters(chapter["sub_items"])


def main():
    context, book = json.load(sys.stdin)
    url = context["config"]["output"]["html"]["git-repository-url"]
    docs = context["root"]
    pages = list(chapters(book["items"]))
    site_pages = {chapter["source_path"] for chapter in pages}
    faults = []

    def site_link(page, link):
        """The link of a page as it leads from the site."""
        file, mark, anchor = link.partition("#")
        if "://" in link or link.startswith("mailto:") or not file:
            return link
        path = os.path.normpath(os.path.join(os.path.dirname(page), file))
        full = os.path.normpath(os.path.join(docs, path))
        if not os.path.exists(full):
            faults.append(f"{page}: {link}: no such file")
        if path in site_pages:
            return re.sub(r"README\.md$", "index.md", file) + mark + anchor
        if not path.startswith("..") and os.path.isfile(full) and not path.endswith(".md"):
            return link
        kind = "tree" if os.path.isdir(full) else "blob"
        return f"{url}/{kind}/main/{os.path.relpath(full, os.path.dirname(docs))}{mark}{anchor}"

    for chapter in pages:
        page, in_code, lines = chapter["source_path"], False, []
        for line in chapter["content"].split("\n"):
            in_code ^= line.lstrip().startswith("```")
            line = re.sub(r"^```ron\b.*", "```rust", line)  # the colours of Rust suit RON, which mdBook does not know
            lines.append(line if in_code else LINK.sub(lambda m: m[1] + site_link(page, m[2]) + m[3], line))
        chapter["content"] = "\n".join(lines)
    if faults:
        sys.exit("\n".join(faults))
    json.dump(book, sys.stdout)


if sys.argv[1:2] == ["supports"]:
    sys.exit(0)
main()
