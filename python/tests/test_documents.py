"""What the documents say is run: docstrings, the README and the page of the project."""

from __future__ import annotations

import doctest
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


@pytest.mark.parametrize("page", [ROOT / "python" / "README.md", ROOT / "docs" / "python.md"], ids=lambda p: p.name)
def test_the_code_of_the_pages_runs(page, tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks
    before = Path.cwd()
    os.chdir(tmp_path)
    try:
        exec(compile("\n".join(blocks), str(page), "exec"), {"__name__": "page"})
    finally:
        os.chdir(before)


def test_every_public_function_has_an_example_or_is_of_the_client():
    without = []
    for name in ("laplacian", "eigenbasis", "read", "write", "sample_sphere"):
        if ">>>" not in (getattr(chladni, name).__doc__ or ""):
            without.append(name)
    assert without == []
