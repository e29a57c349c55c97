"""The reference of the Python interface, as `make docs` writes it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCE = ROOT / "src" / "physid"
LOADING = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}


class Loaded(HTMLParser):
    """Collects what a page loads by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        address = dict(attrs).get(LOADING.get(tag, ""))
        if address:
            self.addresses.append(address)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("pdoc", reason="needs the extra docs: pip install 'physid[docs]'")
    folder = tmp_path_factory.mktemp("site")
    recipe = re.search(r"^\t\$\(BIN\)/pdoc (.*) site$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert recipe is not None
    words = [sys.executable, "-W", "error::UserWarning:pdoc", "-m", "pdoc", *recipe.group(1).split(), str(folder)]
    nowhere = {"http_proxy": "http://127.0.0.1:9", "https_proxy": "http://127.0.0.1:9"}
    done = subprocess.run(words, capture_output=True, text=True, env={**os.environ, **nowhere}, check=False)
    assert done.returncode == 0, done.stderr
    return folder


def public(path: Path) -> bool:
    """Return whether a module is one: no package around it names its public parts by `__all__`."""
    packages = [parent / "__init__.py" for parent in path.parents if parent.is_relative_to(SOURCE)]
    around = [package for package in packages if package != path]
    return path.stem != "__main__" and not any("__all__" in package.read_text() for package in around)


@pytest.mark.slow
def test_every_public_module_has_a_page_with_its_docstrings(site: Path) -> None:
    for path in filter(public, sorted(SOURCE.rglob("*.py"))):
        name = path.relative_to(SOURCE.parent).with_suffix("")
        page = site / (name.parent if name.name == "__init__" else name).with_suffix(".html")
        assert page.is_file(), f"{page.relative_to(site)} is missing"
    layer = (site / "physid" / "physics" / "layer.html").read_text()
    assert 'id="PhysicsLayer.rollout"' in layer
    assert "Raises" in layer


@pytest.mark.slow
def test_no_page_loads_anything_from_outside(site: Path) -> None:
    for page in site.rglob("*.html"):
        reader = Loaded()
        reader.feed(page.read_text())
        assert not [each for each in reader.addresses if re.match(r"(https?:)?//", each)], page.name
