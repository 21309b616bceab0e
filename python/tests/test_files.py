"""Files: what is read is what was written."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import chladni


@pytest.mark.parametrize("extension", ["ply", "csv", "xyz", "obj", "off", "npy", "pcd"])
def test_coordinates_come_back(tmp_path, extension):
    points = np.round(np.random.default_rng(3).normal(size=(50, 3)), 4)
    chladni.write(tmp_path / f"cloud.{extension}", points)
    np.testing.assert_array_equal(chladni.read(tmp_path / f"cloud.{extension}").points, points)


@pytest.mark.parametrize("extension", ["las", "laz"])
def test_coordinates_of_scans_come_back_on_their_grid(tmp_path, extension):
    points = np.round(np.random.default_rng(3).normal(size=(50, 3)), 4)
    chladni.write(tmp_path / f"cloud.{extension}", points)
    np.testing.assert_allclose(chladni.read(tmp_path / f"cloud.{extension}").points, points, rtol=1e-12)


def test_coordinates_are_written_in_the_type_that_they_came_in(tmp_path):
    for dtype, word in ((np.float32, b"float x"), (np.float64, b"double x"), (np.int16, b"short x")):
        chladni.write(tmp_path / "cloud.ply", np.arange(12).reshape(4, 3).astype(dtype))
        assert word in (tmp_path / "cloud.ply").read_bytes()


def test_a_field_of_integers_with_gaps_comes_as_doubles():
    values = np.array([1.0, np.nan, 3.0])
    cloud = chladni.Cloud._of(chladni.Cloud(np.eye(3))._inner.with_fields([("count", "uint8", values)]))
    np.testing.assert_array_equal(cloud.fields["count"], values)


def test_scalar_fields_of_ply_have_their_bare_name(tmp_path):
    chladni.write(tmp_path / "cloud.ply", np.eye(3), fields={"height": [1.0, 2.0, 3.0]}, ascii=True)
    text = (tmp_path / "cloud.ply").read_text()
    assert "property double scalar_height" in text
    (tmp_path / "bare.ply").write_text(text.replace("scalar_height", "height"))
    for name in ("cloud.ply", "bare.ply"):
        assert list(chladni.read(tmp_path / name).fields) == ["height"]


def test_packed_files_are_read_as_they_are(tmp_path):
    (tmp_path / "cloud.xyz.gz").write_bytes(gzip.compress(b"0 0 0\n1 0 0\n0 1 0\n"))
    assert len(chladni.read(tmp_path / "cloud.xyz.gz")) == 3


def test_rows_that_are_not_finite_are_written_too(tmp_path):
    points = np.eye(3)
    points[1, 1] = np.nan
    chladni.write(tmp_path / "cloud.ply", points)
    with pytest.raises(ValueError, match="point 1"):
        chladni.read(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(chladni.read(tmp_path / "cloud.ply", nonfinite="drop").points, points)


def test_fields_keep_values_and_types(tmp_path):
    fields = {"label": np.array([1, 2, 255], dtype=np.uint8), "t": np.array([0.1, 0.2, 0.3])}
    chladni.write(tmp_path / "cloud.ply", np.eye(3), faces=[[0, 1, 2]], fields=fields)
    cloud = chladni.read(tmp_path / "cloud.ply")
    assert cloud._inner.field_types() == [("label", "uint8"), ("t", "float64")]
    for name, values in fields.items():
        np.testing.assert_array_equal(cloud.fields[name], values)
        assert cloud.fields[name].dtype == values.dtype
    np.testing.assert_array_equal(cloud.faces, [[0, 1, 2]])
    assert "3 points in 3 dimensions, 1 faces, fields: label, t" in repr(cloud)


def test_a_georeferenced_scan_is_written_as_it_was_read(tmp_path):
    # steps of a millimeter far from the origin: single precision would lose them
    points = np.array([2_600_000.0, 1_200_000.0, 450.0]) + 0.001 * np.arange(60).reshape(20, 3)
    chladni.write(tmp_path / "one.las", points)
    scan = chladni.read(tmp_path / "one.las")
    assert scan.grids is not None
    chladni.write(tmp_path / "two.las", scan)
    again = chladni.read(tmp_path / "two.las")
    np.testing.assert_array_equal(again.points, scan.points)
    assert again.grids == scan.grids


def test_what_cannot_be_read_or_written_is_said(tmp_path):
    (tmp_path / "broken.ply").write_text("ply\nformat ascii 1.0\nelement vertex 2\n")
    with pytest.raises(ValueError, match=r"broken\.ply"):
        chladni.read(tmp_path / "broken.ply")
    with pytest.raises(FileNotFoundError, match="absent"):
        chladni.read(tmp_path / "absent.ply")
    (tmp_path / "page.ply").write_text("<!DOCTYPE html><html></html>")
    with pytest.raises(ValueError, match="HTML"):
        chladni.read(tmp_path / "page.ply")
    with pytest.raises(ValueError, match="did you mean `ply`"):
        chladni.read(tmp_path / "broken.ply", format="plyy")
    with pytest.raises(ValueError, match="a choice of PLY"):
        chladni.write(tmp_path / "cloud.obj", np.eye(3), ascii=True)
    with pytest.raises(ValueError, match="read, not written"):
        chladni.write(tmp_path / "cloud.e57", np.eye(3))
    with pytest.raises(ValueError, match="unknown format"):
        chladni.write(tmp_path / "cloud.docx", np.eye(3))
    with pytest.raises(OSError):
        chladni.write(tmp_path / "no" / "such" / "cloud.ply", np.eye(3))
