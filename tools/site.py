"""The documentation as one site: pages of `docs`, cards of the policies, and the API reference. Warnings fail.

    python -m tools.site build/site

Needs the extra `docs`, all others for the reference, and no network. Pages may link to files of the repository that are
no pages themselves (`../hotice/policies/student.md`): those that a page asks for are laid beside it. Notebooks are
pages, with the pictures that they hold.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from tools import notebooks, reference
from tools.mathml import with_mathml

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\]\((?:\.\./)+([\w./-]+)(#[\w-]+)?\)")


def gather(folder: Path) -> list[Path]:
    """Copies of all pages in `folder`, with links out of `docs` led to copies of what they mean."""
    shutil.copytree(ROOT / "docs", folder, dirs_exist_ok=True)
    for notebook in sorted((ROOT / "notebooks").glob("*.ipynb")):
        made = folder / "notebooks" / f"{notebook.stem}.md"
        made.parent.mkdir(exist_ok=True)
        made.write_text(notebooks.page(notebook, made.parent / "pictures"), encoding="utf-8")
    pages = sorted(folder.rglob("*.md"))
    for page in pages:
        text = page.read_text(encoding="utf-8")
        text = LINK.sub(lambda link: f"]({_beside(link[1], folder)}{link[2] or ''})", text)
        page.write_text(with_mathml(text), encoding="utf-8")
    return pages


def _beside(path: str, folder: Path) -> str:
    """Path of a copy below `files`, made when first asked for; of a notebook its page.

    Raises `FileNotFoundError`: a link that leads nowhere.
    """
    if path.startswith("notebooks/") and path.endswith(".ipynb"):
        page = Path(path).with_suffix(".md")
        if not (folder / page).exists():
            raise FileNotFoundError(path)
        return page.as_posix()
    copy = folder / "files" / path
    if not copy.exists():
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / path, copy)
    return copy.relative_to(folder).as_posix()


def build(out: Path, source: Path, refer: bool = True) -> None:
    """Writes the site; raises `CalledProcessError` for any warning of MkDocs."""
    shutil.rmtree(source, ignore_errors=True)
    gather(source)
    if refer:
        reference.write(source / "api")
    config = source.parent / "mkdocs.yml"
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    config.write_text(f"docs_dir: {source.resolve()}\nsite_dir: {out.resolve()}\n{text}", encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--config-file", str(config)]
    # what its makers advertise is no warning about these pages
    subprocess.run(command, check=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})


def main() -> int:
    """Exit status: 1 where a name leads nowhere or MkDocs warns."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the site")
    out = parser.parse_args().out
    missing = reference.lost()
    for line in missing:
        print(line, file=sys.stderr)
    try:
        build(out, out.parent / "site-source")
    except subprocess.CalledProcessError:
        return 1
    print(out / "index.html")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
