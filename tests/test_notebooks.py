"""Notebooks as they are kept: pictures of the code that is in them, and nothing of a machine."""

import base64

import nbformat
import pytest

from tools import notebooks

PATHS = sorted(notebooks.FOLDER.glob("*.ipynb"))
MOST_BYTES = 900_000


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_pictures_are_of_the_code(path):
    notebook = nbformat.read(path, as_version=4)
    assert not notebooks.stale(notebook), f"the code has changed: python -m tools.notebooks notebooks/{path.name}"
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    assert all(output == notebooks.kept(output) or "image/png" in output.data for output in outputs)
    assert path.stat().st_size < MOST_BYTES


def executed():
    png = base64.b64encode(
        bytes.fromhex(
            "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8cfc000000301"
            "0100c9fe92ef0000000049454e44ae426082"
        )
    ).decode()
    outputs = [
        {"output_type": "stream", "name": "stdout", "text": "1.5 m\n"},
        {"output_type": "stream", "name": "stderr", "text": "a warning\n"},
        {"output_type": "stream", "name": "stdout", "text": "written to /tmp/abc/page.html\n"},
        {"output_type": "stream", "name": "stdout", "text": "line\n" * 100},
        {"output_type": "display_data", "data": {"image/png": png, "text/plain": "<Figure>"}, "metadata": {}},
        {"output_type": "execute_result", "data": {"text/html": "<iframe/>"}, "metadata": {}, "execution_count": 3},
        {"output_type": "display_data", "data": {"text/markdown": "| a |"}, "metadata": {}},
    ]
    cell = nbformat.v4.new_code_cell("print(1)", execution_count=3)
    cell.outputs = [nbformat.from_dict(output) for output in outputs]
    return nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("# Title"), cell])


def test_what_is_kept(tmp_path):
    notebook = executed()
    assert notebooks.stale(notebook)
    notebooks.strip(notebook)
    assert not notebooks.stale(notebook)
    first, long, picture, table = notebook.cells[1].outputs
    assert first.text == "1.5 m\n" and long.text.count("line") == notebooks.MOST_LINES and long.text.endswith("…\n")
    assert set(picture.data) == {"image/png"} and table.data["text/markdown"] == "| a |"
    assert notebook.cells[1].execution_count is None
    notebook.cells[1].source += "\n"
    assert notebooks.stale(notebook)
    notebook.cells[1].outputs = [
        nbformat.from_dict({"output_type": "error", "ename": "E", "evalue": "no", "traceback": []})
    ]
    with pytest.raises(ValueError, match="a cell failed: E: no"):
        notebooks.strip(notebook)


def test_as_a_page(tmp_path):
    notebook, path = executed(), tmp_path / "01_try.ipynb"
    notebooks.strip(notebook)
    nbformat.write(notebook, path)
    page = notebooks.page(path, tmp_path / "pictures")
    assert page.startswith("# Title\n\n```python\nprint(1)\n```\n\n```text\n1.5 m\n```")
    assert "](pictures/01_try_0.png)" in page and (tmp_path / "pictures" / "01_try_0.png").stat().st_size > 50
    assert page.endswith("| a |\n")


@pytest.mark.slow
def test_a_cell_that_fails_is_told_and_nothing_is_written(tmp_path):
    path = tmp_path / "bad.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("1 / 0")]), path)
    before = path.read_bytes()
    with pytest.raises(ValueError, match="ZeroDivisionError"):
        notebooks.render(path)
    assert path.read_bytes() == before
