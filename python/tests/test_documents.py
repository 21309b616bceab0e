"""What the documents say is run: docstrings, the README and the page of the project."""

from __future__ import annotations

import doctest
import inspect
import os
import re
from pathlib import Path

import pytest

import chladni
from chladni import _basis, _cloud, _laplacian

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("module", [chladni, _basis, _cloud, _laplacian], ids=lambda module: module.__name__)
def test_the_examples_of_docstrings_are_true(module):
    done = doctest.testmod(module)
    assert done.attempted > 0 and done.failed == 0


def run(page: Path, folder: Path) -> None:
    """Run the code of a page, all of it in one namespace, in a folder of its own."""
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    before = Path.cwd()
    os.chdir(folder)
    try:
        exec(compile("\n".join(blocks), str(page), "exec"), {"__name__": "page"})
    finally:
        os.chdir(before)


@pytest.fixture(scope="module")
def page_folder(tmp_path_factory):
    """Where the code of docs/python.md has run."""
    folder = tmp_path_factory.mktemp("page")
    run(ROOT / "docs" / "python.md", folder)
    return folder


def test_the_code_of_the_page_runs(page_folder):
    assert (page_folder / "results" / "report.json").exists()


def test_the_code_of_the_readme_runs(tmp_path):
    run(ROOT / "python" / "README.md", tmp_path)


def public():
    """Every function and method that users see, but for those of the client, whose examples need a service."""
    for name in chladni.__all__:
        value = getattr(chladni, name)
        if inspect.isfunction(value):
            yield name, value
        elif inspect.isclass(value) and value.__module__.startswith("chladni"):
            for method, function in inspect.getmembers(value, inspect.isfunction):
                if not method.startswith("_") and method in vars(value):
                    yield f"{name}.{method}", function


def test_every_public_function_is_documented():
    found = dict(public())
    assert len(found) > 20
    assert [name for name, function in found.items() if not (function.__doc__ or "").strip()] == []


def test_every_public_function_has_an_example_or_needs_a_service():
    def needs_a_service(name: str) -> bool:
        return name.split(".")[0] in ("Client", "Job", "ServiceError")

    without = [name for name, function in public() if ">>>" not in function.__doc__ and not needs_a_service(name)]
    assert without == []


def test_the_picture_of_the_page_is_the_one_that_its_code_makes(page_folder):
    """Size and bit depth (PNG's IHDR) are the same; pixels may differ between processors."""
    made, shown = ((folder / name).read_bytes() for folder, name in [
        (page_folder, "mode-5.png"), (ROOT / "docs", "python-mode-5.png")
    ])
    assert made[:33] == shown[:33]
