"""Notebooks with their pictures: executed, and all but pictures, tables and short texts left out.

    python -m tools.notebooks [notebooks/01_fields.ipynb …]

What a page loads from elsewhere, what moves, and paths of a machine are not kept: readers see pictures, run the rest. A
notebook remembers which code its pictures are of (`stale`), and a test fails where that has changed. The site has
each notebook as a page (`page`).
"""

from __future__ import annotations

import base64
import hashlib
import io
import re
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbformat import NotebookNode

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / "notebooks"
LONG_S = 1800
MOST_LINES = 40
"""Of a text that is kept; of a longer one as many of its beginning."""
KEY = "hotice"
OWN = re.compile(rf"/(?:tmp|home|root|Users)/\S+|{re.escape(str(ROOT))}")
"""Paths of a machine."""


def code_digest(notebook: NotebookNode) -> str:
    """SHA-256 of the code of all cells."""
    code = "\0".join(cell.source for cell in notebook.cells if cell.cell_type == "code")
    return hashlib.sha256(code.encode()).hexdigest()


def stale(notebook: NotebookNode) -> bool:
    """Whether the outputs are of other code than is in the cells."""
    return notebook.metadata.get(KEY, {}).get("code") != code_digest(notebook)


def kept(output: NotebookNode) -> NotebookNode | None:
    """What a reader is shown of an output, None for nothing. Raises `ValueError` for an error's."""
    if output.output_type == "error":
        raise ValueError(f"a cell failed: {output.ename}: {output.evalue}")
    if output.output_type == "stream":
        if output.name != "stdout" or OWN.search(output.text):
            return None
        lines = output.text.splitlines(keepends=True)
        text = "".join(lines[:MOST_LINES]) + ("…\n" if len(lines) > MOST_LINES else "")
        return nbformat.v4.new_output("stream", name="stdout", text=text)
    data = output.data
    if "image/png" in data:
        shown: dict[str, str] = {"image/png": smaller(data["image/png"])}
    elif "text/markdown" in data:
        shown = {"text/markdown": data["text/markdown"]}
    else:
        return None
    return nbformat.v4.new_output("display_data", data=shown)


def smaller(picture: str) -> str:
    """A PNG in base 64 with a palette of 128 colours."""
    from PIL import Image

    with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
        content = io.BytesIO()
        image.convert("RGB").quantize(128).save(content, "PNG", optimize=True)
    return base64.b64encode(content.getvalue()).decode()


def strip(notebook: NotebookNode) -> None:
    """Leaves of an executed notebook what is kept, and remembers its code."""
    for cell in notebook.cells:
        cell.metadata = nbformat.from_dict({})
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [shown for output in cell.outputs if (shown := kept(output)) is not None]
    notebook.metadata = nbformat.from_dict(
        {
            "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
            "language_info": {"name": "python"},
            KEY: {"code": code_digest(notebook)},
        }
    )


def render(path: Path) -> None:
    """Executes a notebook in its folder and writes it back, stripped. Raises `ValueError` for a cell that fails."""
    from nbclient import NotebookClient
    from nbclient.exceptions import CellExecutionError

    notebook = nbformat.read(path, as_version=4)
    try:
        NotebookClient(notebook, timeout=LONG_S, resources={"metadata": {"path": str(path.parent)}}).execute()
    except CellExecutionError as error:
        raise ValueError(str(error)) from None
    strip(notebook)
    nbformat.write(notebook, path)


def page(path: Path, pictures: Path) -> str:
    """The notebook as a page in Markdown; its pictures are written to a folder beside the page."""
    notebook: Any = nbformat.read(path, as_version=4)
    parts: list[str] = []
    for cell in notebook.cells:
        parts.append(cell.source if cell.cell_type == "markdown" else f"```python\n{cell.source}\n```")
        for output in cell.get("outputs", ()):
            if output.output_type == "stream":
                parts.append(f"```text\n{output.text.rstrip()}\n```")
            elif "image/png" in output.data:
                pictures.mkdir(parents=True, exist_ok=True)
                picture = pictures / f"{path.stem}_{len(list(pictures.glob(f'{path.stem}_*.png')))}.png"
                picture.write_bytes(base64.b64decode(output.data["image/png"]))
                parts.append(f"![What the code above shows]({pictures.name}/{picture.name})")
            elif "text/markdown" in output.data:
                parts.append(output.data["text/markdown"])
    return "\n\n".join(parts) + "\n"


def main() -> int:
    """Exit status: 1 where a cell failed."""
    for path in [Path(name) for name in sys.argv[1:]] or sorted(FOLDER.glob("*.ipynb")):
        try:
            render(path)
        except ValueError as error:
            print(f"{path}: {error}", file=sys.stderr)
            return 1
        print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
