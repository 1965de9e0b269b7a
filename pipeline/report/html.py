"""What every HTML page is made with: its template; pictures, data and scripts put into the page."""

from __future__ import annotations

import base64
import json
import mimetypes
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markupsafe import Markup

TEMPLATES = Path(__file__).with_name("templates")


def render(template: str, **values: Any) -> str:
    """A page from a template; whatever a name holds is escaped, and a name that is missing is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    result = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    result.filters |= {name: value for name, value in values.items() if callable(value)}
    return result.get_template(template).render(values)


def script_data(value: Any) -> Markup:
    """A value as JSON that may stand in a script element."""
    from markupsafe import Markup

    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def vendored(name: str) -> str:
    """A script that others wrote, in templates/vendor, as text that unpack.js inflates."""
    return deflated((TEMPLATES / "vendor" / name).read_bytes())


def deflated(data: bytes) -> str:
    """Bytes as base64 text of their zlib stream, which browsers inflate."""
    return base64.b64encode(zlib.compress(data, 9)).decode()


def data_url(name: str, data: bytes) -> str:
    """A picture's bytes as an address that stands in the page."""
    suffix = name.rsplit(".", 1)[-1]
    media = {"webp": "image/webp", "svg": "image/svg+xml"}.get(suffix) or str(mimetypes.guess_type(name)[0])
    return f"data:{media};base64,{base64.b64encode(data).decode()}"
