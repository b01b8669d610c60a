"""The page as one HTML file: template, style, scripts, data. It makes no network requests.

Texts of a scenario and vehicle ids are data: Jinja escapes them in the markup, JSON's `<`, `>`, `&` and `'`
are written as \\u003c and so on, and the page's content security policy allows only the scripts
inserted here.
"""

import base64
import hashlib
import json
import os
from importlib import resources
from pathlib import Path

import jinja2
from markupsafe import Markup

from analysis.report.cards import Page
from analysis.report.reading import ReportError, json_ready

_FOLDER = resources.files("analysis.report") / "templates"


def render(page: Page, made_with: str = "") -> str:
    """The whole HTML text."""
    library, scripts = "", []
    if page.drives:
        scripts.append(_own("viewer.js"))
    if page.scene:
        from plotly.offline import get_plotlyjs

        library = get_plotlyjs().replace(
            "</script", "<\\/script"
        )  # it has none now; in a string that is the same
        scripts.append(_own("scene.js"))
    data = {"scene": page.scene} if page.scene else {}
    data |= {f"drive-data-{number}": drive for number, drive in enumerate(page.drives)}
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(_own("page.html.j2")).render(
        page=page,
        made_with=made_with,
        style=Markup(_own("style.css")),
        scripts=[Markup(script) for script in scripts],
        data={name: safe_json(content) for name, content in data.items()},
        library=Markup(library),
        policy=_policy([library, *scripts] if library else scripts),
    )


def write_html(page: Page, out: Path, made_with: str = "") -> Path:
    """Write the page completely or not at all. Raises ReportError if that fails."""
    text = render(page, made_with)
    part = out.with_name(out.name + ".part")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text, encoding="utf-8", errors="replace", newline="\n")
        os.replace(part, out)
    except OSError as error:
        raise ReportError(f"{out}: cannot be written ({error.strerror})") from None
    return out


def safe_json(content: object) -> Markup:
    """JSON that is safe in a <script>: no text in it can end the element or begin another."""
    text = json.dumps(json_ready(content), separators=(",", ":"), allow_nan=False)  # ASCII: U+2028 is escaped
    for character in "<>&'":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def _policy(scripts: list[str]) -> str:
    """Content security policy: only these scripts, pictures only from the page itself, nothing else."""
    digests = [hashlib.sha256(script.encode()).digest() for script in scripts]
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _own(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
