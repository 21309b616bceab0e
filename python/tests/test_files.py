"""Files: what is read is what was written."""

from __future__ import annotations

import numpy as np
import pytest

import chladni


@pytest.mark.parametrize("extension", ["ply", "csv", "xyz", "obj", "off", "npy"])
def test_coordinates_come_back(tmp_path, extension):
    points = np.round(np.random.default_rng(3).normal(size=(50, 3)), 4)
    chladni.write(tmp_path / f"cloud.{extension}", points)
    np.testing.assert_array_equal(chladni.read(tmp_path / f"cloud.{extension}").points, points)


def test_fields_keep_values_and_types(tmp_path):
    fields = {"label": np.array([1, 2, 255], dtype=np.uint8), "t": np.array([0.1, 0.2, 0.3])}
    chladni.write(tmp_path / "cloud.ply", np.eye(3), faces=[[0, 1, 2]], fields=fields)
    cloud = chladni.read(tmp_path / "cloud.ply")
    assert cloud._inner.field_types() == [("label", "uint8"), ("t", "float64")]
    np.testing.assert_array_equal(cloud.fields["t"], fields["t"])
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
    with pytest.raises(FileNotFoundError):
        chladni.read(tmp_path / "absent.ply")
    with pytest.raises(ValueError, match="read, not written"):
        chladni.write(tmp_path / "cloud.e57", np.eye(3))
    with pytest.raises(ValueError, match="unknown format"):
        chladni.write(tmp_path / "cloud.docx", np.eye(3))
    with pytest.raises(OSError):
        chladni.write(tmp_path / "no" / "such" / "cloud.ply", np.eye(3))
