"""The tool behind `make docs`: links out of `docs` lead to copies, and whatever MkDocs warns of fails."""

import subprocess

import nbformat
import pytest

from tools import site


@pytest.fixture
def root(tmp_path, monkeypatch):
    (tmp_path / "docs" / "deep").mkdir(parents=True)
    (tmp_path / "hotice").mkdir()
    (tmp_path / "hotice" / "card.md").write_text("# A card\n")
    (tmp_path / "mkdocs.yml").write_text((site.ROOT / "mkdocs.yml").read_text().split("nav:\n")[0])
    monkeypatch.setattr(site, "ROOT", tmp_path)
    return tmp_path


def test_links_out_of_the_pages_lead_to_copies(root):
    (root / "docs" / "page.md").write_text("[card](../hotice/card.md#a-card), [page](other.md)\n")
    site.gather(root / "source")
    assert (root / "source" / "page.md").read_text() == "[card](files/hotice/card.md#a-card), [page](other.md)\n"
    assert (root / "source" / "files" / "hotice" / "card.md").read_text() == "# A card\n"


def test_notebooks_are_pages(root):
    (root / "notebooks").mkdir()
    nbformat.write(
        nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell("# Try")]), root / "notebooks/01.ipynb"
    )
    (root / "docs" / "page.md").write_text("[try](../notebooks/01.ipynb)\n")
    site.gather(root / "source")
    assert (root / "source" / "page.md").read_text() == "[try](notebooks/01.md)\n"
    assert (root / "source" / "notebooks" / "01.md").read_text() == "# Try\n"
    (root / "docs" / "page.md").write_text("[gone](../notebooks/02.ipynb)\n")
    with pytest.raises(FileNotFoundError, match="02.ipynb"):
        site.gather(root / "source")


def test_every_notebook_is_in_the_menu():
    menu = (site.ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    found = sorted((site.ROOT / "notebooks").glob("*.ipynb"))
    assert len(found) >= 5 and all(f": notebooks/{path.stem}.md" in menu for path in found)


def test_a_link_to_no_file_is_an_error(root):
    (root / "docs" / "page.md").write_text("[gone](../hotice/gone.md)\n")
    with pytest.raises(FileNotFoundError, match="gone.md"):
        site.gather(root / "source")


def test_the_first_page_and_the_menu_lead_to_every_page():
    pages = {page.name for page in (site.ROOT / "docs").glob("*.md")} - {"index.md"}
    first, menu = ((site.ROOT / name).read_text(encoding="utf-8") for name in ("docs/index.md", "mkdocs.yml"))
    assert [page for page in sorted(pages) if f"({page})" not in first or f": {page}" not in menu] == []


@pytest.mark.parametrize("text, ok", [("[up](#a-head)", True), ("[gone](gone.md)", False), ("[up](#no-head)", False)])
def test_what_mkdocs_warns_of_fails(root, text, ok):
    pytest.importorskip("material")
    (root / "docs" / "index.md").write_text(f"# A head\n\n{text}\n")
    if ok:
        site.build(root / "site", root / "build" / "source", refer=False)
        assert "A head" in (root / "site" / "index.html").read_text()
    else:
        with pytest.raises(subprocess.CalledProcessError):
            site.build(root / "site", root / "build" / "source", refer=False)
